"""The k0 nearest neighbours of every point, by exhaustive search in blocks of rows.

Memory is O(n k0) beyond one block of rows; no n_x by n_y array is ever built.
Candidates are selected in float32 through |q|^2 - 2 q.p + |p|^2, which cancels, so a
few more than k0 are kept and ranked again by the sum of squared differences in the
input's precision. In a tight cluster far from the centre that margin may not suffice: a
neighbour may then be some 0.1 % farther than the nearest.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.types import Neighbours

ROWS = 128  # rows of queries at a time: their scores stay in the cache
GROUP = 16  # points a group, see _select
MARGIN = 3  # candidates beyond k0 that float32 may have misplaced


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
    finite = jnp.isfinite(points).all(1)
    valid = finite if valid is None else valid & finite
    # A point that may not be chosen must not reach a score through inf * 0.
    safe = jnp.where(valid[:, None], points, 0)
    # The choice of neighbours is not differentiable; their distances are.
    frozen = jax.lax.stop_gradient(safe)
    centre, unit = _frame(frozen, valid)
    scaled = lambda x: ((x - centre[None]) / unit).astype(jnp.float32)
    fast = scaled(frozen)
    offset = jnp.where(valid, 0.5 * jnp.sum(fast**2, 1), jnp.inf)
    fast, offset = _pad(fast, GROUP), _pad(offset, GROUP, jnp.inf)
    # The rows that fill the last group are no points.
    valid = _pad(valid, GROUP, False)

    def block(rows):
        # Points down, queries across: maxima over groups of points then vectorise.
        score = jnp.matmul(
            fast,
            scaled(jax.lax.stop_gradient(rows)).T,
            precision=jax.lax.Precision.HIGHEST,
        )
        near = _select(score - offset[:, None], min(k0 + MARGIN, len(points)))
        square = jnp.sum((rows[:, None] - safe[near]) ** 2, 2)
        # The slope of sqrt at 0 is infinite; a coincident pair has none to give.
        apart = square > 0
        dist = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1)), square)
        dist = jnp.where(valid[near] & jnp.isfinite(dist), dist, jnp.inf)
        dist, near = jax.lax.sort((dist, near), num_keys=2)
        dist, near = dist[:, :k0], near[:, :k0]
        return Neighbours(jnp.where(jnp.isfinite(dist), near, 0), dist)

    blocks = _pad(queries, ROWS).reshape(-1, ROWS, queries.shape[1])
    found = jax.lax.map(block, blocks)
    return Neighbours(*(x.reshape(-1, k0)[: len(queries)] for x in found))


def _frame(points, valid):
    """Where to put 0 and 1, so that float32 neither cancels nor overflows.

    Both are rounded to a power of two: what is near 0 already does not move, and exact
    ties stay exact.
    """
    count = jnp.maximum(valid.sum(), 1).astype(points.dtype)
    centre = points.sum(0) / count
    gap = jnp.where(valid[:, None], jnp.abs(points - centre[None]), 0)
    unit = jnp.ldexp(jnp.ones((), points.dtype), jnp.frexp(gap.max())[1])
    return jnp.round(centre / unit) * unit, unit


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
