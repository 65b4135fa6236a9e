"""The k0 nearest neighbours of each query by exhaustive search, in blocks of queries.

Memory is O(n k0) and one block; an n by m array is never built. Candidates are selected
in float32 by |q|^2 - 2 q.p + |p|^2, which cancels. So some more than k0 are selected,
and ranked again by the sum of squared differences in the input's precision. Points that
lie nearer to each other than some 5e-4 of their distance from the common centre are not
told apart so: in a cluster that small another of its points may be found.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.types import Neighbours

# Block sizes; they do not change results.
ROWS = 128  # queries of a block: its scores stay in the cache
GROUP = 16  # points of a group, see `_select`
# Candidates beyond k0. float32 selects them, the input's precision ranks them again.
MARGIN = 3
FARTHEST = 40  # log2 of the distance of a query from points that nearly coincide


@jit(static_argnames="k0")
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
        k0: neighbours of a query, at most the number of points.

    Returns:
        Indices into `points` and distances; where fewer than k0 points are valid, the
        rest has index 0 and distance inf. A query that is not finite has no
        neighbours. Distances are differentiable; the derivative at distance 0 is 0.

    Raises:
        ValueError: widths differ, or k0 is not in 1..m.
    """
    check_point_sets("neighbours", queries=queries, points=points)
    check_k0("neighbours", k0, points)
    safe, valid = valid_rows(points, valid)
    # The choice of neighbours is not differentiable; their distances are.
    frozen = jax.lax.stop_gradient(safe)
    scaled = float32_frame(frozen, valid, jax.lax.stop_gradient(queries))
    # Squares of differences in this unit neither overflow nor vanish.
    unit = _frame(frozen, valid, jax.lax.stop_gradient(queries))[1]
    in_unit = safe / unit
    fast = scaled(frozen)
    offset = jnp.where(valid, 0.5 * jnp.sum(fast**2, 1), jnp.inf)
    fast, offset = pad_rows(fast, GROUP), pad_rows(offset, GROUP, jnp.inf)
    # The rows that fill the last group are no points.
    valid = pad_rows(valid, GROUP, False)

    def block(rows):
        # Points as rows, queries as columns: maxima over groups of points then
        # vectorise.
        score = inner_products(fast, scaled(jax.lax.stop_gradient(rows)))
        count = min(k0 + MARGIN, len(points))
        near = _select(score - offset[:, None], count)
        dist = unit * _distances(rows / unit, near, in_unit, valid)
        dist, near = jax.lax.sort((dist, near), num_keys=2)
        dist, near = dist[:, :k0], near[:, :k0]
        return Neighbours(jnp.where(jnp.isfinite(dist), near, 0), dist)

    blocks = pad_rows(queries, ROWS).reshape(-1, ROWS, queries.shape[1])
    near = jax.lax.map(block, blocks)
    return Neighbours(*(x.reshape(-1, k0)[: len(queries)] for x in near))


def neighbours_of_valid(
    queries: Array,
    points: Array,
    valid_q: Array,
    valid_p: Array,
    *,
    k0: int,
) -> Neighbours:
    """As `neighbours`; a query that is not valid has no neighbours."""
    near: Neighbours = neighbours(queries, points, valid_p, k0=k0)
    idx = jnp.where(valid_q[:, None], near.idx, 0).astype(jnp.int32)
    return Neighbours(idx, jnp.where(valid_q[:, None], near.dist, jnp.inf))


def check_point_sets(function: str, **sets: Array) -> None:
    """ValueError in the name of `function` unless these two sets fit each other.

    Args:
        function: opens the message.
        sets: two arrays by their names, each (n, k) of floating numbers, n and k at
            least 1, and of one k.
    """
    for name, points in sets.items():
        if points.ndim != 2 or 0 in points.shape:
            raise ValueError(
                f"{function}: {name} has shape {points.shape}; give one row a point, "
                "one or more, of one column or more"
            )
        if not jnp.issubdtype(points.dtype, jnp.floating):
            raise ValueError(
                f"{function}: {name} is {points.dtype}; give floating numbers"
            )
    (name_x, x), (name_y, y) = sets.items()
    if x.shape[1] != y.shape[1]:
        raise ValueError(
            f"{function}: {name_x} has {x.shape[1]} columns, {name_y} has {y.shape[1]}"
        )


def check_k0(function: str, k0: int, x: Array, y: Array | None = None) -> None:
    """ValueError in the name of `function` unless each set has k0 points, 1 or more."""
    sizes = [len(points) for points in (x, y) if points is not None]
    if not isinstance(k0, int) or not 1 <= k0 <= min(sizes):
        there = " and ".join(map(str, sizes))
        raise ValueError(
            f"{function}: k0 is {k0}, there are {there} points; give a whole number "
            "from 1 to that"
        )


