"""Sinkhorn updates in the log domain: what a fixed number and a tolerance share.

In the paper's float64 the weights reach e^-500, but float32 has nothing below e^-103.
Therefore scalings are kept in the log domain. The first pair of updates is a
log-sum-exp. After it a few bounded updates at a time are safe, on a kernel that has
absorbed the scalings so far.

Marginals that need not be met (`Problem.slack`) are targets that move: an update goes
towards sums of a e^(-slack (f - log a)), a the marginal, and takes the power
1 / (1 + slack) of the way (Chizat et al., 2018, with f relative to log a).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array._loops import map_sides, varying_as
from jfsf.array._precision import safe_divide
from jfsf.convert import _kernel as kernels
from jfsf.types import Kernel

ABSORB_EVERY = 4  # updates
# The most that an update may change a scaling by, before relaxation: an infeasible
# marginal sends scalings to infinity, and this keeps them inside float32 on the way.
BOUND = 100.0


class Problem(NamedTuple):
    """A kernel and the marginals to scale it to; 0 is padding. Logs are 0 there.

    slack: strength of the entropy over that of the penalty on sums that are not the
        marginals; None where the sums have to be the marginals.
    """

    kernel: Kernel
    marginal_x: Float[Array, " n_x"]
    marginal_y: Float[Array, " n_y"]
    log_x: Float[Array, " n_x"]
    log_y: Float[Array, " n_y"]
    slack: Float[Array, ""] | None = None


def problem_of(
    kernel: Kernel, marginal_x: Array, marginal_y: Array, slack: Array | None = None
) -> Problem:
    """The problem, with the logs of its marginals."""
    if slack is not None:
        # A vertex that no mass can reach keeps none, whatever its marginal.
        flipped = kernels.transpose(kernel)
        marginal_x = jnp.where(kernels.has_entries(kernel), marginal_x, 0)
        marginal_y = jnp.where(kernels.has_entries(flipped), marginal_y, 0)
    log_x = jnp.log(jnp.where(marginal_x > 0, marginal_x, 1))
    log_y = jnp.log(jnp.where(marginal_y > 0, marginal_y, 1))
    return Problem(kernel, marginal_x, marginal_y, log_x, log_y, slack)


def scaling_y(problem: Problem, f: Float[Array, " n_x"]) -> Float[Array, " n_y"]:
    """g with which the plan's column sums are Y's marginal; 0 for an empty column.

    With slack, g that is best for this f.
    """
    flipped = kernels.transpose(problem.kernel)
    return _minus(problem.log_y, kernels.log_matvec(flipped, f), problem.slack)


def scaling_x(problem: Problem, g: Float[Array, " n_y"]) -> Float[Array, " n_x"]:
    """f with which the plan's row sums are X's marginal; 0 for an empty row.

    With slack, f that is best for this g.
    """
    return _minus(problem.log_x, kernels.log_matvec(problem.kernel, g), problem.slack)


def translated(
    problem: Problem, f: Float[Array, " n_x"], g: Float[Array, " n_y"]
) -> tuple[Float[Array, " n_x"], Float[Array, " n_y"]]:
    """f + c and g - c, with which the targets of both sides have one sum.

    The plan stays as it is. Of all c this one is best, and updates alone take some
    1 / slack steps to it (Sejourne, Vialard and Peyre, 2022). Nothing without slack.
    """
    slack = problem.slack
    if slack is None:
        return f, g
    log_sum_x = _log_target_sum(problem.marginal_x, problem.log_x, f, slack)
    log_sum_y = _log_target_sum(problem.marginal_y, problem.log_y, g, slack)
    some = slack > 0
    shift = jnp.where(some, (log_sum_x - log_sum_y) / jnp.where(some, 2 * slack, 1), 0)
    return (
        jnp.where(problem.marginal_x > 0, f + shift, f),
        jnp.where(problem.marginal_y > 0, g - shift, g),
    )


def _log_target_sum(marginal: Array, log: Array, f: Array, slack: Array) -> Array:
    """log of the sum of a side's targets, exact also where slack is tiny."""
    real = marginal > 0
    total = jnp.where(jnp.any(real), jnp.sum(marginal), 1)
    excess = jnp.where(real, f - log, 0)
    mean = jnp.sum(marginal * excess) / total
    gone = jnp.where(real, slack * (excess - mean), 0)
    # About the mean, the logs of the small numbers that are nearly 1 have all digits.
    tiny = jnp.max(jnp.abs(gone)) < 1
    more = jnp.sum(marginal * jnp.expm1(jnp.where(tiny, -gone, 0))) / total
    far = jax.nn.logsumexp(log - gone, where=real) - jnp.log(total)
    return jnp.log(total) - slack * mean + jnp.where(tiny, jnp.log1p(more), far)


