"""The k0 nearest neighbours of every point, by exhaustive search in blocks of rows.

Memory is O(n k0) beyond one block of rows; no n_x by n_y array is ever built.
`neighbours` selects in float32 through |q|^2 - 2 q.p + |p|^2, which cancels, so a few
more than k0 are kept and ranked again by the sum of squared differences in the input's
precision. In a tight cluster far from the centre that margin may not suffice: a
neighbour may then be some 0.1 % farther than the nearest.

`mutual_neighbours` answers both directions from one product, and keeps only the best of
each bin of points, as accelerators' approximate top-k does (Chern et al., NeurIPS 2022,
"TPU-KNN").
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.largest import FEW, best_with_place, leaders
from jfsf.sides import both
from jfsf.types import Neighbours
from jfsf.vmap_rule import one_by_one

ROWS = 128  # rows of queries at a time: their scores stay in the cache
GROUP = 16  # points a group, see _select
MARGIN = 3  # candidates beyond k0 that float32 may have misplaced
BINS = 12  # bins a neighbour: one neighbour in some 24 shares a bin with a nearer one
FAR = 1e30  # beyond any score, and unlike inf it survives `best_with_place`


@partial(jax.jit, static_argnames="k0")
def neighbours(
    queries: Float[Array, "n k"],
    points: Float[Array, "m k"],
    valid: Bool[Array, " m"] | None = None,
    *,
    k0: int,
) -> Neighbours:
    """The k0 points nearest to each query, nearest first, ties to the lower index.

    Args:
        queries, points: rows of one Euclidean space.
        valid: points that may be chosen; all when absent.
        k0: neighbours a query, at most the number of points.

    Returns:
        Indices into `points` and distances; where fewer than k0 points are valid the
        rest has index 0 and distance inf. A query that is not finite has no
        neighbours. Distances are differentiable; the slope of a distance 0 is 0.

    Raises:
        ValueError: widths differ, or k0 is not in 1..m.
    """
    if queries.shape[1] != points.shape[1]:
        raise ValueError(
            f"neighbours: queries have {queries.shape[1]} columns, points have "
            f"{points.shape[1]}"
        )
    if not 1 <= k0 <= len(points):
        raise ValueError(f"neighbours: k0 is {k0}, there are {len(points)} points")
    safe, valid = selectable(points, valid)
    # The choice of neighbours is not differentiable; their distances are.
    frozen = jax.lax.stop_gradient(safe)
    scaled = common_frame(frozen, valid)
    fast = scaled(frozen)
    offset = jnp.where(valid, 0.5 * jnp.sum(fast**2, 1), jnp.inf)
    fast, offset = _pad(fast, GROUP), _pad(offset, GROUP, jnp.inf)
    # The rows that fill the last group are no points.
    valid = _pad(valid, GROUP, False)

    def block(rows):
        # Points down, queries across: maxima over groups of points then vectorise.
        score = inner_products(fast, scaled(jax.lax.stop_gradient(rows)))
        near = _select(score - offset[:, None], min(k0 + MARGIN, len(points)))
        dist = _distances(rows, near, safe, valid)
        dist, near = jax.lax.sort((dist, near), num_keys=2)
        dist, near = dist[:, :k0], near[:, :k0]
        return Neighbours(jnp.where(jnp.isfinite(dist), near, 0), dist)

    blocks = _pad(queries, ROWS).reshape(-1, ROWS, queries.shape[1])
    found = jax.lax.map(block, blocks)
    return Neighbours(*(x.reshape(-1, k0)[: len(queries)] for x in found))


@partial(jax.jit, static_argnames="k0")
def mutual_neighbours(
    x: Float[Array, "n k"],
    y: Float[Array, "m k"],
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    *,
    k0: int,
) -> tuple[Neighbours, Neighbours]:
    """The neighbours in y of each x and in x of each y, for one product's cost.

    The nearest is found, as exactly as float32 tells points apart. Of the others about
    one in a hundred is missed for a farther one, none where there are fewer than
    2 `BINS` k0 points, padding counted, nor with k0 above `FEW`: then each direction is
    searched alone. Memory is O(n k0), some `BINS` to 2 `BINS` numbers a neighbour.

    Args:
        x, y: rows of one Euclidean space.
        valid_x, valid_y: points that take part; all when absent.
        k0: neighbours a point, at most the number of points in the smaller set.

    Returns:
        As `neighbours`, in order up to float32, and to some 1e-4 of the distance. A
        point that takes no part has no neighbours.

    Raises:
        ValueError: widths differ, or k0 is not in 1..min(n, m).
    """
    check_sets("mutual_neighbours", x, y, k0)
    x, valid_x = selectable(x, valid_x)
    y, valid_y = selectable(y, valid_y)
    if k0 > FEW:
        sides = (x, y, valid_x, valid_y), (y, x, valid_y, valid_x)
        return both(partial(exhaustive, k0=k0), *sides)
    find = one_by_one(partial(_mutual, k0=k0))
    near_xy, near_yx = find(*jax.lax.stop_gradient((x, y)), valid_x, valid_y)
    return (
        with_distances(x, near_xy, y, valid_x, valid_y),
        with_distances(y, near_yx, x, valid_y, valid_x),
    )


def _mutual(x: Array, y: Array, valid_x: Array, valid_y: Array, *, k0: int):
    """Indices of `mutual_neighbours`."""
    scaled = common_frame(y, valid_y)
    bin_x, bin_y = _bin_size(len(x), k0), _bin_size(len(y), k0)

    def prepared(points, valid):
        fast = scaled(points)
        offset = jnp.where(valid, 0.5 * jnp.sum(fast**2, 1), FAR)
        return _pad(fast, ROWS), _pad(offset, ROWS, FAR)

    fast_x, offset_x = prepared(x, valid_x)
    fast_y, offset_y = prepared(y, valid_y)
    # Points close in a mesh are often close in its file, and must not share a bin: row
    # r of block b is point r * blocks + b, and bins are strided too.
    blocks, width = len(fast_x) // ROWS, fast_x.shape[1]
    strided = fast_x.reshape(ROWS, blocks, width).swapaxes(0, 1)

    def block(args):
        rows, offset = args
        product = inner_products(rows, fast_y)
        # Squared distances times -1/2: what is near loses least when bits are replaced.
        score = product - offset_y[None] - offset[:, None]
        best_y = best_with_place(score.reshape(ROWS, bin_y, -1), 1)
        best_x = best_with_place(score.reshape(bin_x, -1, len(fast_y)), 0)
        which, member = _leaders(best_y.T, k0, bin_y)
        return (member * best_y.shape[1] + which).T, best_x

    near_xy, best_x = jax.lax.map(block, (strided, offset_x.reshape(ROWS, blocks).T))
    near_xy = near_xy.swapaxes(0, 1).reshape(-1, k0)[: len(x)]
    bins = ROWS // bin_x  # a block
    columns = best_x.reshape(blocks * bins, -1)

    def leading(at):
        some = jax.lax.dynamic_slice_in_dim(columns, at, ROWS, 1)
        which, member = _leaders(some, k0, bin_x)
        return ((member * bins + which % bins) * blocks + which // bins).T

    near_yx = jax.lax.map(leading, jnp.arange(0, columns.shape[1], ROWS))
    return near_xy, near_yx.reshape(-1, k0)[: len(y)]


def exhaustive(
    queries: Array, points: Array, valid_q: Array, valid_p: Array, *, k0: int
) -> Neighbours:
    """`neighbours`; a query that takes no part has none."""
    near: Neighbours = neighbours(queries, points, valid_p, k0=k0)
    idx = jnp.where(valid_q[:, None], near.idx, 0).astype(jnp.int32)
    return Neighbours(idx, jnp.where(valid_q[:, None], near.dist, jnp.inf))


def check_sets(function: str, x: Array, y: Array, k0: int) -> None:
    """ValueError in the name of `function` where x, y and k0 do not fit."""
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"{function}: x has {x.shape[1]} columns, y has {y.shape[1]}")
    if not 1 <= k0 <= min(len(x), len(y)):
        raise ValueError(
            f"{function}: k0 is {k0}, there are {len(x)} and {len(y)} points"
        )


def _bin_size(n: int, k0: int) -> int:
    """Points a bin: a power of two that leaves `BINS` bins a neighbour."""
    return min(1 << max(n // (BINS * k0), 1).bit_length() - 1, ROWS)


def _leaders(best: Float[Array, "bins n"], k0: int, size: int):
    """The k0 best bins of each column, and the place of the best inside each."""
    which = leaders(best, k0)
    value = jnp.take_along_axis(best, which, 0)
    return which, jax.lax.bitcast_convert_type(value, jnp.int32) & (size - 1)


def with_distances(queries: Array, near: Array, points: Array, valid_q, valid_p):
    """Indices as Neighbours: distances are measured anew, inf where there is none."""
    # What fills the last block is no point.
    inside = near < len(points)
    near = jnp.where(inside, near, 0)
    # Told without the distances, which nobody may ask for.
    there = inside & valid_q[:, None] & valid_p[near]
    in_blocks = lambda a: _pad(a, ROWS).reshape(-1, ROWS, a.shape[1])
    found = jax.lax.map(
        lambda block: _distances(block[0], block[1], points, valid_p),
        (in_blocks(queries), in_blocks(near)),
    )
    dist = jnp.reshape(found, (-1, near.shape[1]))[: len(queries)]
    return Neighbours(jnp.where(there, near, 0), jnp.where(there, dist, jnp.inf))


def selectable(points: Array, valid) -> tuple[Array, Array]:
    """Which points can be chosen; the others must not reach a score as inf * 0."""
    # As a product, for the same reason as `square_norms`.
    ones = jnp.ones(points.shape[1], points.dtype)
    finite = jnp.matmul(0 * points, ones) == 0
    valid = finite if valid is None else valid & finite
    return jnp.where(valid[:, None], points, 0), valid


def inner_products(one, other):
    return jnp.matmul(one, other.T, precision=jax.lax.Precision.HIGHEST)


def square_norms(points):
    """Squared length of each row, as a product: a long sum is not vectorised."""
    ones = jnp.ones(points.shape[-1], points.dtype)
    return jnp.matmul(points**2, ones, precision=jax.lax.Precision.HIGHEST)


def _distances(queries, near, points, valid):
    """Differentiable; inf where a point is not valid."""
    square = square_norms(queries[:, None] - points[near])
    # The slope of sqrt at 0 is infinite; a coincident pair has none to give.
    apart = square > 0
    dist = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1)), square)
    return jnp.where(valid[near] & jnp.isfinite(dist), dist, jnp.inf)


def common_frame(points, valid):
    """Puts 0 and 1 where float32 neither cancels nor overflows.

    Both are rounded to a power of two: what is near 0 already does not move, and exact
    ties stay exact.
    """
    count = jnp.maximum(valid.sum(), 1).astype(points.dtype)
    centre = points.sum(0) / count
    gap = jnp.where(valid[:, None], jnp.abs(points - centre[None]), 0)
    unit = jnp.ldexp(jnp.ones((), points.dtype), jnp.frexp(gap.max())[1])
    centre = jnp.round(centre / unit) * unit
    return lambda x: ((x - centre[None]) / unit).astype(jnp.float32)


def _select(score: Float[Array, "m b"], count: int):
    """The `count` largest of each column; exact, and cheaper than top_k of it all.

    An entry of the top `count` lies in one of the `count` groups of largest maximum.
    """
    queries = jnp.arange(score.shape[1])
    groups = score.reshape(-1, GROUP, len(queries))
    if len(groups) <= count:
        return jax.lax.top_k(score.T, count)[1]
    # In order, so that ties inside go to the lower index.
    best = jnp.sort(jax.lax.top_k(groups.max(1).T, count)[1], 1)
    member = best[:, :, None], jnp.arange(GROUP)[None, None], queries[:, None, None]
    _, at = jax.lax.top_k(groups[member].reshape(len(queries), -1), count)
    return jnp.take_along_axis(best, at // GROUP, 1) * GROUP + at % GROUP


def _pad(x, multiple: int, value=0.0):
    width = [(0, -len(x) % multiple)] + [(0, 0)] * (x.ndim - 1)
    return jnp.pad(x, width, constant_values=value)
