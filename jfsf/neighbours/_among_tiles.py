"""The k0 nearest neighbours of each point, searched among candidates only.

The rows of aligned embeddings vary smoothly over a surface, so the neighbours of a tile
of X lie in few tiles of Y. For each block of X's tiles: rank Y's tiles by the distance
of their centres, coarse to fine down a tree of groups of tiles; then compare the block
with the points of the best tiles in one small product. Time and memory grow like n; an
exhaustive search takes n^2.

In a refinement the tiles stay and the embeddings change. Each search starts anew from
the tree, so a jump of the map costs nothing and no error is carried over.

A sample of the queries is compared with the exhaustive search. If too few of them have
their nearest neighbour, as for embeddings that are not smooth on the tiles, all points
are compared.

The file is long because the search, its tree and its recall read the same tiles.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.array import argmax
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides, sequential_vmap, varying_as
from jfsf.array._precision import top_k
from jfsf.neighbours._exhaustive import (
    check_k0,
    check_point_sets,
    float32_frame,
    inner_products,
    measure_distances,
    neighbours_of_valid,
    square_norms,
    valid_rows,
)
from jfsf.neighbours._search import BEAM, FAN_OUT, TOLERANCE, NeighbourSettings
from jfsf.types import Neighbours, NeighboursBothWays, Tiles

# These were tuned together (experiments/bench/bench_large.py).
CANDIDATES_PER_NEIGHBOUR = 6  # for each of the k0 neighbours, at least
BLOCK_QUERIES = 64  # queries that share their candidates, at most: whole tiles
RANKING_STRIDE = 2  # one in so many queries of a block ranks the tiles
# Share of a tile's mean square radius that is subtracted from its squared distance,
# because points of a wide tile may be nearer than its centre.
SPREAD = 0.5
# Tiles, or groups of tiles, that are all ranked, at most. More are grouped into a tree.
ROOT_TILES = 64
BLOCKS = 32  # blocks of queries at a time; this does not change results
UNREACHABLE = 1e30  # a squared distance above all others, and finite


@jit(static_argnames=("k0", "min_recall", "settings"))
def tiled_neighbours(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    tiles_x: Tiles,
    tiles_y: Tiles,
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    *,
    k0: int,
    min_recall: float = 0.95,
    settings: NeighbourSettings = NeighbourSettings(),
) -> NeighboursBothWays:
    """The neighbours in y of each x and in x of each y, among candidates.

    Args:
        x, y: rows of one Euclidean space, smooth functions on the two shapes.
        tiles_x, tiles_y: tiles of the rows; a row without a slot takes no part.
        valid_x, valid_y: rows that take part; all in the tiles when absent.
        k0: neighbours of a point, at most the number of points in the smaller set.
        min_recall: estimated recall below which a direction is searched exhaustively.
            With 0 the exhaustive search is left out of the program. Under `vmap` each
            element of the batch has a choice of its own.
        settings: of the search; the tiles are made already.

    Returns:
        Neighbours as from `mutual_neighbours`, in the order of float32 distances. On
        aligned shapes of 1000 to 100 000 vertices 99.6 % or more of the nearest are
        right, and 98 % of the others (experiments/bench/bench_large.py). Distances are
        differentiable.

    Raises:
        ValueError: widths differ, k0 is not in 1..min(n, m), or min_recall is not in
            [0, 1].
    """
    check_point_sets("tiled_neighbours", x=x, y=y)
    check_k0("tiled_neighbours", k0, x, y)
    (near_xy, recall_xy, all_xy), (near_yx, recall_yx, all_yx) = map_sides(
        partial(tiled_one_way, k0=k0, min_recall=min_recall, settings=settings),
        (x, y, tiles_x, tiles_y, valid_x, valid_y),
        (y, x, tiles_y, tiles_x, valid_y, valid_x),
    )
    recall = jnp.fmin(recall_xy, recall_yx)
    return NeighboursBothWays(near_xy, near_yx, recall, all_xy | all_yx)


@jit(static_argnames=("k0", "min_recall", "settings"))
def tiled_one_way(
    queries: Float[Array, "n d"],
    points: Float[Array, "m d"],
    tiles_q: Tiles,
    tiles_p: Tiles,
    valid_q: Bool[Array, " n"] | None = None,
    valid_p: Bool[Array, " m"] | None = None,
    *,
    k0: int,
    min_recall: float = 0.95,
    settings: NeighbourSettings = NeighbourSettings(),
) -> tuple[Neighbours, Float[Array, ""], Bool[Array, ""]]:
    """One direction of `tiled_neighbours`.

    Returns:
        Neighbours of each query, their recall, and whether all points were compared.

    Raises:
        ValueError: min_recall is not in [0, 1], points or k0 do not fit, or tiles of
            fewer points.
    """
    if not 0 <= min_recall <= 1:
        raise ValueError(f"tiled_neighbours: min_recall is {min_recall}, not in [0, 1]")
    check_point_sets("tiled_neighbours", queries=queries, points=points)
    check_k0("tiled_neighbours", k0, points)
    for tiles, rows in ((tiles_q, queries), (tiles_p, points)):
        if tiles.member.size < len(rows):
            raise ValueError(
                f"tiled_neighbours: tiles of {tiles.member.size} points or fewer for "
                f"{len(rows)} rows; are those of X and Y exchanged?"
            )
    queries, valid_q = valid_rows(queries, valid_q)
    points, valid_p = valid_rows(points, valid_p)
    scaled, idx = _search(queries, points, tiles_q, tiles_p, valid_p, k0, settings)
    tiled_q, tiled_p = _tiled(tiles_q, valid_q), _tiled(tiles_p, valid_p)
    recall = _recall(scaled, queries, points, idx, tiles_q, tiled_q, tiled_p, settings)
    searched_all = recall < min_recall
    if min_recall > 0:
        # The choice of indices alone, because jax cannot differentiate through the loop
        # that vmap makes of it. Distances are measured below.
        choose = partial(_all_compared_if, k0=k0)
        args = searched_all, idx, queries, points, tiled_q, tiled_p
        idx = sequential_vmap(choose, everywhere=True)(*jax.lax.stop_gradient(args))
    near = measure_distances(queries, idx, points, valid_q, valid_p)
    return near, jnp.where(searched_all, 1, recall), searched_all


def _all_compared_if(needed, idx, queries, points, valid_q, valid_p, *, k0):
    """Indices of an exhaustive search if it is needed, else `idx`.

    Where there is no neighbour the index is the number of points.
    """

    def exhaustive():
        near = neighbours_of_valid(queries, points, valid_q, valid_p, k0=k0)
        return jnp.where(jnp.isfinite(near.dist), near.idx, len(points))

    read = queries, points, valid_q, valid_p
    idx = varying_as(idx, read)
    return jax.lax.cond(needed, exhaustive, lambda: idx)


def _tiled(tiles: Tiles, valid):
    """Which valid points have a slot in the tiles."""
    return valid & jnp.zeros(len(valid), bool).at[tiles.member].max(tiles.valid)


def _search(
    queries: Array,
    points: Array,
    tiles_q: Tiles,
    tiles_p: Tiles,
    valid_p: Array,
    k0: int,
    settings: NeighbourSettings,
):
    """`float32_frame` of the points, and indices of the k0 nearest candidates.

    An index is the number of points if there is no such candidate, as
    `measure_distances` expects.
    """
    slot_valid = tiles_p.valid & valid_p[tiles_p.member]
    no_point = len(points)
    member = jnp.where(slot_valid, tiles_p.member, no_point)
    queries, points = jax.lax.stop_gradient((queries, points))
    total, size = slot_valid.shape
    points = jnp.where(slot_valid.reshape(-1, 1), points[tiles_p.member.ravel()], 0)
    scaled = float32_frame(points, slot_valid.ravel(), queries)
    queries, points = scaled(queries), scaled(points).reshape(total, size, -1)
    levels = _tree(points, slot_valid)
    candidates = CANDIDATES_PER_NEIGHBOUR * k0
    kept = min(max(settings.tiles, -(-candidates // size)), total)
    # Tiles are ordered by rank, so tiles i and i + kept / 2 rarely both hold neighbours
    # of a query. That allows bins of two in `top_k`.
    folds = 2 if kept < total and kept * size >= 2 * candidates else 1
    # A block is a run of tiles of the queries. Runs of a power of two are compact.
    group = max(BLOCK_QUERIES // tiles_q.member.shape[1], 1)
    group = min(1 << (group.bit_length() - 1), len(tiles_q.member))
    rows = tiles_q.member.reshape(-1, group * tiles_q.member.shape[1])

    def block(rows):
        # Differences from the mean of the block keep digits that float32 would cancel.
        block_queries = queries[rows]
        mean = block_queries.mean(0, keepdims=True)
        block_queries = block_queries - mean
        ranking = queries[rows[::RANKING_STRIDE]]
        best = _best_tiles(ranking, levels, kept)
        block_points = points[best].reshape(-1, points.shape[2]) - mean
        offset = square_norms(block_points) / 2
        offset = jnp.where(slot_valid[best].ravel(), offset, UNREACHABLE)
        # Points as rows, queries as columns: maxima over points then vectorise.
        score = inner_products(block_points, block_queries) - offset[:, None]
        score -= square_norms(block_queries)[None] / 2
        return member[best].ravel()[top_k(score, k0, folds)].T

    near = jax.lax.map(block, rows, batch_size=min(BLOCKS, len(rows)))
    at = jnp.where(tiles_q.valid, tiles_q.member, len(queries)).ravel()
    # A query without a slot has no neighbours.
    idx = jnp.full((len(queries), k0), no_point, jnp.int32)
    return scaled, idx.at[at].set(near.reshape(-1, k0), mode="drop")


def _tree(points, valid):
    """(centres, offsets) of tiles, of groups of tiles, and so on up to the root.

    The squared distance of a query q from a centre c is offset - 2 c . q, less `SPREAD`
    and up to |q|^2, which is the same for all centres.
    """
    weight = valid.astype(points.dtype)
    count = weight.sum(1)
    share = weight / jnp.maximum(count, 1)[:, None]
    centre = jnp.sum(points * share[:, :, None], 1)
    square = jnp.sum(square_norms(points - centre[:, None]) * share, 1)
    levels = [(centre, square, count)]
    while len(centre) > ROOT_TILES:
        children, square, count = (
            a.reshape(-1, FAN_OUT, *a.shape[1:]) for a in (centre, square, count)
        )
        total = count.sum(1)
        share = count / jnp.maximum(total, 1)[:, None]
        centre = jnp.sum(children * share[:, :, None], 1)
        apart = square_norms(children - centre[:, None])
        square, count = jnp.sum((square + apart) * share, 1), total
        levels.append((centre, square, count))

    def offset(centre, square, count):
        # An empty tile is never near.
        nearer = SPREAD * square
        return jnp.where(count > 0, square_norms(centre) - nearer, UNREACHABLE)

    return [(level[0], offset(*level)) for level in levels]


def _best_tiles(rows, levels, kept: int):
    """The `kept` tiles nearest to any of the rows by their centres, coarse to fine."""
    fan_out, beam = FAN_OUT, BEAM

    def nearest(centres, offsets, num):
        dist = offsets[:, None] - 2 * inner_products(centres, rows)
        # By how much a centre is farther than the nearest of the row. So all rows count
        # alike, however far each is from the other shape.
        excess = jnp.min(dist - dist.min(0, keepdims=True), 1)
        return jax.lax.top_k(-excess, min(num, len(excess)))[1]

    *lower, (centres, offsets) = levels
    at = nearest(centres, offsets, beam if lower else kept)
    for depth in reversed(range(len(lower))):
        children = (a.reshape(-1, fan_out, *a.shape[1:])[at] for a in lower[depth])
        centres, offsets = (a.reshape(-1, *a.shape[2:]) for a in children)
        best = nearest(centres, offsets, beam if depth else kept)
        at = at[best // fan_out] * fan_out + best % fan_out
    return at


def _recall(
    scaled,
    queries,
    points,
    idx,
    tiles_q: Tiles,
    valid_q,
    valid_p,
    settings: NeighbourSettings,
):
    """Share of a sample of the queries that have their nearest in `idx`.

    The sample is spread evenly over the tiles, so over the shape. nan if none of it has
    a neighbour.
    """
    slots = tiles_q.member.size
    checked = min(settings.checked, slots)
    at = tiles_q.member.ravel()[jnp.arange(checked) * (slots // checked)]
    queries, points, valid_q, idx = jax.lax.stop_gradient(
        (queries[at], points, valid_q[at], idx[at, :1])
    )
    given = measure_distances(queries, idx, points, valid_q, valid_p)
    points, valid_p = valid_rows(points, valid_p)
    fast_q, fast_p = scaled(queries), scaled(points)
    offset = jnp.where(valid_p, square_norms(fast_p) / 2, UNREACHABLE)
    best = argmax(inner_products(fast_p, fast_q) - offset[:, None], 0)[:, None]
    every = jnp.ones(len(at), bool)
    exact = measure_distances(queries, best, points, every, valid_p)
    dist, exact = given.dist[:, 0], exact.dist[:, 0]
    known = jnp.isfinite(dist) & jnp.isfinite(exact)
    right = known & (dist <= exact * (1 + TOLERANCE))
    right, count = jnp.sum(right).astype(dist.dtype), jnp.sum(known)
    share = right / jnp.maximum(count, 1).astype(dist.dtype)
    return jnp.where(count > 0, share, jnp.nan)
