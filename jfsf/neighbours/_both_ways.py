"""Neighbours in both directions: from one product, or among tiles if they are given.

Only the best point of each bin of points is kept, as in the approximate top-k of
accelerators (Chern et al., NeurIPS 2022, "TPU-KNN"). Memory is O(n k0).
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.array import top_k
from jfsf.array._jit import jit
from jfsf.array._sequential_vmap import sequential_vmap
from jfsf.array._sides import map_sides
from jfsf.array._top_k import TOP_K_LIMIT, max_with_index
from jfsf.neighbours._among_tiles import tiled_neighbours
from jfsf.neighbours._exhaustive import (
    check_point_sets,
    float32_frame,
    inner_products,
    measure_distances,
    neighbours_of_valid,
    pad_rows,
    valid_rows,
)
from jfsf.neighbours._search import NeighbourSearch, NeighbourSettings
from jfsf.types import Neighbours, NeighboursBothWays

UNREACHABLE = (
    1e30  # a squared distance above all others; `max_with_index` needs it finite
)


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
        The neighbours; without tiles recall is 1 and searched_all is true.

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
    one = jnp.ones((), near_xy.dist.dtype)
    return NeighboursBothWays(near_xy, near_yx, one, jnp.ones((), bool))


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

    The nearest is found, as exactly as `jfsf.neighbours` tells points apart. Of the
    others, on average one in 2 `bins` or fewer is replaced by a farther one. In a set
    of fewer than 2 `bins` k0 points, padding included, none is; nor is any when k0 is
    above 32 (`TOP_K_LIMIT`), because each direction is then searched on its
    own. Memory is O(n k0): `bins` to 2 `bins` numbers for each neighbour.

    Args:
        x, y: rows of one Euclidean space.
        valid_x, valid_y: points that take part; all when absent.
        k0: neighbours of a point, at most the number of points in the smaller set.
        settings: `bins` and `product_rows` are read, or `margin` for k0 above 32.

    Returns:
        As `neighbours`, except that the order is that of float32 distances, which
        differ by up to about 1e-4 of themselves. A point that is not valid or not
        finite has no neighbours.

    Raises:
        ValueError: widths differ, or k0 is not in 1..min(n, m).
    """
    check_point_sets("mutual_neighbours", x, y, k0)
    x, valid_x = valid_rows(x, valid_x)
    y, valid_y = valid_rows(y, valid_y)
    if k0 > TOP_K_LIMIT:
        sides = (x, y, valid_x, valid_y), (y, x, valid_y, valid_x)
        return map_sides(partial(neighbours_of_valid, k0=k0, settings=settings), *sides)
    find = sequential_vmap(partial(_indices, k0=k0, settings=settings))
    idx_xy, idx_yx = find(*jax.lax.stop_gradient((x, y)), valid_x, valid_y)
    return (
        measure_distances(x, idx_xy, y, valid_x, valid_y),
        measure_distances(y, idx_yx, x, valid_y, valid_x),
    )


def _indices(
    x: Array,
    y: Array,
    valid_x: Array,
    valid_y: Array,
    *,
    k0: int,
    settings: NeighbourSettings,
):
    """Indices of `mutual_neighbours`; those of rows that fill a block are n or more."""
    num_rows = settings.product_rows
    scaled = float32_frame(y, valid_y, x)
    # Points of a bin, for x and for y.
    bin_x, bin_y = (_bin_size(len(points), k0, settings) for points in (x, y))

    def prepared(points, valid):
        fast = scaled(points)
        offset = jnp.where(valid, 0.5 * jnp.sum(fast**2, 1), UNREACHABLE)
        return pad_rows(fast, num_rows), pad_rows(offset, num_rows, UNREACHABLE)

    fast_x, offset_x = prepared(x, valid_x)
    fast_y, offset_y = prepared(y, valid_y)
    # Points close on a mesh are often close in its file, and must not share a bin. So
    # row r of block b is point r * blocks + b, and the points of a bin of y are equally
    # spaced, too.
    blocks, width = len(fast_x) // num_rows, fast_x.shape[1]
    strided = fast_x.reshape(num_rows, blocks, width).swapaxes(0, 1)

    def block(args):
        rows, offset = args
        product = inner_products(rows, fast_y)
        # Squared distances times -1/2: an index in the last bits then costs those of
        # near points least.
        score = product - offset_y[None] - offset[:, None]
        best_y = max_with_index(score.reshape(num_rows, bin_y, -1), 1)
        best_x = max_with_index(score.reshape(bin_x, -1, len(fast_y)), 0)
        bin_idx, member = _top_bins(best_y.T, k0, bin_y)
        return (member * best_y.shape[1] + bin_idx).T, best_x

    offset_x = offset_x.reshape(num_rows, blocks).T
    idx_xy, best_x = jax.lax.map(block, (strided, offset_x))
    idx_xy = idx_xy.swapaxes(0, 1).reshape(-1, k0)[: len(x)]
    bins = num_rows // bin_x  # of a block
    columns = best_x.reshape(blocks * bins, -1)

    def best_of_columns(at):
        some = jax.lax.dynamic_slice_in_dim(columns, at, num_rows, 1)
        bin_idx, member = _top_bins(some, k0, bin_x)
        return ((member * bins + bin_idx % bins) * blocks + bin_idx // bins).T

    idx_yx = jax.lax.map(best_of_columns, jnp.arange(0, columns.shape[1], num_rows))
    return idx_xy, idx_yx.reshape(-1, k0)[: len(y)]


def _bin_size(n: int, k0: int, settings: NeighbourSettings) -> int:
    """Points of a bin: a power of two that leaves `bins` bins for each neighbour."""
    largest = max(n // (settings.bins * k0), 1)
    return min(1 << largest.bit_length() - 1, settings.product_rows)


def _top_bins(best: Float[Array, "bins n"], k0: int, size: int):
    """The k0 best bins of each column, and which member of each is the best."""
    bin_idx = top_k(best, k0)
    value = jnp.take_along_axis(best, bin_idx, 0)
    return bin_idx, jax.lax.bitcast_convert_type(value, jnp.int32) & (size - 1)
