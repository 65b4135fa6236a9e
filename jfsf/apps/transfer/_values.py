"""Values of Y's vertices -> values of X's vertices."""

import numpy as np
from jaxtyping import Float

from jfsf.apps.transfer._laid import Laid
from jfsf.apps.transfer._points import at_vertices, nearest, place, sides, target
from jfsf.types import ArrayLike


def values(laid: Laid, values_y: Float[ArrayLike, "n_y ..."]) -> ArrayLike:
    """Values carried from Y to X: at each vertex of X that of its point on Y.

    Args:
        laid: X and Y laid on each other (`lay`).
        values_y: numbers of each vertex of Y, one or several; nan where there is none.

    Returns:
        (n_x, ...) float64, in the unit of `values_y`: linear on Y's triangles. nan
        where Y has no surface for a vertex, or no value around its point.

    Raises:
        ValueError: not one row of real numbers a vertex of Y.
    """
    values_y = np.asarray(values_y)
    n_y = len(laid.mesh_y.vertices)
    if values_y.ndim < 1 or len(values_y) != n_y or values_y.dtype.kind not in "fiub":
        raise ValueError(
            f"values: values_y is {values_y.dtype} {values_y.shape}; give ({n_y},) or "
            f"({n_y}, d) numbers, one row a vertex of Y"
        )
    rows = values_y.astype(np.float64).reshape(n_y, -1)
    x, y = sides(laid)
    found = nearest(target(y), *place(x, at_vertices(x)))
    # What is not known at a corner of weight 0 does not matter.
    part = np.where(
        found.weights[:, :, None] > 0,
        found.weights[:, :, None] * rows[found.corners],
        0.0,
    )
    carried = np.where(laid.known_x[:, None], part.sum(1), np.nan)
    return carried.reshape(-1, *values_y.shape[1:])
