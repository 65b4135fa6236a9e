"""Neighbours -> sparse kernel K = exp(-lam d^p) in the log domain, and the plan.

K is that of algorithm 2 of Pai et al. (CVPR 2021); their eq. 12 has 1 / lam for lam.
They take the k0 neighbours of each row of X, here it is the union of those both ways.
Every row has a fixed number of entries. They are stored in two padded halves, each
entry once. So memory is O(n k0), and shapes never depend on the data.
"""

from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.array._loops import varying_as
from jfsf.types import Kernel, Neighbours, Plan

Scale = Literal["nearest", "max"]
MOST = 60.0  # the log of a weight


def build(
    near_xy: Neighbours,
    near_yx: Neighbours,
    lam_xy: Float[Array, ""],
    lam_yx: Float[Array, ""],
    *,
    power: float = 1.0,
    unilateral_weight: float = 1.0,
) -> Kernel:
    """K_ij = exp(-lam d_ij^p) on the union of both neighbour lists.

    The sparse kernel of eq. 12 and of step 1 of algorithm 2 of Pai et al. (CVPR 2021),
    who have p = 2.

    Args:
        near_xy, near_yx: k0 neighbours in Y of each vertex of X, and the other way.
        lam_xy, lam_yx: sharpness, 1 / length^power. The entry of two vertices that are
            each among the other's neighbours is the mean of the two kernels.
        power: p of d^p.
        unilateral_weight: factor of an entry whose vertices are neighbours in one
            direction only. The authors' code, which averages two kernels, has 0.5.
    """
    log_xy, log_yx = (
        _log_kernel(near_xy, lam_xy, power),
        _log_kernel(near_yx, lam_yx, power),
    )
    mutual_xy = _is_mutual(near_xy, near_yx)
    mutual_yx = _is_mutual(near_yx, near_xy)

    other = _log_kernel(near_xy, lam_yx, power)
    # Two logs of -inf have no difference, which `jax.debug_nans` sees in derivatives.
    known = jnp.isfinite(near_xy.dist)
    both = (jnp.where(known, log, 0) for log in (log_xy, other))
    mean = jnp.logaddexp(*both) - jnp.log(2.0).astype(log_xy.dtype)
    log_weight = jnp.log(jnp.asarray(unilateral_weight, log_xy.dtype))
    log_xy = jnp.where(mutual_xy, mean, log_xy + log_weight)
    log_yx = jnp.where(mutual_yx, -jnp.inf, log_yx + log_weight)
    return Kernel(near_xy.idx, log_xy, near_yx.idx, log_yx)


def length(near: Neighbours, scale: Scale, gradient: bool = False) -> Float[Array, ""]:
    """The length that lam is relative to, for one direction; see `sinkhorn`."""
    dist, known = near.dist, jnp.isfinite(near.dist)
    if not gradient:
        dist = jax.lax.stop_gradient(dist)
    if scale == "max":
        length = jnp.max(jnp.where(known, dist, 0))
    else:
        ends = dist[:, (0, -1)], known[:, (0, -1)]
        # Shapes that coincide have nearest distance 0; 1 / lam must not follow.
        nearest, farthest = _medians(*ends)
        if gradient:
            nearest, farthest = _mean_of_equal(*ends, jnp.stack([nearest, farthest]))
        length = jnp.maximum(nearest, farthest / 100)
    return jnp.where(length > 0, length, 1)


def _mean_of_equal(
    dist: Float[Array, "n c"], known: Array, value: Float[Array, " c"]
) -> Float[Array, " c"]:
    """`value` again, as the mean of the entries equal to it, which has a slope."""
    equal = known & (dist == value[None])
    total = jnp.sum(jnp.where(equal, dist, 0), 0)
    return total / jnp.maximum(jnp.sum(equal, 0), 1).astype(dist.dtype)


def _medians(dist: Float[Array, "n c"], known: Array) -> Float[Array, " c"]:
    """The lower median of the known entries of each column, found bit by bit.

    Counting replaces a sort, which is slow in XLA on a CPU. Numbers that are not
    negative have the order of their bits.
    """
    integer = jnp.int32 if dist.dtype.itemsize == 4 else jnp.int64
    bits = jax.lax.bitcast_convert_type(jax.lax.stop_gradient(dist), integer)
    before = (known.sum(0) - 1) // 2

    def settle(i, low):
        larger = low | (jnp.ones((), integer) << (top - i))
        smaller = jnp.sum(known & (bits < larger[None]), 0)
        return jnp.where(smaller <= before, larger, low)

    top = 8 * dist.dtype.itemsize - 2  # below the sign
    low = varying_as(jnp.zeros(dist.shape[1], integer), dist, known)
    median = jax.lax.fori_loop(0, top + 1, settle, low)
    return jnp.where(before < 0, 0, jax.lax.bitcast_convert_type(median, dist.dtype))


