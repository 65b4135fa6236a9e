"""The k0 nearest neighbours of every point, searched among candidates only.

The rows of an aligned embedding vary smoothly over a surface, so the neighbours of a
whole tile of X lie in few tiles of Y. For each block of X's tiles: rank Y's tiles by
the distance of their centres, coarse to fine down the tree that they form, and compare
the block with the points of the best `TILES` by one small product. Work and memory grow
like n; an exhaustive search takes n^2.

Inside a refinement the tiles stay and the embeddings change, so every round starts from
where the last one was without depending on it: a map that jumps costs nothing, and no
error carries over.

A sample of the rows is compared with the exhaustive search. Where too few of them have
their nearest neighbour, as for embeddings that are not smooth on the tiles, the
exhaustive search answers.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.knn import (
    check_sets,
    common_frame,
    exhaustive,
    inner_products,
    selectable,
    square_norms,
    with_distances,
)
from jfsf.largest import leader, leaders
from jfsf.sides import both
from jfsf.types import Found, Neighbours, Tiles

TILES = 28  # tiles whose points are compared with a block; even, see `folds`
A_NEIGHBOUR = 6  # candidates a neighbour at least, for many neighbours
ROWS = 64  # queries a block, at most
CENTRES = 64  # so many are ranked at once where the way down the tree begins, or fewer
FAN = 8  # children of a group in that tree
BEAM = 24  # groups whose children are ranked next
SPREAD = 0.5  # share of a tile's mean square radius by which it counts as nearer
EVERY = 2  # queries of a block, of which one ranks the tiles
BLOCKS = 32  # at a time
CHECKED = 64  # rows of each shape that are compared with the exhaustive search
# Relative difference of distances that counts for none. Where vertices are denser than
# the map is exact, many are nearly as near as the nearest: at 300 000 the second is
# 0.1 % farther, and to have that one is no reason to compare all with all.
ALIKE = 1e-3
FAR = 1e30  # beyond any score, and finite


@partial(jax.jit, static_argnames=("k0", "least"))
def tiled_neighbours(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    tiles_x: Tiles,
    tiles_y: Tiles,
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    *,
    k0: int,
    least: float = 0.95,
) -> Found:
    """The neighbours in y of each x and in x of each y, among candidates.

    Args:
        x, y: rows of one Euclidean space, smooth functions on the two shapes.
        tiles_x, tiles_y: tiles of the rows; a row outside them takes no part.
        valid_x, valid_y: rows that take part; all in the tiles when absent.
        k0: neighbours a point, at most the number of points in the smaller set.
        least: recall below which a direction is searched exhaustively after all. With 0
            that is left out of the program, as befits `vmap`, which runs both ways.

    Returns:
        Neighbours as from `jfsf.knn.mutual_neighbours`, in order as there; on aligned
        shapes of 1000 to 100 000 vertices 99.6 % or more of the nearest are right, and
        98 % of the others (experiments/bench_large.py). Distances are differentiable.

    Raises:
        ValueError: widths differ, k0 is not in 1..min(n, m), or least not in [0, 1].
    """
    check_sets("tiled_neighbours", x, y, k0)
    (near_xy, recall_xy), (near_yx, recall_yx) = both(
        partial(tiled_one_way, k0=k0, least=least),
        (x, y, tiles_x, tiles_y, valid_x, valid_y),
        (y, x, tiles_y, tiles_x, valid_y, valid_x),
    )
    recall = jnp.fmin(recall_xy, recall_yx)  # the worse direction counts
    return Found(near_xy, near_yx, recall, recall < least)


@partial(jax.jit, static_argnames=("k0", "least"))
def tiled_one_way(
    queries: Float[Array, "n d"],
    points: Float[Array, "m d"],
    tiles_q: Tiles,
    tiles_p: Tiles,
    valid_q: Bool[Array, " n"] | None = None,
    valid_p: Bool[Array, " m"] | None = None,
    *,
    k0: int,
    least: float = 0.95,
) -> tuple[Neighbours, Float[Array, ""]]:
    """The neighbours of each query and their recall; as `tiled_neighbours`."""
    if not 0 <= least <= 1:
        raise ValueError(f"tiled_neighbours: least is {least}, not in [0, 1]")
    queries, valid_q = selectable(queries, valid_q)
    points, valid_p = selectable(points, valid_p)
    scaled, idx = _search(queries, points, tiles_q, tiles_p, valid_p, k0)
    near = with_distances(queries, idx, points, valid_q, valid_p)
    inside_q, inside_p = _inside(tiles_q, valid_q), _inside(tiles_p, valid_p)
    recall = _recall(scaled, queries, points, near, tiles_q, inside_p)
    if least > 0:
        near = jax.lax.cond(
            recall < least,
            lambda: exhaustive(queries, points, inside_q, inside_p, k0=k0),
            lambda: near,
        )
    return near, recall


def _inside(tiles: Tiles, valid):
    return valid & jnp.zeros(len(valid), bool).at[tiles.member].max(tiles.real)


def _search(queries, points, tiles_q: Tiles, tiles_p: Tiles, valid: Array, k0: int):
    """A frame for float32 and, found there, the k0 nearest candidates of each query."""
    real = tiles_p.real & valid[tiles_p.member]
    # What `with_distances` knows to be no point, where a block has too few.
    nothing = len(points)
    member = jnp.where(real, tiles_p.member, nothing)
    queries, points = jax.lax.stop_gradient((queries, points))
    total, size = real.shape
    points = jnp.where(real.reshape(-1, 1), points[tiles_p.member.ravel()], 0)
    scaled = common_frame(points, real.ravel())
    queries, points = scaled(queries), scaled(points).reshape(total, size, -1)
    levels = _centres(points, real)
    kept = min(max(TILES, -(-A_NEIGHBOUR * k0 // size)), total)
    # Tiles come best first, so of tiles i and i + kept / 2 the second is rarely near.
    folds = 2 if kept < total and kept * size >= 2 * A_NEIGHBOUR * k0 else 1
    group = max(ROWS // tiles_q.member.shape[1], 1)
    group = min(1 << (group.bit_length() - 1), len(tiles_q.member))
    rows = tiles_q.member.reshape(-1, group * tiles_q.member.shape[1])

    def block(rows):
        # Differences from a point nearby keep what float32 would cancel.
        near = queries[rows]
        middle = near.mean(0, keepdims=True)
        near = near - middle
        best = _descend(queries[rows[::EVERY]], levels, kept)
        around = points[best].reshape(-1, points.shape[2]) - middle
        offset = jnp.where(real[best].ravel(), square_norms(around) / 2, FAR)
        # Points down, queries across: maxima then vectorise.
        score = inner_products(around, near) - offset[:, None]
        score -= square_norms(near)[None] / 2
        return member[best].ravel()[leaders(score, k0, folds)].T

    found = jax.lax.map(block, rows, batch_size=min(BLOCKS, len(rows)))
    at = jnp.where(tiles_q.real, tiles_q.member, len(queries)).ravel()
    # A query in no tile has none.
    idx = jnp.full((len(queries), k0), nothing, jnp.int32)
    return scaled, idx.at[at].set(found.reshape(-1, k0), mode="drop")


def _centres(points, real):
    """(centre, offset) of tiles, of groups of `FAN` tiles, and so on up.

    How far a query is from a centre is offset - 2 centre . query, up to what all
    centres share; `SPREAD` is in the offset.
    """
    weight = real.astype(points.dtype)
    count = weight.sum(1)
    share = weight / jnp.maximum(count, 1)[:, None]
    centre = jnp.sum(points * share[:, :, None], 1)
    square = jnp.sum(square_norms(points - centre[:, None]) * share, 1)
    levels = [(centre, square, count)]
    while len(centre) > CENTRES:
        inner, square, count = (
            a.reshape(-1, FAN, *a.shape[1:]) for a in (centre, square, count)
        )
        total = count.sum(1)
        share = count / jnp.maximum(total, 1)[:, None]
        centre = jnp.sum(inner * share[:, :, None], 1)
        apart = square_norms(inner - centre[:, None])
        square, count = jnp.sum((square + apart) * share, 1), total
        levels.append((centre, square, count))

    def offset(centre, square, count):
        # An empty tile is as far as can be.
        return jnp.where(count > 0, square_norms(centre) - SPREAD * square, FAR)

    return [(level[0], offset(*level)) for level in levels]


def _descend(rows, levels, kept: int):
    """The `kept` tiles that look nearest to some of the rows, coarse to fine."""

    def nearest(centres, offsets, num):
        dist = offsets[:, None] - 2 * inner_products(centres, rows)
        # How much farther than the row's own best: all rows count alike, however far
        # they are from the other shape.
        excess = jnp.min(dist - dist.min(0, keepdims=True), 1)
        return jax.lax.top_k(-excess, min(num, len(excess)))[1]

    *lower, (centres, offsets) = levels
    at = nearest(centres, offsets, BEAM if lower else kept)
    for depth in reversed(range(len(lower))):
        families = (a.reshape(-1, FAN, *a.shape[1:])[at] for a in lower[depth])
        centres, offsets = (a.reshape(-1, *a.shape[2:]) for a in families)
        best = nearest(centres, offsets, BEAM if depth else kept)
        at = at[best // FAN] * FAN + best % FAN
    return at


def _recall(scaled, queries, points, near: Neighbours, tiles_q: Tiles, valid_p):
    """Share of a sample of the queries that have their nearest; nan without any.

    The sample is spread over the tiles, so over the shape.
    """
    points, valid_p = selectable(points, valid_p)
    slots = tiles_q.member.size
    slot = jnp.arange(min(CHECKED, slots)) * (slots // min(CHECKED, slots))
    at = tiles_q.member.ravel()[slot]
    fast_q, fast_p = jax.lax.stop_gradient((scaled(queries[at]), scaled(points)))
    offset = jnp.where(valid_p, square_norms(fast_p) / 2, FAR)
    idx = leader(inner_products(fast_p, fast_q) - offset[:, None], 0)[:, None]
    every = jnp.ones(len(at), bool)
    exact = with_distances(queries[at], idx, points, every, valid_p)
    dist, exact = near.dist[at, 0], exact.dist[:, 0]
    known = jnp.isfinite(dist) & jnp.isfinite(exact)
    right = jnp.sum(known & (dist <= exact * (1 + ALIKE))).astype(dist.dtype)
    rows = jnp.sum(known)
    share = right / jnp.maximum(rows, 1).astype(dist.dtype)
    return jnp.where(rows > 0, share, jnp.nan)
