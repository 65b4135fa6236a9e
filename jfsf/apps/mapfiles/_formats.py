"""The formats of map files: suffixes, first indices, keys, and the checks of values."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.mesh._values import InputError
from jfsf.types import ArrayLike

# The first index of each format, by convention.
BASE = {".vts": 1, ".map": 1, ".mat": 1, ".npz": 0}
INT_MAX = int(np.iinfo(np.int32).max)
# Keys of a match file are the fields of the records.
MATCH_KEYS = ["T_xy", "T_yx", "C_yx"]
CERTIFICATE = "certificate_"  # before the name of a figure
# What a match may have for each vertex of X and of Y, and of which kind.
VERTEX_KEYS = {
    f"{name}_{side}": kind
    for name, kind in (
        ("matched", "bool"),
        ("confidence", "probabilities"),
        ("radius", "lengths"),
        ("membership", "memberships"),
    )
    for side in "xy"
}
OVERLAP_KEYS = ["overlap_x", "overlap_y"]  # of a partial match only
# Of the match's info, where it has one: names in place of their numbers in `MatchInfo`.
INFO_KEYS = [f"info_{n}" for n in "sources confidence won stages seconds".split()]
NOTES_KEY = "notes"  # where something is to be said of how it was made
# The arrays of a file by name; each is read when it is called. In MATLAB files some are
# sparse matrices or structs.
Arrays = dict[str, Callable[[], Any]]


# What to do about a map that was read with another first index than it has.
FROM_0, FROM_1 = "pass base=0", "it looks 1-based: pass base=1"


class MapFileError(InputError):
    """A map file that cannot be used. The message says which, why and what to do.

    what: what is wrong with it.
    advice: what to do; "" if that is plain or said in `what`.
    name: the name of the file; "" if `what` names it.
    """


def first_index(name: str, path: Path, base: int | None) -> int:
    """`base`, or the convention of the format if it is None.

    Raises:
        MapFileError: unknown format.
        ValueError: base is neither None, 0 nor 1; `name` opens the message.
    """
    if base not in (None, 0, 1):
        raise ValueError(f"{name}: base is {base!r}, expected 0, 1 or None")
    suffix = path.suffix.lower()
    if suffix not in BASE:
        raise MapFileError(
            f"{path}: unknown format {suffix!r}; maps are {', '.join(BASE)}"
        )
    return BASE[suffix] if base is None else base


def to_indices(
    name: str, values: ArrayLike, n_from: int | None, n_to: int | None, base: int
) -> np.ndarray:
    """Check the entries of a map, and make them 0-based.

    Args:
        name: opens the message: the file, and the array in it.
        values: whole numbers of any type; a vector, or a matrix of one row or column.
        n_from: entries to expect; None skips the check.
        n_to: vertices of the target; None skips the check.
        base: the first index, 0 or 1.

    Returns:
        (n,) int32, 0-based.

    Raises:
        MapFileError: the entries are not whole numbers, are out of range for this base,
            or are not n_from in number.
    """
    values = np.asarray(values)
    if values.dtype.kind not in "iuf":
        raise MapFileError(f"{name}: holds {values.dtype}, expected whole numbers")
    if values.size == 0:
        raise MapFileError(f"{name}: holds no index; write or download it again")
    if values.size != max(values.shape, default=0):
        raise MapFileError(f"{name}: shape is {values.shape}, expected a vector")
    values = values.ravel()
    if values.dtype.kind == "f":
        with np.errstate(over="ignore"):  # of longer floats, to infinity
            values = values.astype(np.float64)

    n = len(values)
    if n_from is not None and n != n_from:
        hint = "is the file truncated, or another shape's?"
        if n == n_to:
            hint = "that is the size of the target: the map runs the other way"
        raise MapFileError(f"{name}: has {n} entries, expected {n_from}; {hint}")

    # Infinity equals its own floor, so finiteness is a test of its own.
    bad = np.flatnonzero(~(np.isfinite(values) & (values == np.floor(values))))
    if len(bad):
        raise MapFileError(
            f"{name}: entry {bad[0] + 1} is {values[bad[0]]}, not a whole number; the "
            "file holds no vertex map"
        )
    low, high = int(values.min()), int(values.max())
    if low < 0:
        raise MapFileError(
            f"{name}: entry {values.argmin() + 1} is {low:.15g}; give every vertex an "
            "image, unmatched ones are not supported"
        )
    if low < base:
        raise MapFileError("holds a 0, so it is not 1-based", FROM_0, name)
    limit = INT_MAX if n_to is None else n_to
    if high >= limit + base:
        hint = "is it another shape's, or does it run the other way?"
        if base == 0 and high == n_to and low > 0:
            hint = FROM_1
        raise MapFileError(
            f"entry {values.argmax() + 1} is {high:.15g}, the target has {limit} "
            f"vertices and the file is read as {base}-based",
            hint,
            name,
        )
    return (values.astype(np.int64) - base).astype(np.int32)


def to_functional_map(name: str, values: ArrayLike) -> np.ndarray:
    """Check a functional map (k_x, k_y); it may hold nan.

    Args:
        name: opens the message: the file, and the array in it.
        values: real numbers.

    Raises:
        MapFileError: no matrix of real numbers, or an empty one.
    """
    values = np.asarray(values)
    if values.ndim != 2 or values.size == 0 or values.dtype.kind not in "iuf":
        raise MapFileError(
            f"{name}: holds {values.dtype} {values.shape}, expected a functional map "
            "(k_x, k_y) of real numbers; write it again"
        )
    return values


def to_figures(name: str, values: ArrayLike, ndim: int) -> np.ndarray:
    """Check a number (ndim 0) or a vector of numbers (1) of a certificate.

    Raises:
        MapFileError: not numbers, or of another shape.
    """
    values = np.asarray(values)
    if values.ndim != ndim or values.dtype.kind not in "biuf":
        raise MapFileError(
            f"{name}: holds {values.dtype} {values.shape}, expected "
            f"{('a number', 'a vector of numbers')[ndim]}; write the match again"
        )
    return values


def to_vertex_values(name: str, values: ArrayLike, n: int, kind: str) -> np.ndarray:
    """Check a value for each of n vertices.

    Args:
        name: opens the message: the file, and the array in it.
        values: truth values if `kind` is "bool", floats from 0 on if it is "lengths",
            else floats in [0, 1]; floats may be nan.
        n: the number of vertices.
        kind: what they are, for the message.

    Raises:
        MapFileError: of another type or length, below 0, or above 1 and no lengths.
    """
    values = np.asarray(values)
    if values.shape != (n,) or values.dtype.kind != ("b" if kind == "bool" else "f"):
        raise MapFileError(
            f"{name}: is {values.dtype} {values.shape}, expected {kind} ({n},); write "
            "it with write_match"
        )
    most = np.inf if kind == "lengths" else 1
    if ((values < 0) | (values > most)).any():
        raise MapFileError(
            f"{name}: runs from {np.nanmin(values):.3g} to {np.nanmax(values):.3g}, "
            f"and {kind} from 0 to {most:g}; match the pair again"
        )
    return values
