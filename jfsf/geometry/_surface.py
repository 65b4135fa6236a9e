"""Surfaces, traced: normals, stretches, edges and cotangents at rest, sums at corners.

The edge of a corner is the one opposite to it: that of corner i runs from corner i + 1
to corner i + 2. Values at corners are arrays (m, 3, ...). Areas, normals and edges in
numpy are in `jfsf.mesh._geometry`.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf._exported import exported
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide

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
