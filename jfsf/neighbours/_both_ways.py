"""Neighbours in both directions: from one product, or among tiles if they are given.

Of each bin of points the best two are kept, where the approximate top-k of accelerators
keeps one (Chern et al., NeurIPS 2022, "TPU-KNN"), and of all others the best score. It
tells which rows have all their neighbours. The few that may not are searched among all
points, so the result is exact. The approximate search is there too, if it is asked for
(`NeighbourSettings.bins`). Memory is O(n k0).
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.array._jit import jit
from jfsf.array._loops import map_sides, sequential_vmap, varying_as
from jfsf.array._precision import TOP_K_LIMIT, top_k, with_index
from jfsf.neighbours._among_tiles import tiled_neighbours
from jfsf.neighbours._exhaustive import (
    MARGIN,
    ROWS,
    check_k0,
    check_point_sets,
    float32_frame,
    inner_products,
    measure_distances,
    neighbours,
    neighbours_of_valid,
    pad_rows,
    valid_rows,
)
from jfsf.neighbours._search import TOLERANCE, NeighbourSearch, NeighbourSettings
from jfsf.types import Neighbours, NeighboursBothWays

# A squared distance above all others; `with_index` needs it finite.
UNREACHABLE = 1e30
# Bins for each neighbour, at least; twice as many at most. On two surfaces of 6890
# points some 2 % of the rows, with k0 = 20, are searched again.
BINS = 8
# Scores are told apart if they differ by this share: an index is in their last bits.
TOLD_APART = 2.0**-12


@jit(static_argnames="k0")
def neighbours_both_ways(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    k0: int,
) -> NeighboursBothWays:
    """The neighbours in y of each x and in x of each y.

    Args:
        x, y: rows of one Euclidean space.
        valid_x, valid_y: points that take part; all when absent.
        search: with tiles of x and of y `tiled_neighbours` searches among candidates;
            without, or when absent, `mutual_neighbours` compares all points.
        k0: neighbours of a point, at most the number of points in the smaller set.

    Returns:
        The neighbours; without tiles searched_all is true, and all are found, but with
        `bins`.

    Raises:
        ValueError: widths differ, or k0 is not in 1..min(n, m).
    """
    search = NeighbourSearch() if search is None else search
    options = {"k0": k0, "settings": search.settings}
    if search.tiles is not None:
        recall = search.min_recall
        return tiled_neighbours(
            x, y, *search.tiles, valid_x, valid_y, min_recall=recall, **options
        )
    near_xy, near_yx = mutual_neighbours(x, y, valid_x, valid_y, **options)
    recall = jnp.ones((), near_xy.dist.dtype)
    if search.settings.bins is not None:
        sides = (near_xy, x, y, valid_y), (near_yx, y, x, valid_x)
        recall = jnp.fmin(*map_sides(partial(_recall, **options), *sides))
    return NeighboursBothWays(near_xy, near_yx, recall, jnp.ones((), bool))


@jit(static_argnames=("k0", "settings"))
def mutual_neighbours(
    x: Float[Array, "n k"],
    y: Float[Array, "m k"],
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    *,
    k0: int,
    settings: NeighbourSettings = NeighbourSettings(),
) -> tuple[Neighbours, Neighbours]:
    """The neighbours in y of each x and in x of each y, at the cost of one product.

    They are those of `jfsf.neighbours`, each way, but with `bins`. With k0 + `MARGIN`
    above `TOP_K_LIMIT` each direction is searched on its own.

    Args:
        x, y: rows of one Euclidean space.
        valid_x, valid_y: points that take part; all when absent.
        k0: neighbours of a point, at most the number of points in the smaller set.
        settings: `bins` is read.

    Returns:
        As `neighbours`; with `bins` they come in the order of float32 distances, which
        differ by up to 1e-4 of themselves. A point that is not valid or not finite has
        no neighbours.

    Raises:
        ValueError: widths differ, or k0 is not in 1..min(n, m).
    """
    check_point_sets("mutual_neighbours", x=x, y=y)
    check_k0("mutual_neighbours", k0, x, y)
    x, valid_x = valid_rows(x, valid_x)
    y, valid_y = valid_rows(y, valid_y)
    exact = settings.bins is None
    if k0 + (MARGIN if exact else 0) > TOP_K_LIMIT:
        sides = (x, y, valid_x, valid_y), (y, x, valid_y, valid_x)
        return map_sides(partial(neighbours_of_valid, k0=k0), *sides)
    find = sequential_vmap(partial(_indices, k0=k0, settings=settings))
    idx_xy, idx_yx = find(*jax.lax.stop_gradient((x, y)), valid_x, valid_y)
    near_xy = measure_distances(x, idx_xy, y, valid_x, valid_y)
    near_yx = measure_distances(y, idx_yx, x, valid_y, valid_x)
    if not exact:
        return near_xy, near_yx
    return _nearest_of(near_xy, k0), _nearest_of(near_yx, k0)


def _recall(near: Neighbours, queries, points, valid_p, *, k0: int, settings):
    """Share of the neighbours that were found, of a sample of the queries."""
    checked = min(settings.checked, len(queries))
    at = jnp.arange(checked) * (len(queries) // checked)
    given = jax.lax.stop_gradient(near.dist[at])
    some, points = jax.lax.stop_gradient((queries[at], points))
    exact = neighbours(some, points, valid_p, k0=k0).dist
    there = jnp.isfinite(exact) & jnp.isfinite(given[:, :1])
    farthest = jnp.where(there, exact, 0).max(1, keepdims=True)
    found = there & (given <= farthest * (1 + TOLERANCE))
    share, total = (jnp.sum(a).astype(given.dtype) for a in (found, there))
    return share / total


def _nearest_of(near: Neighbours, k0: int) -> Neighbours:
    """The nearest k0 of these neighbours, ties to the lower index."""
    idx = near.idx
    places = jax.lax.broadcasted_iota(jnp.int32, idx.shape, 1)
    keys = jax.lax.stop_gradient((near.dist, near.idx))
    order = jax.lax.sort((*keys, places), num_keys=2)[2][:, :k0]
    return Neighbours(*(jnp.take_along_axis(a, order, 1) for a in near))


def _indices(
    x: Array,
    y: Array,
    valid_x: Array,
    valid_y: Array,
    *,
    k0: int,
    settings: NeighbourSettings,
):
    """Indices of k0 points or a few more for each x and each y, the nearest k0 among
    them. Where there is no such point the index is n or more.
    """
    exact = settings.bins is None
    scaled = float32_frame(y, valid_y, x)

    def prepared(points, valid):
        fast = scaled(points)
        offset = jnp.where(valid, 0.5 * jnp.sum(fast**2, 1), UNREACHABLE)
        return pad_rows(fast, ROWS), pad_rows(offset, ROWS, UNREACHABLE)

    fast_x, offset_x = prepared(x, valid_x)
    fast_y, offset_y = prepared(y, valid_y)
    # Points of a bin, for x and for y.
    bins = BINS if settings.bins is None else settings.bins
    bin_x, bin_y = (_bin_size(len(points), bins * k0) for points in (x, y))
    num = min(k0 + MARGIN, len(x), len(y)) if exact else k0
    choose = partial(_chosen, k0=k0, num=num)
    best = _best_two if exact else _best
    # Points close on a mesh are often close in its file, and must not share a bin. So
    # row r of block b is point r * blocks + b, and the points of a bin of y are equally
    # spaced, too.
    blocks, width = len(fast_x) // ROWS, fast_x.shape[1]
    strided = fast_x.reshape(ROWS, blocks, width).swapaxes(0, 1)

    def block(args):
        rows, offset = args
        product = inner_products(rows, fast_y)
        # Squared distances times -1/2: an index in the last bits then costs those of
        # near points least.
        score = product - offset_y[None] - offset[:, None]
        bins_of_y = best(score.reshape(ROWS, bin_y, -1), 1)
        bins_of_x = best(score.reshape(bin_x, -1, len(fast_y)), 0)
        bins, member, known = choose(*(a.T for a in bins_of_y), size=bin_y)
        return (member * (len(fast_y) // bin_y) + bins).T, known, bins_of_x

    offset_x = offset_x.reshape(ROWS, blocks).T
    idx_xy, known_x, bins_of_x = jax.lax.map(block, (strided, offset_x))
    per_block = ROWS // bin_x
    bins_of_x = [a.reshape(blocks * per_block, -1) for a in bins_of_x]

    def columns(at):
        some = (jax.lax.dynamic_slice_in_dim(a, at, ROWS, 1) for a in bins_of_x)
        bins, member, known = choose(*some, size=bin_x)
        row = member * per_block + bins % per_block
        return (row * blocks + bins // per_block).T, known

    idx_yx, known_y = jax.lax.map(columns, jnp.arange(0, len(fast_y), ROWS))
    idx_xy = idx_xy.swapaxes(0, 1).reshape(-1, num)[: len(x)]
    idx_yx = idx_yx.reshape(-1, num)[: len(y)]
    if not exact:
        return idx_xy, idx_yx
    known_x, known_y = known_x.T.ravel()[: len(x)], known_y.ravel()[: len(y)]
    return (
        _repaired(idx_xy, known_x, x, y, valid_y),
        _repaired(idx_yx, known_y, y, x, valid_x),
    )


def _bin_size(n: int, bins: int) -> int:
    """Points of a bin: a power of two that leaves so many bins, if there are."""
    largest = max(n // bins, 1)
    return min(1 << largest.bit_length() - 1, ROWS)


def _best(score: Array, axis: int) -> tuple[Array]:
    """The largest score along an axis, its index in the last bits.

    The length of the axis is a power of two.
    """
    index = jax.lax.broadcasted_iota(jnp.int32, score.shape, axis)
    return (with_index(score, index, score.shape[axis]).max(axis),)


def _best_two(score: Array, axis: int) -> tuple[Array, Array, Array]:
    """The two largest scores along an axis, and the largest of the others.

    The last bits of a score are its index; the length of the axis is a power of two.
    """
    index = jax.lax.broadcasted_iota(jnp.int32, score.shape, axis)
    key = with_index(score, index, score.shape[axis])

    def below(value):
        value = jnp.expand_dims(value, axis)
        return jnp.where(key < value, key, -8 * UNREACHABLE).max(axis)

    first = key.max(axis)
    second = below(first)
    return first, second, below(second)


def _chosen(first, *others, k0: int, num: int, size: int):
    """The `num` largest of the best scores of the bins of each column.

    Args:
        first: of each bin.
        others: with `_best_two`, the second of each bin, and the best of all others.

    Returns:
        Their bins and their indices in these, and for each column whether the k0
        largest of all its points are surely among them.
    """
    best = jnp.concatenate([first, *others[:1]])
    at = top_k(best, num)
    value = jnp.take_along_axis(best, at, 0)
    # The largest of all others is not above this.
    left = jnp.maximum(value[-1], others[-1].max(0)) if others else value[-1]
    known = value[k0 - 1] * (1 + TOLD_APART) >= left
    known |= left <= -UNREACHABLE / 2  # they are no points
    member = jax.lax.bitcast_convert_type(value, jnp.int32) & (size - 1)
    return at % len(first), member, known


def _repaired(idx, known, queries, points, valid):
    """`idx`, its rows that are not known searched among all points."""
    rows = jnp.nonzero(~known, size=len(known) + ROWS, fill_value=0)[0]

    def search(state):
        at, idx = state
        some = jax.lax.dynamic_slice_in_dim(rows, at, ROWS)
        near = neighbours(queries[some], points, valid, k0=idx.shape[1])
        found = jnp.where(jnp.isfinite(near.dist), near.idx, len(points))
        return at + ROWS, idx.at[some].set(found.astype(idx.dtype))

    more = lambda state: state[0] < jnp.sum(~known)
    start = 0, varying_as(idx, known, queries, points, valid)
    return jax.lax.while_loop(more, search, start)[1]