def round_of_updates(
    problem: Problem,
    f: Float[Array, " n_x"],
    g: Float[Array, " n_y"],
    exponent: Callable[[Array], Array],
) -> tuple[Float[Array, " n_x"], Float[Array, " n_y"]]:
    """`ABSORB_EVERY` updates of each side, Y's first.

    Args:
        problem: kernel and marginals.
        f, g: log scalings so far.
        exponent: power that update i of the round is raised to; 1 is a plain update, 0
            changes nothing.
    """
    plan = kernels.scaled(problem.kernel, f, g)
    back = kernels.transpose_plan(plan)
    one_x = problem.marginal_x, problem.log_x, problem.slack
    one_y = problem.marginal_y, problem.log_y, problem.slack

    def update(i, uv):
        u, v = uv
        power = exponent(i)
        v = v * _factor(*one_y, v * kernels.matvec(back, u), g, v) ** power
        u = u * _factor(*one_x, u * kernels.matvec(plan, v), f, u) ** power
        return u, v

    ones = varying_as((jnp.ones_like(f), jnp.ones_like(g)), problem, f, g)
    u, v = jax.lax.fori_loop(0, ABSORB_EVERY, update, ones)
    return f + jnp.log(u), g + jnp.log(v)


def error_of(
    problem: Problem, f: Float[Array, " n_x"], g: Float[Array, " n_y"]
) -> Float[Array, ""]:
    """l1 gap of the plan's row and column sums, as a fraction of all mass.

    From the marginals, or with slack from the targets. 2, the most, also where rounding
    errors make more mass than there is.
    """
    kernel, target_x, target_y, log_x, log_y, slack = problem
    rows, cols = sums(kernel, f, g)
    if slack is None:
        error = jnp.abs(rows - target_x).sum() + jnp.abs(cols - target_y).sum()
        return jnp.minimum(error, 2)
    all_mass = (target_x.sum() + target_y.sum()) / 2
    target_x = target_x * jnp.exp(slack * (log_x - f))
    target_y = target_y * jnp.exp(slack * (log_y - g))
    error = jnp.abs(rows - target_x).sum() + jnp.abs(cols - target_y).sum()
    return jnp.minimum(safe_divide(error, all_mass), 2)


def sums(
    kernel: Kernel, f: Float[Array, " n_x"], g: Float[Array, " n_y"]
) -> tuple[Float[Array, " n_x"], Float[Array, " n_y"]]:
    """Row and column sums of the plan."""
    plan = kernels.scaled(kernel, f, g)
    back = kernels.transpose_plan(plan)
    ones = jnp.ones_like(g), jnp.ones_like(f)
    return map_sides(kernels.matvec, (plan, ones[0]), (back, ones[1]))


def _minus(log_marginal: Array, log_sum: Array, slack: Array | None) -> Array:
    # An empty row keeps scaling 1: it holds no entries, so nothing follows from it.
    known = jnp.isfinite(log_sum)
    if slack is not None:
        log_sum = jnp.where(known, log_sum, 0) / (1 + slack)
    return jnp.where(known, log_marginal - log_sum, 0)


def _factor(
    marginal: Array,
    log_marginal: Array,
    slack: Array | None,
    total: Array,
    f: Array,
    u: Array,
) -> Array:
    """What brings a total to its marginal, or with slack nearer to its target.

    f, u: log scaling when the round began, and the factor since.
    """
    ok = (total > 0) & (marginal > 0)
    total = jnp.where(ok, total, 1)
    if slack is None:
        factor = jnp.where(ok, marginal / total, 1)
    else:
        excess = f + jnp.log(u) - log_marginal
        log_factor = (log_marginal - slack * excess - jnp.log(total)) / (1 + slack)
        factor = jnp.exp(jnp.where(ok, log_factor, 0))
    return jnp.clip(factor, 1 / BOUND, BOUND)
