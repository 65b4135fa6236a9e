"""Maps, ground truth and matches on disk, with base, direction, length, range checked.

In memory every map is 0-based. On disk `.vts`, `.map` (one index a line) and `.mat` are
1-based by convention, `.npz` 0-based; files that break the convention exist (pyFM's are
0-based text), so `base` overrides it, and values that contradict it are an error. What
no check can see: a 0-based file that happens not to use 0, read as 1-based.

Ground truth (FAUST, SCAPE, TOSCA, remeshed): line i of `NAME.vts` is the vertex of that
shape at template point i, whatever the number of vertices; `NAME.sym.vts` is the same
for the left-right mirror image.
"""

import io
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
import scipy.io

from jfsf.types import ArrayLike, Certificate, Match

INT_MAX = int(np.iinfo(np.int32).max)
BASE = {".vts": 1, ".map": 1, ".mat": 1, ".npz": 0}
# Keys of a match file; they follow the records.
ARRAYS = [name for name in Match._fields if name != "certificate"]
EVIDENCE = ["certificate_" + name for name in Certificate._fields]


class MapFileError(ValueError):
    """A map file that cannot be used: which, what was found in it, what to do."""


class GroundTruth(NamedTuple):
    """Template point i is vertex gt_x[i] of X and gt_y[i] of Y; 0-based, (p,) each."""

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
    """Read a point map: entry i is where i, a vertex or template point, goes.

    Args:
        path: `.vts`, `.map`, `.npz` or `.mat`.
        n_from: entries to expect: vertices of the shape the map starts from; None skips
            the check, as for ground truth.
        n_to: vertices of the shape the map goes to; None skips the check.
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
    _check_base("read_map", base)
    suffix = _suffix(path)
    if base is None:
        base = BASE[suffix]
    if suffix in (".vts", ".map"):
        if key is not None:
            raise MapFileError(f"{path}: text holds no key {key!r}: leave out `key`")
        values = _read_text(path)
    else:
        arrays = _read_npz(path) if suffix == ".npz" else _read_mat(path)
        key = _choose(path, arrays, key)
        values, path = arrays[key], f"{path}[{key}]"
    return _to_indices(str(path), values, n_from, n_to, base)


def write_map(path: str | Path, T_xy: ArrayLike, *, base: int | None = None) -> None:
    """Write a 0-based map (n,) in the format of the suffix; key `T_xy` if it has keys.

    Appears complete or not at all. `base` as for `read_map`: pass the same to both.

    Raises:
        MapFileError: unknown format, or a folder that cannot be written.
        ValueError: T_xy is not a vector of non-negative integers, or a wrong base.
    """
    path = Path(path)
    _check_base("write_map", base)
    suffix = _suffix(path)
    T_xy = np.asarray(T_xy)
    if T_xy.ndim != 1 or T_xy.dtype.kind not in "iu" or not len(T_xy):
        raise ValueError(
            f"write_map: T_xy is {T_xy.shape} {T_xy.dtype}, expected (n,) integers"
        )
    for worst in (T_xy.min(), T_xy.max()):
        if not 0 <= worst < INT_MAX:
            raise ValueError(f"write_map: T_xy holds {worst}, not in 0..{INT_MAX - 1}")
    T_xy = T_xy.astype(np.int32) + np.int32(BASE[suffix] if base is None else base)

    def write(file):
        if suffix == ".npz":
            np.savez_compressed(file, T_xy=T_xy)
        elif suffix == ".mat":
            scipy.io.savemat(file, {"T_xy": T_xy}, oned_as="column")
        else:
            np.savetxt(file, T_xy, "%d")

    _replace(path, write)


def read_ground_truth(
    path_x: str | Path,
    path_y: str | Path,
    *,
    n_x: int | None = None,
    n_y: int | None = None,
    base: int | None = None,
) -> GroundTruth:
    """Read the ground truth of a pair: one file a shape, a line a template point.

    Args:
        path_x, path_y: as for `read_map`, usually `.vts`.
        n_x, n_y: vertices of the shapes; None skips the check.
        base: of both files; None takes the format's convention.

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


def write_match(path: str | Path, match: Match) -> None:
    """Write a Match as `.npz`: T_xy, T_yx (int32, 0-based), C_yx, certificate_*.

    Appears complete or not at all.

    Raises:
        MapFileError: the suffix is not `.npz`, or a folder that cannot be written.
        ValueError: the maps are batched: write one match a file.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise MapFileError(f"{path}: a match is written as .npz, not {path.suffix!r}")
    arrays: dict[str, Any] = {
        name: np.asarray(value)
        for name, value in [
            *((name, getattr(match, name)) for name in ARRAYS),
            *zip(EVIDENCE, match.certificate, strict=True),
        ]
    }
    for name in ("T_xy", "T_yx"):
        if arrays[name].ndim != 1:
            raise ValueError(
                f"write_match: {name} is {arrays[name].shape}, expected one match (n,)"
            )
        arrays[name] = arrays[name].astype(np.int32)
    _replace(path, lambda file: np.savez_compressed(file, **arrays))


def read_match(path: str | Path) -> Match:
    """Read what `write_match` wrote: a Match of numpy arrays; other keys are ignored.

    Raises:
        MapFileError: missing or damaged file, missing keys, or maps that do not fit
            each other.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise MapFileError(f"{path}: a match is a .npz, not {path.suffix!r}")
    arrays = _read_npz(path)
    missing = [name for name in (*ARRAYS, *EVIDENCE) if name not in arrays]
    if missing:
        raise MapFileError(
            f"{path}: lacks {', '.join(missing)}; it holds {_listed(arrays)}; write it "
            "with write_match"
        )
    fields: dict[str, Any] = {name: arrays[name] for name in ARRAYS}
    sizes = {name: fields[name].size for name in ("T_xy", "T_yx")}
    for name, other in (("T_xy", "T_yx"), ("T_yx", "T_xy")):
        fields[name] = _to_indices(
            f"{path}[{name}]", fields[name], None, sizes[other], 0
        )
    evidence: list[Any] = [arrays[name] for name in EVIDENCE]
    return Match(**fields, certificate=Certificate(*evidence))


