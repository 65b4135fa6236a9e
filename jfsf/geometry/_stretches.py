"""How a deformation stretches each triangle, traced."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array._precision import safe_divide

MOST_STRETCH = 2.0  # of the logarithm; a face that collapses has an infinite one


def log_stretches(
    rest: Float[Array, "n 3"], moved: Float[Array, "n 3"], faces: Int[Array, "m 3"]
) -> tuple[Float[Array, " m"], Float[Array, " m"], Float[Array, " m"]]:
    """Area at rest of each face, and the logarithms of its two principal stretches.

    The stretches are the singular values of the linear map between the triangle at rest
    and moved, the smaller first, clipped to exp(-+`MOST_STRETCH`). A face without an
    area, as of padding, has area 0.

    Args:
        rest, moved: positions of the vertices.
        faces: of both.
    """

    def metric(points):
        a, b, c = (points[faces[:, i]] for i in range(3))
        u, v = b - a, c - a
        squared = jnp.sum(jnp.cross(u, v) ** 2, 1)
        return jnp.sum(u * u, 1), jnp.sum(u * v, 1), jnp.sum(v * v, 1), squared

    E, F, G, size = metric(rest)
    e, f, g, moved_size = metric(moved)
    # The squared stretches are the eigenvalues of metric(rest)^-1 metric(moved).
    half = safe_divide(G * e - 2 * F * f + E * g, size) / 2
    product = safe_divide(moved_size, size)
    larger = half + root(half**2 - product)
    smaller = safe_divide(product, larger)
    low, high = math.exp(-2 * MOST_STRETCH), math.exp(2 * MOST_STRETCH)
    low_log, high_log = (jnp.log(jnp.clip(s, low, high)) / 2 for s in (smaller, larger))
    return root(size) / 2, low_log, high_log


def root(values: Float[Array, "..."]) -> Float[Array, "..."]:
    """Square roots, 0 where there is none; their derivative there is 0, not nan."""
    positive = values > 0
    roots = jnp.sqrt(jnp.asarray(jnp.where(positive, values, 1)))
    return jnp.where(positive, roots, 0)
