"""Arguments, checked: shapes in correspondence, their faces and weights."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jfsf.mesh import MeshError
from jfsf.mesh._values import check_values

# How coarse the numbers of a shape may be, over its size: modes of a hundredth of the
# size are then known to a hundredth.
COARSE = 1e-4


def check_shapes(name: str, shapes: Any, *, least: int) -> Array:
    """Positions (s, n, 3) as floats.

    They are refused where their precision is too coarse for where they lie, or for
    their size.

    Args:
        name: the function that asks; it opens the message.
        shapes: what it was given.
        least: how many shapes it needs.

    Raises:
        ValueError: as `align`.
    """
    ranks = set(map(np.shape, shapes)) if isinstance(shapes, list | tuple) else ()
    if len(ranks) > 1:
        raise ValueError(
            f"{name}: shapes are {' and '.join(map(str, sorted(ranks)))}; they need "
            "the same vertices in the same order, as `jfsf.match` and a registration "
            "give them"
        )
    shapes = jnp.asarray(shapes)
    if not jnp.issubdtype(shapes.dtype, jnp.floating):
        shapes = shapes.astype(jnp.zeros(0).dtype)
    if shapes.ndim != 3 or shapes.shape[2] != 3 or shapes.shape[1] == 0:
        raise ValueError(f"{name}: shapes are {shapes.shape}; pass (s, n, 3) positions")
    if len(shapes) < least:
        raise ValueError(
            f"{name}: there are {len(shapes)} shapes, it needs {least} or more"
        )
    bad = ~np.isfinite(np.asarray(shapes)).all(2)
    if bad.any():
        shape, vertex = np.argwhere(bad)[0]
        raise ValueError(
            f"{name}: vertex {vertex} of shape {shape} is not finite; leave the shape "
            "out"
        )
    _check_precision(name, np.asarray(shapes))
    return shapes


def _check_precision(name: str, shapes: np.ndarray) -> None:
    """ValueError for shapes too far away, too small or too large for their precision.

    Args:
        name: the function that asks.
        shapes: (s, n, 3).
    """
    limits = np.finfo(shapes.dtype)
    size, away = np.ptp(shapes, axis=1).max(1), np.abs(shapes).max((1, 2))
    # Squares of areas are computed.
    smallest, largest = 1e3 * limits.tiny**0.25, 0.1 * limits.max**0.25
    for i in np.flatnonzero(size > 0):
        if limits.eps * away[i] > COARSE * size[i]:
            raise ValueError(
                f"{name}: shape {i} has size {size[i]:.3g} and lies {away[i]:.3g} from "
                f"the origin, where {limits.dtype} is too coarse; subtract the mean of "
                "each shape in float64, or make jax use float64"
            )
        if not smallest < size[i] < largest:
            raise ValueError(
                f"{name}: shape {i} has size {size[i]:.3g}, and areas are squared in "
                f"{limits.dtype}; pass shapes in another unit, of a size from "
                f"{smallest:.1g} to {largest:.1g}"
            )


def check_weights(name: str, weights: Any, shapes: Array) -> Array:
    """Weights (n,) of the vertices of shapes, all alike if None, or ValueError."""
    n, dtype = shapes.shape[1], shapes.dtype
    weights = jnp.ones(n, dtype) if weights is None else jnp.asarray(weights, dtype)
    if weights.shape != (n,):
        raise ValueError(f"{name}: weights are {weights.shape}, there are {n} vertices")
    values = np.asarray(weights)
    if not (np.isfinite(values).all() and (values >= 0).all() and values.sum() > 0):
        raise ValueError(
            f"{name}: weights go from {values.min()} to {values.max()}; pass "
            "finite numbers, none negative and not all 0"
        )
    return weights


def check_faces(name: str, faces: Any, shapes: Array) -> Array:
    """Faces (m, 3) of the vertices of shapes, or MeshError."""
    faces = np.asarray(faces)
    check_values(np.asarray(shapes[0]), faces, name, finite=False)
    if not len(faces):
        raise MeshError("there are no faces", "pass (m, 3) integers", name)
    return jnp.asarray(faces)
