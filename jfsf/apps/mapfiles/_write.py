"""Maps, matches and MATLAB's variables -> files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from jfsf.apps.mapfiles._formats import (
    CERTIFICATE,
    INFO_KEYS,
    INT_MAX,
    MATCH_KEYS,
    NOTES_KEY,
    OVERLAP_KEYS,
    VERTEX_KEYS,
    MapFileError,
    first_index,
)
from jfsf.storage._atomic import write_atomically
from jfsf.types import STAGES, ArrayLike, Match


def write_map(path: str | Path, T_xy: ArrayLike, *, base: int | None = None) -> None:
    """Write a 0-based map (n,) in the format of the suffix.

    The file appears complete or not at all.

    Args:
        path: `.vts`, `.map`, `.npz` or `.mat`; the last two hold it as `T_xy`.
        T_xy: the vertex of Y for each vertex of X.
        base: 0 or 1, the first index in the file, as for `read_map`; None takes the
            format's convention.

    Raises:
        MapFileError: unknown format, or a folder that cannot be written.
        ValueError: T_xy is not a vector of non-negative integers, or a wrong base.
    """
    path = Path(path)
    base, suffix = first_index("write_map", path, base), path.suffix.lower()
    T_xy = np.asarray(T_xy)
    if T_xy.ndim != 1 or T_xy.dtype.kind not in "iu" or not len(T_xy):
        raise ValueError(
            f"write_map: T_xy is {T_xy.shape} {T_xy.dtype}, expected (n,) integers"
        )
    for worst in (T_xy.min(), T_xy.max()):
        if not 0 <= worst < INT_MAX:
            raise ValueError(f"write_map: T_xy holds {worst}, not in 0..{INT_MAX - 1}")
    T_xy = T_xy.astype(np.int32) + np.int32(base)

    def write(file):
        if suffix == ".npz":
            np.savez_compressed(file, T_xy=T_xy)
        elif suffix == ".mat":
            _savemat(file, {"T_xy": T_xy})
        else:
            np.savetxt(file, T_xy, "%d")

    _save(path, write)


def write_mat(path: str | Path, variables: dict[str, Any]) -> None:
    """Write variables as a MATLAB file (-v7); it appears complete or not at all.

    Args:
        path: `.mat`.
        variables: arrays by name. A dict is a struct, and a vector is a column.

    Raises:
        MapFileError: a folder that cannot be written.
    """
    _save(Path(path), lambda file: _savemat(file, variables))


def write_match(
    path: str | Path,
    match: Match,
    *,
    index_x: ArrayLike | None = None,
    index_y: ArrayLike | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write a Match as `.npz`: T_xy, T_yx (int32, 0-based), C_yx, certificate_*.

    Where the match has `info`, the file has info_sources and info_stages (names),
    info_confidence, info_won and info_seconds. Where it has them, confidence_x and
    confidence_y hold a probability for each vertex, and radius_x and radius_y a length
    for each vertex, in sqrt(area) of the shape its image lies on. A partial match has
    matched_x and matched_y (bool), membership_x and membership_y (a number in [0, 1] a
    vertex), and overlap_x and overlap_y (shares of the areas). The file appears
    complete or not at all.

    Args:
        path: `.npz`.
        match: one match, not a batch.
        index_x, index_y: the original vertex of each vertex of X and of Y, if these are
            parts of larger meshes; see `Submesh`. Written under these names,
            or left out if None.
        notes: sentences on how it was made, such as what was left out of a mesh; for
            `read_notes`.

    Raises:
        MapFileError: the suffix is not `.npz`, or a folder that cannot be written.
        ValueError: the maps are batched; write one match a file.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise MapFileError(f"{path}: a match is written as .npz, not {path.suffix!r}")
    values = {name: getattr(match, name) for name in MATCH_KEYS}
    values |= {CERTIFICATE + n: v for n, v in match.certificate._asdict().items()}
    for name in (*VERTEX_KEYS, *OVERLAP_KEYS):
        if (value := getattr(match, name)) is not None:
            values[name] = value
    if (info := match.info) is not None:
        # Names, not their numbers: a later version may have others.
        known = info.sources, info.confidence, info.won, STAGES, info.seconds
        values |= zip(INFO_KEYS, known, strict=True)
    arrays: dict[str, Any] = {n: np.asarray(value) for n, value in values.items()}
    for name in ("T_xy", "T_yx"):
        if arrays[name].ndim != 1:
            raise ValueError(
                f"write_match: {name} is {arrays[name].shape}, expected one match (n,)"
            )
        arrays[name] = arrays[name].astype(np.int32)
    for name, index in (("index_x", index_x), ("index_y", index_y)):
        if index is not None:
            arrays[name] = np.asarray(index)
    if notes:
        arrays[NOTES_KEY] = np.array(list(notes))
    _save(path, lambda file: np.savez_compressed(file, **arrays))


def _savemat(file, variables):
    scipy.io.savemat(file, variables, do_compression=True, oned_as="column")
    # scipy's description carries the clock: equal variables must give equal files.
    file.seek(0)
    file.write(b"MATLAB 5.0 MAT-file, written by jfsf".ljust(116))


def _save(path, write):
    try:
        write_atomically(path, write)
    except OSError as error:
        raise MapFileError(
            f"{path}: cannot be written ({error.strerror}); check the folder"
        ) from None
