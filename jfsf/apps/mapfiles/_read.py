"""Map files -> maps, ground truth and matches."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jfsf._figures import FIGURES, OLDEST
from jfsf.apps.mapfiles._arrays import read_mat, read_npz, read_text
from jfsf.apps.mapfiles._formats import (
    CERTIFICATE,
    INFO_KEYS,
    MATCH_KEYS,
    NOTES_KEY,
    OVERLAP_KEYS,
    VERTEX_KEYS,
    Arrays,
    MapFileError,
    first_index,
    to_figures,
    to_functional_map,
    to_indices,
    to_vertex_values,
)
from jfsf.types import SOURCES, STAGES, Certificate, Match, MatchInfo


class GroundTruth(NamedTuple):
    """Template point i is vertex gt_x[i] of X and gt_y[i] of Y; (p,) each, 0-based."""

    gt_x: np.ndarray
    gt_y: np.ndarray


def read_map(
    path: str | Path,
    *,
    n_from: int | None = None,
    n_to: int | None = None,
    base: int | None = None,
    key: str | None = None,
) -> np.ndarray:
    """Read a point map: entry i is the image of vertex or template point i.

    Args:
        path: `.vts`, `.map`, `.npz` or `.mat`.
        n_from: entries to expect: vertices of the shape that the map starts from; None
            skips the check, as for ground truth.
        n_to: vertices of the shape that the map goes to; None skips the check.
        base: 0 or 1, the file's first index; None takes the format's convention.
        key: the array in a `.npz` or `.mat`; None takes `T_xy`, or the only array.

    Returns:
        (n,) int32, 0-based.

    Raises:
        MapFileError: the file is missing, damaged, empty, of unknown format or lacks
            `key`; entries are not whole numbers, contradict the base or exceed n_to; or
            the length is not n_from, which hints at a swapped direction if it is n_to.
        ValueError: base is neither None, 0 nor 1.
    """
    path = Path(path)
    base, suffix = first_index("read_map", path, base), path.suffix.lower()
    if suffix in (".vts", ".map"):
        if key is not None:
            raise MapFileError(f"{path}: text holds no key {key!r}: leave out `key`")
        values = read_text(path)
    else:
        arrays = read_arrays(path)
        key = choose_key(path, arrays, key)
        values, path = arrays[key](), f"{path}[{key}]"
    return to_indices(str(path), values, n_from, n_to, base)


def read_ground_truth(
    path_x: str | Path,
    path_y: str | Path,
    *,
    n_x: int | None = None,
    n_y: int | None = None,
    base: int | None = None,
) -> GroundTruth:
    """Read the ground truth of a pair from a file for each shape.

    Line i of each file is the vertex of that shape at template point i.

    Args:
        path_x, path_y: as for `read_map`, usually `.vts`.
        n_x, n_y: vertices of the shapes; None skips the check.
        base: 0 or 1, the first index in both files; None takes the format's convention.

    Raises:
        MapFileError: as `read_map`, or the two do not have the same number of points.
    """
    gt_x = read_map(path_x, n_to=n_x, base=base)
    gt_y = read_map(path_y, n_to=n_y, base=base)
    if len(gt_x) != len(gt_y):
        raise MapFileError(
            f"{path_y}: has {len(gt_y)} template points, {path_x} has {len(gt_x)}; "
            "take both files from one dataset"
        )
    return GroundTruth(gt_x, gt_y)


def read_match(path: str | Path) -> Match:
    """Read a file of `write_match`: a Match of numpy arrays; other keys are ignored.

    Raises:
        MapFileError: missing or damaged file, missing keys, arrays of another shape or
            type, or maps that do not fit each other.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise MapFileError(f"{path}: a match is a .npz, not {path.suffix!r}")
    arrays = read_arrays(path)
    later = [name for name, figure in FIGURES.items() if figure.since != OLDEST]
    for name in later:
        before = CERTIFICATE + (FIGURES[name].formerly or name)
        unknown = lambda: np.asarray(np.nan)
        arrays.setdefault(CERTIFICATE + name, arrays.get(before, unknown))
    keys = {CERTIFICATE + name: name for name in Certificate._fields}
    if missing := [name for name in (*MATCH_KEYS, *keys) if name not in arrays]:
        own = set(arrays) - {CERTIFICATE + name for name in later}
        raise MapFileError(
            f"{path}: lacks {', '.join(missing)}; it holds {_names(own)}; write it "
            "with write_match"
        )
    fields: dict[str, Any] = {name: arrays[name]() for name in MATCH_KEYS}
    sizes = {"x": fields["T_xy"].size, "y": fields["T_yx"].size}
    for name, other in (("T_xy", "y"), ("T_yx", "x")):
        where = f"{path}[{name}]"
        fields[name] = to_indices(where, fields[name], None, sizes[other], 0)
    fields["C_yx"] = to_functional_map(f"{path}[C_yx]", fields["C_yx"])
    for name, kind in VERTEX_KEYS.items():
        if name in arrays:
            values = arrays[name](), sizes[name[-1]]
            fields[name] = to_vertex_values(f"{path}[{name}]", *values, kind)
    for name in OVERLAP_KEYS:
        if name in arrays:
            fields[name] = to_figures(f"{path}[{name}]", arrays[name](), 0)
    certificate: dict[str, Any] = {
        name: to_figures(f"{path}[{key}]", arrays[key](), int(name not in FIGURES))
        for key, name in keys.items()
    }
    if all(key in arrays for key in INFO_KEYS):
        fields["info"] = _info(path, arrays)
    return Match(**fields, certificate=Certificate(**certificate))