def measure_distances(
    queries: Array, idx: Array, points: Array, valid_q: Array, valid_p: Array
) -> Neighbours:
    """Neighbours with the indices `idx`, and their distances in the input's precision.

    Where `idx` is not below the number of points, or the query or the point is not
    valid, the index is 0 and the distance inf. Distances are differentiable.
    """
    in_range = idx < len(points)
    idx = jnp.where(in_range, idx, 0)
    # Not derived from the distances: XLA leaves those out if only indices are used.
    known = in_range & valid_q[:, None] & valid_p[idx]
    in_blocks = lambda a: pad_rows(a, ROWS).reshape(-1, ROWS, a.shape[1])
    unit = _frame(*jax.lax.stop_gradient((points, valid_p, queries)))[1]
    in_unit = points / unit
    blocks = jax.lax.map(
        lambda block: _distances(block[0], block[1], in_unit, valid_p),
        (in_blocks(queries / unit), in_blocks(idx)),
    )
    dist = unit * jnp.reshape(blocks, (-1, idx.shape[1]))[: len(queries)]
    return Neighbours(jnp.where(known, idx, 0), jnp.where(known, dist, jnp.inf))


def valid_rows(points: Array, valid: Array | None) -> tuple[Array, Array]:
    """Points with 0 for all rows that are not valid, and which rows are valid.

    Rows that are not finite are not valid. As 0 they put no nan into a product.
    """
    # A product, because XLA does not vectorise a reduction along rows on a CPU. Any
    # precision will do.
    ones = jnp.ones(points.shape[1], points.dtype)
    finite = matmul(0 * points, ones) == 0
    valid = finite if valid is None else valid & finite
    return jnp.where(valid[:, None], points, 0), valid


def inner_products(x: Array, y: Array) -> Array:
    """Inner product of each row of x with each row of y."""
    return matmul(x, y.T)


def square_norms(points: Array) -> Array:
    """Squared length of each row, as a product: XLA does not vectorise a long sum."""
    return matmul(points**2, jnp.ones(points.shape[-1], points.dtype))


def float32_frame(points: Array, valid: Array, queries: Array):
    """A function that moves and scales points so that float32 suits them.

    The mean of the valid points goes near 0, and their largest coordinate is about 1:
    squares neither cancel nor overflow. The unit is a power of two and the new origin a
    multiple of it, so points near 0 do not move and exact ties stay exact.

    Points that coincide, up to rounding, give a tiny unit or none. So no coordinate of
    a query is above `FARTHEST` units either: the squares of farther ones would be
    larger than what marks points that are not valid.
    """
    centre, unit = _frame(points, valid, queries)
    return lambda x: ((x - centre[None]) / unit).astype(jnp.float32)


def _frame(points: Array, valid: Array, queries: Array) -> tuple[Array, Array]:
    """Origin and unit of `float32_frame`."""
    count = jnp.maximum(valid.sum(), 1).astype(points.dtype)
    centre = points.sum(0) / count
    gap = jnp.where(valid[:, None], jnp.abs(points - centre[None]), 0).max()
    away = jnp.abs(queries - centre[None])
    away = jnp.where(jnp.isfinite(away), away, 0).max()
    exponent, least = jnp.frexp(gap)[1], jnp.frexp(away)[1] - FARTHEST
    exponent = jnp.where(gap > 0, jnp.maximum(exponent, least), least)
    exponent = jnp.maximum(exponent, jnp.finfo(points.dtype).minexp)
    unit = jnp.ldexp(jnp.ones((), points.dtype), exponent)
    return jnp.round(centre / unit) * unit, unit


def pad_rows(x: Array, multiple: int, value: float = 0.0) -> Array:
    """x with rows of `value` added, up to a multiple of `multiple` rows."""
    width = [(0, -len(x) % multiple)] + [(0, 0)] * (x.ndim - 1)
    return jnp.pad(x, width, constant_values=value)


def _distances(queries, idx, points, valid):
    """Differentiable; inf where a point is not valid."""
    square = square_norms(queries[:, None] - points[idx])
    # The derivative of sqrt at 0 is infinite; here it is 0.
    apart = square > 0
    dist = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1)), square)
    return jnp.where(valid[idx] & jnp.isfinite(dist), dist, jnp.inf)


def _select(score: Float[Array, "m b"], count: int):
    """Row indices of the `count` largest in each column.

    Each of them lies in one of the `count` groups with the largest maxima. So this is
    exact, and cheaper than top_k of all rows.
    """
    queries = jnp.arange(score.shape[1])
    groups = score.reshape(-1, GROUP, len(queries))
    if len(groups) <= count:
        return jax.lax.top_k(score.T, count)[1]
    # Groups in order, so that ties go to the lower index.
    best = jnp.sort(jax.lax.top_k(groups.max(1).T, count)[1], 1)
    member = best[:, :, None], jnp.arange(GROUP)[None, None], queries[:, None, None]
    _, at = jax.lax.top_k(groups[member].reshape(len(queries), -1), count)
    return jnp.take_along_axis(best, at // GROUP, 1) * GROUP + at % GROUP
