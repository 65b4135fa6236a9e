"""Functional maps and single figures of a map file, checked."""

import numpy as np

from jfsf.apps.mapfiles._formats import MapFileError
from jfsf.types import ArrayLike


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
