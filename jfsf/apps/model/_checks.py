"""Arguments, checked: shapes in correspondence, their faces, weights and masks."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from jfsf.mesh import MeshError
from jfsf.types import ArrayLike

# How coarse the numbers of a shape may be, over its size: modes of a hundredth of the
# size are then known to a hundredth.
COARSE = 1e-4


def check_shapes(name: str, shapes: Any, missing: Any = None, *, least: int) -> Any:
    """Positions (s, n, 3) as floats, or ValueError.

    Args:
        name: the function that asks; it opens the message.
        shapes: what it was given.
        missing: (s, n) vertices whose positions are not read, so they may be nan.
        least: how many shapes it needs.

    They are refused where their precision is too coarse for where they lie, or for
    their size.
    """
    ranks = set(map(np.shape, shapes)) if isinstance(shapes, list | tuple) else ()
    if len(ranks) > 1:
        raise ValueError(
            f"{name}: shapes are {' and '.join(map(str, sorted(ranks)))}; they need "
            "the same vertices in the same order, as `jfsf.match` and a registration "
            "give them"
        )
    shapes = floats(shapes)
    if shapes.ndim != 3 or shapes.shape[2] != 3 or shapes.shape[1] == 0:
        raise ValueError(f"{name}: shapes are {shapes.shape}; pass (s, n, 3) positions")
    if len(shapes) < least:
        raise ValueError(
            f"{name}: there are {len(shapes)} shapes, it needs {least} or more"
        )
    if is_known(shapes, missing):
        read = np.ones(shapes.shape[:2], bool)
        if np.shape(missing) == read.shape:
            read = ~np.asarray(missing, bool)
        bad = read & ~np.isfinite(np.asarray(shapes)).all(2)
        if bad.any():
            shape, vertex = np.argwhere(bad)[0]
            raise ValueError(
                f"{name}: vertex {vertex} of shape {shape} is not finite; name it in "
                "`missing`, or leave the shape out"
            )
        _check_precision(name, np.asarray(shapes), read)
    return shapes


def centred(shapes: Float[ArrayLike, "s n 3"]) -> Float[np.ndarray, "s n 3"]:
    """Shapes about their own centroids, in float64 even where jax has float32.

    For shapes far from the origin. A model of them is the same but for its place.

    Args:
        shapes: positions of vertices, all of them known.
    """
    shapes = np.asarray(shapes, float)
    return shapes - shapes.mean(1, keepdims=True)


def _check_precision(name: str, shapes: np.ndarray, read: np.ndarray) -> None:
    """ValueError for shapes too far away, too small or too large for their precision.

    Args:
        name: the function that asks.
        shapes: (s, n, 3).
        read: (s, n), the vertices that count.
    """
    at, limits = read[..., None], np.finfo(shapes.dtype)
    most = np.where(at, shapes, -np.inf).max(1)
    least = np.where(at, shapes, np.inf).min(1)
    size = (most - least).max(1)
    away = np.maximum(np.abs(most), np.abs(least)).max(1)
    # Squares of areas are computed.
    smallest, largest = 1e3 * limits.tiny**0.25, 0.1 * limits.max**0.25
    for i in np.flatnonzero(read.any(1) & (size > 0)):
        if limits.eps * away[i] > COARSE * size[i]:
            raise ValueError(
                f"{name}: shape {i} has size {size[i]:.3g} and lies {away[i]:.3g} from "
                f"the origin, where {limits.dtype} is too coarse; pass "
                "`jfsf.apps.model.centred(shapes)`, or make jax use float64"
            )
        if not smallest < size[i] < largest:
            raise ValueError(
                f"{name}: shape {i} has size {size[i]:.3g}, and areas are squared in "
                f"{limits.dtype}; pass shapes in another unit, of a size from "
                f"{smallest:.1g} to {largest:.1g}"
            )


def check_faces(name: str, faces: Any, n: int) -> Any:
    """Faces (m, 3) of n vertices, or MeshError."""
    if len(np.shape(faces)) != 2 or np.shape(faces)[1] != 3 or not len(faces):
        raise MeshError(f"{name}: faces are {np.shape(faces)}; pass (m, 3) integers")
    faces = jnp.asarray(faces)
    if not jnp.issubdtype(faces.dtype, jnp.integer):
        raise MeshError(f"{name}: faces are {faces.dtype}; pass (m, 3) integers")
    if is_known(faces):
        out = (np.asarray(faces) < 0) | (np.asarray(faces) >= n)
        if out.any():
            raise MeshError(
                f"{name}: a face names vertex {np.asarray(faces)[out][0]}, but the {n} "
                f"vertices are 0 to {n - 1} (counted from 0); pass the faces of these "
                "shapes"
            )
    return faces


def check_weights(name: str, weights: Any, n: int, dtype: Any) -> jax.Array:
    """Weights (n,), all alike if None, or ValueError."""
    if weights is None:
        return jnp.ones(n, dtype)
    weights = jnp.asarray(weights, dtype)
    if weights.shape != (n,):
        raise ValueError(f"{name}: weights are {weights.shape}, there are {n} vertices")
    if is_known(weights):
        values = np.asarray(weights)
        if not (np.isfinite(values).all() and (values >= 0).all() and values.sum() > 0):
            raise ValueError(
                f"{name}: weights go from {values.min()} to {values.max()}; pass "
                "finite numbers, none negative and not all 0"
            )
    return weights


def check_mask(name: str, missing: Any, shape: tuple[int, int]) -> Any:
    """What is not missing (s, n), all if None, or ValueError."""
    if missing is None:
        return jnp.ones(shape, bool)
    if np.shape(missing) != shape:
        raise ValueError(f"{name}: missing is {np.shape(missing)}, shapes are {shape}")
    return ~jnp.asarray(missing, bool)


def check_modes(name: str, modes: int | None, most: int) -> int:
    """How many modes to keep, all if None, or ValueError."""
    if modes is not None and not 1 <= modes <= most:
        raise ValueError(
            f"{name}: modes is {modes}; so many shapes have 1 to {most}, None keeps all"
        )
    return most if modes is None else modes


def floats(values: Any) -> Any:
    """A jax array of floats, in its own precision."""
    values = jnp.asarray(values)
    if jnp.issubdtype(values.dtype, jnp.floating):
        return values
    return values.astype(jnp.zeros(0).dtype)


def is_known(*arrays: Any) -> bool:
    """Whether the values of arrays are there, and not traced."""
    return not any(isinstance(array, Tracer) for array in arrays)
