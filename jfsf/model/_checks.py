"""Arguments, checked: shapes in correspondence, their faces, weights and masks."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jfsf.mesh import MeshError


def check_shapes(name: str, shapes: Any, missing: Any = None, *, least: int) -> Any:
    """Positions (s, n, 3) as floats, or ValueError.

    Args:
        name: the function that asks; it opens the message.
        shapes: what it was given.
        missing: (s, n) vertices whose positions are not read, so they may be nan.
        least: how many shapes it needs.
    """
    ranks = {np.shape(shape) for shape in shapes} if isinstance(shapes, list) else ()
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
        finite = np.isfinite(np.asarray(shapes)).all(2)
        if missing is not None and np.shape(missing) == finite.shape:
            finite |= np.asarray(missing, bool)
        if not finite.all():
            shape, vertex = np.argwhere(~finite)[0]
            raise ValueError(
                f"{name}: vertex {vertex} of shape {shape} is not finite; name it in "
                "`missing`, or leave the shape out"
            )
    return shapes


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


def check_weights(name: str, weights: Any, n: int, dtype: Any) -> Any:
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
