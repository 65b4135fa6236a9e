"""Sinkhorn updates in the log domain: what a fixed number and a tolerance share.

In the paper's float64 the weights reach e^-500, but float32 has nothing below e^-103.
Therefore scalings are kept in the log domain. The first pair of updates is a
log-sum-exp. After it a few bounded updates at a time are safe, on a kernel that has
absorbed the scalings so far.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import map_sides
from jfsf.convert import _kernel as kernels
from jfsf.types import Kernel

ABSORB_EVERY = 4  # updates
# The most that an update may change a scaling by, before relaxation: an infeasible
# marginal sends scalings to infinity, and this keeps them inside float32 on the way.
BOUND = 100.0


class Problem(NamedTuple):
    """A kernel and the marginals to scale it to; 0 is padding. Logs are 0 there."""

    kernel: Kernel
    marginal_x: Float[Array, " n_x"]
    marginal_y: Float[Array, " n_y"]
    log_x: Float[Array, " n_x"]
    log_y: Float[Array, " n_y"]


def problem_of(kernel: Kernel, marginal_x: Array, marginal_y: Array) -> Problem:
    """The problem, with the logs of its marginals."""
    log_x = jnp.log(jnp.where(marginal_x > 0, marginal_x, 1))
    log_y = jnp.log(jnp.where(marginal_y > 0, marginal_y, 1))
    return Problem(kernel, marginal_x, marginal_y, log_x, log_y)


def scaling_y(problem: Problem, f: Float[Array, " n_x"]) -> Float[Array, " n_y"]:
    """g with which the plan's column sums are Y's marginal; 0 for an empty column."""
    flipped = kernels.transpose(problem.kernel)
    return _minus(problem.log_y, kernels.log_matvec(flipped, f))


def scaling_x(problem: Problem, g: Float[Array, " n_y"]) -> Float[Array, " n_x"]:
    """f with which the plan's row sums are X's marginal; 0 for an empty row."""
    return _minus(problem.log_x, kernels.log_matvec(problem.kernel, g))


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
    kernel, marginal_x, marginal_y, *_ = problem
    plan = kernels.scaled(kernel, f, g)
    back = kernels.transpose_plan(plan)

    def update(i, uv):
        u, v = uv
        power = exponent(i)
        v = v * _factor(marginal_y, v * kernels.matvec(back, u)) ** power
        u = u * _factor(marginal_x, u * kernels.matvec(plan, v)) ** power
        return u, v

    ones = jnp.ones_like(f), jnp.ones_like(g)
    u, v = jax.lax.fori_loop(0, ABSORB_EVERY, update, ones)
    return f + jnp.log(u), g + jnp.log(v)


def error_of(
    problem: Problem, f: Float[Array, " n_x"], g: Float[Array, " n_y"]
) -> Float[Array, ""]:
    """l1 gap of the plan's row and column sums, as a fraction of all mass.

    2, the most, also where rounding errors make more mass than there is.
    """
    kernel, marginal_x, marginal_y, *_ = problem
    plan = kernels.scaled(kernel, f, g)
    back = kernels.transpose_plan(plan)
    ones = jnp.ones_like(g), jnp.ones_like(f)
    rows, cols = map_sides(kernels.matvec, (plan, ones[0]), (back, ones[1]))
    error = jnp.abs(rows - marginal_x).sum() + jnp.abs(cols - marginal_y).sum()
    return jnp.minimum(error, 2)


def _minus(log_marginal: Array, log_sum: Array) -> Array:
    # An empty row keeps scaling 1: it holds no entries, so nothing follows from it.
    return jnp.where(jnp.isfinite(log_sum), log_marginal - log_sum, 0)


def _factor(marginal: Array, total: Array) -> Array:
    """What brings a total to its marginal."""
    ok = (total > 0) & (marginal > 0)
    factor = jnp.where(ok, marginal / jnp.where(ok, total, 1), 1)
    return jnp.clip(factor, 1 / BOUND, BOUND)
