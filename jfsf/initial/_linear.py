"""The minimum of the energy of the fits, by conjugate gradients, matrix-free.

It is exact, and differentiable through the optimality condition. jaxopt is no longer
maintained: this is the only file that imports it, and lineax stands beside it behind
the same function.
"""

import warnings
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf._exported import exported
from jfsf.array import einsum
from jfsf.array._jit import jit
from jfsf.initial._terms import Terms, inverse

Solver = Literal["jaxopt", "lineax"]
MAX_STEPS = 2000


class Entries(NamedTuple):
    """The entries of C that a fit is free to choose: all but the first column.

    They are scaled to a curvature of 1: iterations then need far fewer steps, and the
    minimum does not depend on it.

    constant: C with the first column alone, constants to constants.
    scale: factor of each entry; 0 where the energy does not see it.
    """

    constant: Float[Array, "k_x k_y"]
    scale: Float[Array, "k_x free"]

    def to_map(self, free: Float[Array, "k_x free"]) -> Float[Array, "k_x k_y"]:
        """The free entries where they belong in C, and 0 in its first column."""
        return jnp.pad(free * self.scale, ((0, 0), (1, 0)))


@exported
class Fit(NamedTuple):
    """A functional map fitted to descriptors.

    C_yx: the functional map, functions on Y pulled back to X; constants go to
        constants.
    residual: how far the solver stopped from the minimum: the norm of the energy's
        gradient in C, each entry scaled by the energy's curvature, relative to that
        norm at the C that maps only constants. 0 is exact.
    """

    C_yx: Float[Array, "k_x k_y"]
    residual: Float[Array, ""]


def free_entries(problem: Terms) -> Entries:
    """The entries that a fit chooses; scales are constants of differentiation."""
    constant = jnp.zeros_like(problem.mask).at[0, 0].set(1)
    curvature = jax.lax.stop_gradient(_diagonal(problem)[:, 1:])
    known = curvature > 0
    scale = jnp.where(known, jax.lax.rsqrt(jnp.where(known, curvature, 1)), 0)
    return Entries(constant, scale)


@jit(static_argnames="solver")
def solve(problem: Terms, *, solver: Solver = "jaxopt") -> Fit:
    """Minimise the energy of `problem`; the first column of C is fixed to (1, 0, ...).

    Entries that the energy does not see are 0.

    Raises:
        ValueError: `solver` is unknown.
    """
    entries = free_entries(problem)
    constant, scale, to_map = entries.constant, entries.scale, entries.to_map
    dtype = constant.dtype

    def normal(free):
        return _half_gradient(problem, to_map(free))[:, 1:] * scale

    pull = problem.weight_desc * einsum("ad,bd->ab", problem.coef_x, problem.coef_y)
    target = (pull - _half_gradient(problem, constant))[:, 1:] * scale
    tol = 1e-5 if dtype == jnp.float32 else 1e-10
    # Each import takes half as long as all others together, and a program that is
    # loaded from disk needs neither.
    if solver == "jaxopt":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            from jaxopt.linear_solve import solve_cg
        zero = jnp.zeros_like(target)
        free = solve_cg(normal, target, init=zero, tol=tol, maxiter=MAX_STEPS)
    elif solver == "lineax":
        import lineax

        operator = lineax.FunctionLinearOperator(
            normal,
            jax.ShapeDtypeStruct(target.shape, dtype),
            lineax.positive_semidefinite_tag,
        )
        # lineax applies a relative tolerance to each entry: too strict for small ones.
        size = jax.lax.stop_gradient(jnp.linalg.norm(target))
        method = lineax.CG(
            rtol=0.0, atol=tol, norm=jnp.linalg.norm, max_steps=MAX_STEPS
        )
        unit = target * inverse(size)
        free = lineax.linear_solve(operator, unit, method, throw=False).value * size
    else:
        raise ValueError(f"solve: solver is 'jaxopt' or 'lineax', not {solver!r}")
    gap = jnp.sum((target - normal(free)) ** 2) * inverse(jnp.sum(target**2))
    return Fit(constant + to_map(free), jnp.sqrt(gap))


def _half_gradient(problem, C):
    """Half the gradient of the energy's quadratic part at C."""
    x, y, w = problem.commute_x, problem.commute_y, problem.weight_e
    # With the index e in the middle, each line is one large matrix product.
    gap = einsum("ab,bec->aec", C, y) - einsum("aeb,bc->aec", x, C)
    gap = gap * w[None, :, None]
    mapped = problem.weight_desc * einsum("ab,bd->ad", C, problem.coef_y)
    return (
        einsum("ad,bd->ab", mapped, problem.coef_y)
        + problem.mask * C
        + einsum("aec,bec->ab", gap, y)
        - einsum("aeb,aec->bc", x, gap)
    )


def _diagonal(problem):
    """Diagonal of `_half_gradient`, entry by entry of C."""
    x, y, w = problem.commute_x, problem.commute_y, problem.weight_e
    own_x = einsum("e,aeb->b", w, x**2)
    own_y = einsum("e,bec->b", w, y**2)
    total = own_x[:, None] + own_y[None]
    cross = einsum("e,aea,beb->ab", w, x, y)
    # Cancellation must not leave a curvature of 0 or less.
    total = jnp.maximum(total - 2 * cross, 10 * jnp.finfo(total.dtype).eps * total)
    own = problem.weight_desc * jnp.sum(problem.coef_y**2, 1)
    return own[None] + problem.mask + total
