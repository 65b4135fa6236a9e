"""Solves with a sparse matrix that is symmetric and positive definite. Host side."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu


def definite_solver(
    matrix: sp.spmatrix, ordering: Literal["MMD_AT_PLUS_A", "NATURAL"] = "MMD_AT_PLUS_A"
) -> Callable[[np.ndarray], np.ndarray]:
    """b -> matrix^-1 b, by one factor of the matrix.

    Args:
        matrix: symmetric and positive definite.
        ordering: "NATURAL" where rows and columns are ordered for little fill.
    """
    # No pivoting, and half the fill of the default ordering.
    factor = splu(
        sp.csc_matrix(matrix),
        permc_spec=ordering,
        diag_pivot_thresh=0,
        options={"SymmetricMode": True},
    )
    return factor.solve
