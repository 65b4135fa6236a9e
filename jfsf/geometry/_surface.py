"""A mesh at rest: its edges and cotangents, and sums of values at corners. Traced.

The edge of a corner is the one opposite to it: that of corner i runs from corner i + 1
to corner i + 2. Values at corners are arrays (m, 3, ...).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf._exported import exported
from jfsf.array._jit import jit

# Least and greatest cotangent. That of an obtuse corner is negative, that of a
# degenerate triangle infinite.
STIFFNESS_RANGE = (0.01, 100.0)


@exported
class Surface(NamedTuple):
    """A mesh at rest.

    faces, mass: as in `Spectrum`.
    rest: the edge opposite to each corner.
    stiff: half the cotangent of that corner.
    """

    faces: Int[Array, "m 3"]
    mass: Float[Array, " n"]
    rest: Float[Array, "m 3 3"]
    stiff: Float[Array, "m 3 1"]


@jit(static_argnames="stiffness_range")
def surface(
    vertices: Float[Array, "n 3"],
    faces: Int[Array, "m 3"],
    mass: Float[Array, " n"],
    orientation_sign: Float[Array, ""] | float = 1.0,
    *,
    stiffness_range: tuple[float, float] = STIFFNESS_RANGE,
) -> Surface:
    """A mesh at rest, mirrored where `orientation_sign` is -1.

    Args:
        vertices, faces, mass: as in `Spectrum`; faces of padding are degenerate.
        orientation_sign: 1 or -1.
        stiffness_range: cotangents are clipped to it.
    """
    mirror = jnp.ones((1, 3), vertices.dtype).at[0, 0].set(orientation_sign)
    rest = opposite_edges(vertices * mirror, faces)
    to, fro = corner_sides(rest)
    across = jnp.sum(jnp.cross(to, fro) ** 2, 2, keepdims=True)
    flat = across == 0
    across = jnp.sqrt(jnp.where(flat, 1, across))
    cotangent = jnp.sum(to * fro, 2, keepdims=True) / across
    # Degenerate faces, padding included, have no stiffness.
    stiff = jnp.where(flat, 0, jnp.clip(cotangent, *stiffness_range) / 2)
    return Surface(faces, mass, rest, stiff)


def opposite_edges(
    points: Float[Array, "n d"], faces: Int[Array, "m 3"]
) -> Float[Array, "m 3 d"]:
    """The edge opposite to each corner."""
    corners = points[faces]
    return next_corners(corners, 2) - next_corners(corners, 1)


def corner_sides(
    rest: Float[Array, "m 3 d"],
) -> tuple[Float[Array, "m 3 d"], Float[Array, "m 3 d"]]:
    """The two sides of each corner, from it to the next corner and to the last.

    Args:
        rest: `opposite_edges`.
    """
    return next_corners(rest, 2), -next_corners(rest, 1)


def next_corners(values: Float[Array, "m 3 ..."], by: int) -> Float[Array, "m 3 ..."]:
    """For each corner of a face, the value of the corner `by` places after it."""
    return jnp.roll(values, -by, 1)


def sum_at_vertices(
    values: Float[Array, "m 3 ..."], faces: Int[Array, "m 3"], n: int
) -> Float[Array, "n ..."]:
    """The sum of the values at the corners that meet at each of n vertices."""
    return jnp.zeros((n, *values.shape[2:]), values.dtype).at[faces].add(values)


def divergence(
    flux: Float[Array, "m 3 d"], faces: Int[Array, "m 3"], n: int
) -> Float[Array, "n d"]:
    """What enters each of n vertices less what leaves it, of a flux along edges.

    With the flux `stiff * opposite_edges(points, faces)` it is the cotangent Laplacian
    of the points, positive semidefinite.
    """
    return sum_at_vertices(next_corners(flux, 1) - next_corners(flux, 2), faces, n)
