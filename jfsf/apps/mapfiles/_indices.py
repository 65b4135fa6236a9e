"""Entries of a map file -> 0-based indices, checked."""

import numpy as np

from jfsf.apps.mapfiles._formats import MapFileError
from jfsf.types import ArrayLike

INT_MAX = int(np.iinfo(np.int32).max)


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
        raise MapFileError(f"{name}: holds a 0, so it is not 1-based; pass base=0")
    limit = INT_MAX if n_to is None else n_to
    if high >= limit + base:
        hint = "is it another shape's, or does it run the other way?"
        if base == 0 and high == n_to and low > 0:
            hint = "it looks 1-based: pass base=1"
        raise MapFileError(
            f"{name}: entry {values.argmax() + 1} is {high:.15g}, the target has "
            f"{limit} vertices and the file is read as {base}-based; {hint}"
        )
    return (values.astype(np.int64) - base).astype(np.int32)
