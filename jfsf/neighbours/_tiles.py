"""Tiles: compact groups of points of equal size, made by halving along principal axes.

The search among candidates handles a tile at a time: its points share their candidates,
so one product of two small matrices replaces a gather for each point. Tiles are made
once for each shape, from coordinates in which neighbours on the surface are close. They
depend neither on the pose nor on the map.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.array import einsum
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides, varying_as
from jfsf.types import Spectrum, Tiles

# Eigenpairs whose eigenfunctions place a vertex. Higher ones vary within a tile and
# make it less compact.
TILE_EIGENPAIRS = 60
# Steps to the principal axis of a part. A rough axis is enough: it need only be a long
# side of the part.
POWER_ITERATIONS = 3
TILE_SIZE = 16  # points, at most (experiments/bench/bench_large.py)


@jit(static_argnames="size")
def tiles(
    points: Float[Array, "n d"],
    valid: Bool[Array, " n"] | None = None,
    *,
    size: int = TILE_SIZE,
) -> Tiles:
    """Halve the points along the principal axis of each part until `size` are left.

    There are 2^depth tiles, for the smallest depth that does. Consecutive tiles come
    from one part, so tiles 0 and 1, 0 to 3, 0 to 7, ... form larger compact groups.

    Args:
        points: rows of one Euclidean space in which tiles are to be compact.
        valid: points that get a slot; all when absent. Points that are not finite never
            do.
        size: points of a tile, at most.

    Raises:
        ValueError: there are no points, or size is below 1.
    """
    n = len(points)
    if n < 1 or size < 1:
        raise ValueError(
            f"tiles: size is {size}, there are {n} points; both must be 1 or more"
        )
    depth = max(-(-n // size) - 1, 0).bit_length()
    valid = jnp.ones(n, bool) if valid is None else valid
    valid = valid & jnp.isfinite(points).all(1)
    count = jnp.maximum(valid.sum(), 1)
    # Slots beyond the valid points repeat some, scattered over all.
    slot = jnp.arange(-(-n // 2**depth) * 2**depth)
    repeated = (slot - count) * 7919 % count
    member = jnp.argsort(~valid)[jnp.where(slot < count, slot, repeated)]
    own = (slot < count) & valid[member]
    placed = jnp.where(valid[:, None], points, 0)[member]
    cell = jnp.arange(2**depth)

    def halve(level, order):
        # At each level a part is a run of cells, one for each tile it will become. So
        # all levels have equal shapes, and one loop compiles for all of them.
        part = cell >> (depth - level)
        cells = placed[order].reshape(len(cell), -1, points.shape[1])
        along = _along_axis(cells, part, POWER_ITERATIONS)
        part_of_slot = jnp.broadcast_to(part[:, None], along.shape).ravel()
        return jax.lax.sort((part_of_slot, along.ravel(), order), num_keys=2)[2]

    order = jax.lax.fori_loop(0, depth, halve, varying_as(slot, placed))
    order = order.reshape(len(cell), -1)
    return Tiles(member[order].astype(jnp.int32), own[order])


@jit(static_argnames="size")
def spectral_tiles(
    spec: Spectrum,
    *,
    size: int = TILE_SIZE,
) -> Tiles:
    """Tiles of a shape's vertices, compact on its surface; padding gets no slot.

    A vertex is placed by eigenfunctions over the square roots of their eigenvalues (the
    commute-time embedding), which do not depend on the pose. The signs of eigenvectors
    do not matter.

    Args:
        size: vertices of a tile, at most.

    Raises:
        ValueError: size is below 1.
    """
    num = TILE_EIGENPAIRS
    evals = spec.evals[1:num]
    points = spec.evecs[:, 1:num] / jnp.sqrt(jnp.maximum(evals, 1e-6))[None]
    return tiles(points, spec.mass > 0, size=size)


def tiles_of_pair(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Tiles, Tiles]:
    """`spectral_tiles` of both shapes, compiled once if their sizes are equal."""
    return map_sides(spectral_tiles, (spec_x,), (spec_y,))


def _along_axis(
    points: Float[Array, "c m d"], part: Int[Array, " c"], power_iterations: int
):
    """Coordinate of each point along the principal axis of the part of its cell."""

    def over_part(values, reduce=jax.ops.segment_sum):
        return reduce(values, part, len(part), indices_are_sorted=True)[part]

    count = over_part(jnp.full(len(part), points.shape[1], points.dtype))
    centred = points - (over_part(points.sum(1)) / count[:, None])[:, None]
    # The power iterations start from the point farthest from the mean.
    square = jnp.sum(centred**2, 2)
    farthest = square == over_part(square.max(1), jax.ops.segment_max)[:, None]
    slot = jnp.arange(square.size).reshape(square.shape)
    first = jnp.where(farthest, slot, square.size - 1).min(1)
    first = over_part(first, jax.ops.segment_min)
    axis = centred.reshape(-1, points.shape[2])[first]

    def iterate(_, axis):
        # Unit length: powers of small numbers would underflow.
        norm = jnp.sqrt(jnp.sum(axis**2, 1, keepdims=True))
        axis = axis / jnp.where(norm > 0, norm, 1)
        along = einsum("cmd,cd->cm", centred, axis)
        return over_part(einsum("cmd,cm->cd", centred, along))

    axis = jax.lax.fori_loop(0, power_iterations, iterate, axis)
    return einsum("cmd,cd->cm", centred, axis)