def _check_base(name, base):
    if base not in (None, 0, 1):
        raise ValueError(f"{name}: base is {base!r}, expected 0, 1 or None")


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in BASE:
        raise MapFileError(
            f"{path}: unknown format {suffix!r}; maps are {', '.join(BASE)}"
        )
    return suffix


def _listed(names) -> str:
    return ", ".join(sorted(names)) or "no array"


def _choose(path, arrays, key) -> str:
    if key is None:
        if "T_xy" in arrays or len(arrays) == 1:
            return "T_xy" if "T_xy" in arrays else next(iter(arrays))
        raise MapFileError(
            f"{path}: no T_xy among several arrays; pass one of these as `key`: "
            f"{_listed(arrays)}"
        )
    if key not in arrays:
        raise MapFileError(f"{path}: no key {key!r}; it holds {_listed(arrays)}")
    return key


def _read_bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MapFileError(f"{path}: {error.strerror}; check the path") from None
    if not data.strip():
        raise MapFileError(f"{path}: the file is empty; write or download it again")
    return data


def _read_text(path: Path) -> np.ndarray:
    try:
        lines = _read_bytes(path).decode("ascii").splitlines()
    except UnicodeDecodeError:
        raise MapFileError(f"{path}: not text; expected one index a line") from None
    values = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            # float() would read 1_0 as 10.
            values.append(float("x" if "_" in line else line))
        except ValueError:
            raise MapFileError(
                f"{path}: line {number} is {line.strip()[:40]!r}; expected one index a "
                "line"
            ) from None
    return np.array(values)


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    # From memory: np.load leaves a damaged file open.
    data = io.BytesIO(_read_bytes(path))
    if not zipfile.is_zipfile(data):
        raise MapFileError(f"{path}: damaged, or no .npz; write it with np.savez")
    data.seek(0)
    try:
        with np.load(data, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise MapFileError(
            f"{path}: damaged, or no .npz of plain arrays ({error}); write it again"
        ) from None


def _read_mat(path: Path) -> dict[str, np.ndarray]:
    data = io.BytesIO(_read_bytes(path))
    try:
        found = scipy.io.loadmat(data)
    except NotImplementedError:
        raise MapFileError(
            f"{path}: saved with MATLAB's -v7.3; save it again with -v7"
        ) from None
    # A damaged file makes scipy raise whatever its parser stumbles on.
    except Exception as error:
        raise MapFileError(
            f"{path}: damaged, or no .mat ({error}); save it again with -v7"
        ) from None
    return {name: value for name, value in found.items() if name[:2] != "__"}


def _to_indices(where: str, values, n_from, n_to, base: int) -> np.ndarray:
    """Check, and make 0-based int32."""
    values = np.asarray(values)
    if values.dtype.kind not in "iuf":
        raise MapFileError(f"{where}: holds {values.dtype}, expected whole numbers")
    if values.size == 0:
        raise MapFileError(f"{where}: holds no index; write or download it again")
    if values.size != max(values.shape, default=0):
        raise MapFileError(f"{where}: shape is {values.shape}, expected a vector")
    values = values.ravel()

    n = len(values)
    if n_from is not None and n != n_from:
        hint = "is the file truncated, or another shape's?"
        if n == n_to:
            hint = "that is the size of the target: the map runs the other way"
        raise MapFileError(f"{where}: has {n} entries, expected {n_from}; {hint}")

    # nan is not its own floor, inf is.
    bad = np.flatnonzero(~(np.isfinite(values) & (values == np.floor(values))))
    if len(bad):
        raise MapFileError(
            f"{where}: entry {bad[0] + 1} is {values[bad[0]]}, not a whole number; the "
            "file holds no vertex map"
        )
    low, high = int(values.min()), int(values.max())
    if low < 0:
        raise MapFileError(
            f"{where}: entry {values.argmin() + 1} is {low}; give every vertex an "
            "image, unmatched ones are not supported"
        )
    if low < base:
        raise MapFileError(f"{where}: holds a 0, so it is not 1-based; pass base=0")
    limit = INT_MAX if n_to is None else n_to
    if high >= limit + base:
        hint = "is it another shape's, or does it run the other way?"
        if base == 0 and high == n_to and low > 0:
            hint = "it looks 1-based: pass base=1"
        raise MapFileError(
            f"{where}: entry {values.argmax() + 1} is {high}, the target has {limit} "
            f"vertices and the file is read as {base}-based; {hint}"
        )
    return (values.astype(np.int64) - base).astype(np.int32)


def _replace(path: Path, write) -> None:
    """Write beside `path`, then rename over it: readers never see half a file."""
    temporary = path.with_name(f".{path.name}.{uuid4().hex}.tmp")
    try:
        with temporary.open("xb") as file:
            write(file)
        os.replace(temporary, path)
    except OSError as error:
        raise MapFileError(
            f"{path}: cannot be written ({error.strerror}); check the folder"
        ) from None
    finally:
        temporary.unlink(missing_ok=True)
