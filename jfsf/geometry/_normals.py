"""Unit normals at vertices, traced; those of numpy are in `jfsf.mesh._geometry`."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

# Faces whose areas add up to less than this share of their sum have no common normal:
# what is left of two faces back to back is rounding. Few vertices are like that: at the
# tips of fins, as decimation makes them, and where a smoothed surface folds.
CANCELLED = 1e-3


def normals(
    points: Float[Array, "n 3"], faces: Int[Array, "m 3"]
) -> Float[Array, "n 3"]:
    """Unit normals at vertices, each face's counted by its area.

    0 without faces, and where the faces cancel, as at the tip of a fin of two faces
    back to back.
    """
    a, b, c = (points[faces[:, i]] for i in range(3))
    across = jnp.cross(b - a, c - a)
    both = jnp.concatenate([across, jnp.sum(jnp.abs(across), 1, keepdims=True)], 1)
    total = jnp.zeros((len(points), 4), points.dtype).at[faces].add(both[:, None])
    total, most = total[:, :3], total[:, 3:]
    size = jnp.sum(total**2, 1, keepdims=True)
    known = size > (CANCELLED * most) ** 2
    return total * jnp.where(known, 1 / jnp.sqrt(jnp.where(known, size, 1)), 0)