def read_notes(path: str | Path) -> list[str]:
    """The notes in a file of `write_match`; [] if it has none.

    Raises:
        MapFileError: missing or damaged file, or notes that are no text.
    """
    arrays = read_npz(Path(path))
    if NOTES_KEY not in arrays:
        return []
    notes = np.asarray(arrays[NOTES_KEY]())
    if notes.dtype.kind != "U" or notes.ndim != 1:
        raise MapFileError(
            f"{path}[{NOTES_KEY}]: is {notes.dtype} {notes.shape}, expected lines of "
            "text; match the pair again"
        )
    return notes.tolist()


def _info(path: Path, arrays: Arrays) -> MatchInfo | None:
    """The info of a match; None for names that this version does not know."""
    sources, confidence, won, stages, seconds = (
        np.asarray(arrays[key]()) for key in INFO_KEYS
    )
    kinds = [value.dtype.kind for value in (sources, confidence, won, stages, seconds)]
    if (
        kinds != [*"UfiUf"]
        or sources.shape != confidence.shape
        or stages.shape != seconds.shape
        or not 0 <= won < len(sources)
    ):
        raise MapFileError(
            f"{path}: info_* do not fit each other; match the pair again"
        )
    if not {*sources.tolist()} <= {*SOURCES}:
        return None
    took = dict(zip(stages.tolist(), seconds, strict=True))
    return MatchInfo(
        np.array([SOURCES.index(name) for name in sources], np.int32),
        confidence,
        won,
        np.array([took.get(stage, np.nan) for stage in STAGES]),
    )


def read_arrays(path: Path) -> Arrays:
    """The arrays of a `.npz` or `.mat`.

    Raises:
        MapFileError: as `read_npz` and `read_mat`.
    """
    return read_npz(path) if path.suffix.lower() == ".npz" else read_mat(path)


def choose_key(path: Path, arrays: Arrays, key: str | None) -> str:
    """`key`; if it is None, `T_xy` or the only array.

    Raises:
        MapFileError: there is no such array, or several and none is `T_xy`.
    """
    if key is None:
        if "T_xy" in arrays or len(arrays) == 1:
            return "T_xy" if "T_xy" in arrays else next(iter(arrays))
        raise MapFileError(
            f"{path}: no T_xy among several arrays; pass one of these as `key`: "
            f"{_names(arrays)}"
        )
    if key not in arrays:
        raise MapFileError(f"{path}: no key {key!r}; it holds {_names(arrays)}")
    return key


def _names(names) -> str:
    return ", ".join(sorted(names)) or "no array"
