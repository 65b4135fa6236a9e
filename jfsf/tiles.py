"""Points -> tiles: compact groups of equal size, made by halving along principal axes.

A tile is what the search among candidates handles at once: its points share candidates,
so a product of two small matrices does what one gather a point would. Tiles are made
once a shape, from coordinates that keep neighbours on the surface close; they depend on
neither pose nor map.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.types import Spectrum, Tiles

SIZE = 16  # points a tile, at most
PAIRS = 60  # eigenpairs that place a vertex: finer detail than a tile only disturbs
TURNS = 3  # power iterations to the principal axis: the longer side is enough


@partial(jax.jit, static_argnames="size")
def tiles(
    points: Float[Array, "n d"],
    valid: Bool[Array, " n"] | None = None,
    *,
    size: int = SIZE,
) -> Tiles:
    """Halve the points along the longest axis of each part until `size` are left.

    2^d tiles for the least d that does; neighbouring numbers are neighbouring parts, so
    that tiles 0 and 1, 0 to 3, 0 to 7 ... make larger compact groups.

    Args:
        points: rows of one Euclidean space in which tiles shall be compact.
        valid: points that may be chosen; all when absent. Points that are not finite
            never are.
        size: points a tile, at most.

    Raises:
        ValueError: there are no points, or size is below 1.
    """
    n = len(points)
    if n < 1 or size < 1:
        raise ValueError(f"tiles: size is {size}, there are {n} points; both must be 1")
    depth = max(-(-n // size) - 1, 0).bit_length()
    valid = jnp.ones(n, bool) if valid is None else valid
    valid = valid & jnp.isfinite(points).all(1)
    count = jnp.maximum(valid.sum(), 1)
    # The slots that hold no point of their own repeat points from all over.
    slot = jnp.arange(-(-n // 2**depth) * 2**depth)
    spread = (slot - count) * 7919 % count
    member = jnp.argsort(~valid)[jnp.where(slot < count, slot, spread)]
    real = (slot < count) & valid[member]
    placed = jnp.where(valid[:, None], points, 0)[member]
    cell = jnp.arange(2**depth)

    def halve(level, order):
        # Parts of different sizes in one loop, for one program: a part is a run of the
        # cells that it will end as.
        part = cell >> (depth - level)
        cells = placed[order].reshape(len(cell), -1, points.shape[1])
        along = _along_axis(cells, part)
        mine = jnp.broadcast_to(part[:, None], along.shape).ravel()
        return jax.lax.sort((mine, along.ravel(), order), num_keys=2)[2]

    order = jax.lax.fori_loop(0, depth, halve, slot).reshape(len(cell), -1)
    return Tiles(member[order].astype(jnp.int32), real[order])


@partial(jax.jit, static_argnames="size")
def spectral_tiles(spec: Spectrum, *, size: int = SIZE) -> Tiles:
    """Tiles of a shape's vertices, compact on its surface; padding is left out.

    Vertices are placed by eigenfunctions over the root of their eigenvalues (the
    commute-time embedding), which neither pose nor signs change.

    Raises:
        ValueError: size is below 1.
    """
    evals = spec.evals[1:PAIRS]
    points = spec.evecs[:, 1:PAIRS] / jnp.sqrt(jnp.maximum(evals, 1e-6))[None]
    return tiles(points, spec.mass > 0, size=size)


def _along_axis(points: Float[Array, "c m d"], part: Int[Array, " c"]):
    """Where each point lies along the principal axis of the part its cell is in."""

    def over_part(values, reduce=jax.ops.segment_sum):
        return reduce(values, part, len(part), indices_are_sorted=True)[part]

    count = over_part(jnp.full(len(part), points.shape[1], points.dtype))
    centred = points - (over_part(points.sum(1)) / count[:, None])[:, None]
    square = jnp.sum(centred**2, 2)
    far = square == over_part(square.max(1), jax.ops.segment_max)[:, None]
    slot = jnp.arange(square.size).reshape(square.shape)
    first = jnp.where(far, slot, square.size - 1).min(1)
    first = over_part(first, jax.ops.segment_min)
    axis = centred.reshape(-1, points.shape[2])[first]

    def turn(_, axis):
        # Unit length: powers of small numbers would vanish.
        norm = jnp.sqrt(jnp.sum(axis**2, 1, keepdims=True))
        axis = axis / jnp.where(norm > 0, norm, 1)
        along = jnp.einsum("cmd,cd->cm", centred, axis)
        return over_part(jnp.einsum("cmd,cm->cd", centred, along))

    axis = jax.lax.fori_loop(0, TURNS, turn, axis)
    return jnp.einsum("cmd,cd->cm", centred, axis)