def transpose(kernel: Kernel) -> Kernel:
    """K^T: the halves are exchanged."""
    return Kernel(kernel.idx_yx, kernel.log_yx, kernel.idx_xy, kernel.log_xy)


def transpose_plan(plan: Plan) -> Plan:
    """S^T: the halves are exchanged."""
    return Plan(plan.idx_yx, plan.weight_yx, plan.idx_xy, plan.weight_xy)


def scaled(kernel: Kernel, f: Float[Array, " n_x"], g: Float[Array, " n_y"]) -> Plan:
    """The plan S = diag(exp f) K diag(exp g)."""
    return Plan(
        kernel.idx_xy,
        _weight(kernel.log_xy + f[:, None] + g[kernel.idx_xy]),
        kernel.idx_yx,
        _weight(kernel.log_yx + g[:, None] + f[kernel.idx_yx]),
    )


def _weight(log_weight: Array) -> Array:
    # No plan that meets its marginals has a weight above 1. Logs of 1e8, in float32,
    # have rounding errors that would make one infinite.
    return jnp.exp(jnp.minimum(log_weight, MOST))


def matvec(plan: Plan, values: Float[Array, " n_y *c"]) -> Float[Array, " n_x *c"]:
    """S @ values."""
    if values.ndim > 1:
        return jax.vmap(_matvec, (None, -1), -1)(plan, values)
    return _matvec(plan, values)


def _matvec(plan, values):
    own = jnp.sum(plan.weight_xy * values[plan.idx_xy], 1)
    return own.at[plan.idx_yx].add(plan.weight_yx * values[:, None])


def log_matvec(kernel: Kernel, g: Float[Array, " n_y"]) -> Float[Array, " n_x"]:
    """log(K @ exp(g)), shifted by each row's largest term: no under- or overflow."""
    own = kernel.log_xy + g[kernel.idx_xy]
    other = kernel.log_yx + g[:, None]
    top = jnp.max(own, 1).at[kernel.idx_yx].max(other)
    top = jax.lax.stop_gradient(jnp.where(jnp.isfinite(top), top, 0))
    total = jnp.sum(jnp.exp(own - top[:, None]), 1)
    total = total.at[kernel.idx_yx].add(jnp.exp(other - top[kernel.idx_yx]))
    positive = total > 0
    return jnp.where(positive, top + jnp.log(jnp.where(positive, total, 1)), -jnp.inf)


def has_entries(kernel: Kernel) -> Bool[Array, " n_x"]:
    """Whether each row has any entry."""
    own = jnp.any(jnp.isfinite(kernel.log_xy), 1)
    return own.at[kernel.idx_yx].max(jnp.isfinite(kernel.log_yx))


def row_argmax(kernel: Kernel, g: Float[Array, " n_y"]):
    """Column of the largest entry of K diag(exp g) in each row; ties to the lowest.

    Returns the columns, 0 for an empty row, and whether the row has any entry.
    """
    n_y = len(g)
    own = kernel.log_xy + g[kernel.idx_xy]
    other = kernel.log_yx + g[:, None]
    best = jnp.max(own, 1).at[kernel.idx_yx].max(other)
    at_own = jnp.where(own == best[:, None], kernel.idx_xy, n_y)
    column = jnp.arange(n_y, dtype=kernel.idx_xy.dtype)[:, None]
    at_other = jnp.where(other == best[kernel.idx_yx], column, n_y)
    first = jnp.min(at_own, 1).at[kernel.idx_yx].min(at_other)
    known = best > -jnp.inf
    return jnp.where(known, first, 0), known


def _log_kernel(near: Neighbours, lam: Array, power: float) -> Array:
    # lam = 0 times inf is nan, and so is the slope of any lam at inf.
    known = jnp.isfinite(near.dist)
    return jnp.where(known, -lam * jnp.where(known, near.dist, 1) ** power, -jnp.inf)


def _is_mutual(near_xy: Neighbours, near_yx: Neighbours):
    """Whether each entry of near_xy stands in near_yx too; padding never does."""
    me = jnp.arange(len(near_xy.idx), dtype=near_xy.idx.dtype)[:, None, None]
    theirs = near_yx.idx[near_xy.idx]
    known = jnp.isfinite(near_yx.dist)[near_xy.idx]
    return jnp.any((theirs == me) & known, 2) & jnp.isfinite(near_xy.dist)
