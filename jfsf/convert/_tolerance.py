"""Sinkhorn scaling to a tolerance, with derivatives from the optimality condition.

The scaling f of X is the fixed point of a pair of plain updates. optimistix runs
over-relaxed updates until the marginals are met, and differentiates the fixed point by
the implicit function theorem, so that no update is kept for the way back. With f times
the root of X's marginal as unknown, the Jacobian is symmetric: conjugate gradients
solve with it, and the kernel is only ever multiplied with. With slack the root is that
of the plan's row sums, which are known at the fixed point only. So derivatives are
taken there, by a second fixed point that begins at the first one, and ends there.

The relaxation grows while the error falls slowly, and shrinks when it rises. To sharpen
a sharp kernel gradually (epsilon continuation: Schmitzer, 2019) was tried and left out:
of 12 random problems at lam = 500, 5 then met 1e-4 before progress ended, 10 without.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.convert._updates import (
    ABSORB_EVERY,
    Problem,
    error_of,
    round_of_updates,
    scaling_x,
    scaling_y,
    sums,
    translated,
)
from jfsf.solvers import fixed_point

# Rounds after which the relaxation is judged by how far the error has fallen, and how
# many times in a row there may be no progress before the updates end: 2560 updates. On
# a sharp kernel the error may rest for a thousand before it falls again.
JUDGE_EVERY = 16
MAX_STALLED = 40
SLOW, PROGRESS = 0.5, 0.99
# 2 minus the relaxation: factors when the error falls slowly and when it rises.
LESS, MORE, LEAST = 0.7, 2.0, 0.02


class Scaling(NamedTuple):
    """f, g: log scalings of X and Y.

    num_iters: updates of each side that were made.
    """

    f: Float[Array, " n_x"]
    g: Float[Array, " n_y"]
    num_iters: Int[Array, ""]


def scale_to_tolerance(
    problem: Problem,
    tol: Float[Array, ""] | float,
    relax: Float[Array, ""] | float,
    *,
    max_iters: int,
) -> Scaling:
    """Scale until the marginal error is at most `tol`, or no longer falls.

    Derivatives of f and g are those of the exact fixed point.

    Args:
        problem: kernel and marginals.
        tol: marginal error to reach.
        relax: factor of each update to begin with, in (0, 2).
        max_iters: updates of each side, at most, but for two and what fills the last
            round of `ABSORB_EVERY`.
    """
    dtype = problem.log_x.dtype
    root = jnp.sqrt(jnp.where(problem.marginal_x > 0, problem.marginal_x, 1))
    rooted = _Rooted(problem, root)
    start = scaling_x(problem, scaling_y(problem, jnp.zeros_like(problem.log_x)))
    start = jax.lax.stop_gradient(start * root)
    tol = jax.lax.stop_gradient(jnp.asarray(tol, dtype))
    # The linear system is solved as exactly as the marginals are met.
    least = 1e-5 if dtype == jnp.float32 else 1e-10
    exact = jnp.maximum(tol, least)
    solution = fixed_point(
        _plain_updates,
        # A little less, as the last pair of updates has rounding errors of its own.
        _Updates(0.98 * tol, jnp.asarray(relax, dtype)),
        start,
        rooted if problem.slack is None else jax.lax.stop_gradient(rooted),
        max_steps=max(-(-max_iters // ABSORB_EVERY), 1),
        linear_tol=exact,
    )
    num_iters = solution.num_steps * ABSORB_EVERY + 2
    if problem.slack is not None:
        num_iters = num_iters + 1
        root, solution = _at(solution.value / root, problem, exact)
    # A last pair of plain updates makes the row sums exact.
    g = scaling_y(problem, solution.value / root)
    return Scaling(scaling_x(problem, g), g, num_iters)


class _Rooted(NamedTuple):
    """A problem, and what f is multiplied by so that the Jacobian is symmetric."""

    problem: Problem
    root: Float[Array, " n_x"]


def _at(f: Array, problem: Problem, linear_tol: Array):
    """The fixed point f with slack, once more, with its derivatives."""
    g = scaling_y(problem, f)
    rows, _ = sums(problem.kernel, scaling_x(problem, g), g)
    # A row of no mass that floats can hold has no influence, and no root either.
    root = jnp.sqrt(jnp.where(rows > 0, rows, 1))
    rooted = _Rooted(problem, jax.lax.stop_gradient(root))
    start = jax.lax.stop_gradient(f * root)
    options = {"max_steps": 1, "linear_tol": linear_tol}
    solution = fixed_point(_plain_updates, _Known(), start, rooted, **options)
    return rooted.root, solution


def _plain_updates(scaled_f: Array, rooted: _Rooted) -> Array:
    """A plain update of each side; the mean of f, which no plan depends on, is 0.

    With slack the plan does depend on it.
    """
    problem, root = rooted
    f = scaling_x(problem, scaling_y(problem, scaled_f / root))
    mean = jnp.sum(problem.marginal_x * f) / jnp.sum(problem.marginal_x)
    if problem.slack is not None:
        mean = jnp.where(problem.slack > 0, 0, mean)
    return jnp.where(problem.marginal_x > 0, f - mean, 0) * root


class _Known(NamedTuple):
    """No step: the fixed point is known."""

    def begin(self, y: Array, args: _Rooted) -> tuple[()]:
        """Nothing to keep."""
        return ()

    def step(
        self, y: Array, args: _Rooted, state: tuple[()]
    ) -> tuple[Array, tuple[()]]:
        """Never made."""
        return y, state

    def ended(self, state: tuple[()]) -> Array:
        """At once."""
        return jnp.array(True)


class _State(NamedTuple):
    """Between two rounds of updates.

    g: log scaling of Y.
    gap: 2 minus the relaxation.
    error: marginal error before the last round.
    mark: error when the relaxation was last judged.
    best: least error at such a time; `stalled`: how many of them ago.
    rounds: so far.
    """

    g: Float[Array, " n_y"]
    gap: Float[Array, ""]
    error: Float[Array, ""]
    mark: Float[Array, ""]
    best: Float[Array, ""]
    stalled: Int[Array, ""]
    rounds: Int[Array, ""]


class _Updates(NamedTuple):
    """Rounds of over-relaxed updates until the marginals are met to `atol`.

    relax: factor of each update to begin with.
    """

    atol: Float[Array, ""]
    relax: Float[Array, ""]

    def begin(self, y: Array, args: _Rooted) -> _State:
        """No round yet."""
        inf, zero = jnp.asarray(jnp.inf, y.dtype), jnp.zeros((), jnp.int32)
        g = scaling_y(args.problem, y / args.root)
        return _State(g, 2 - self.relax, inf, inf, inf, zero, zero)

    def step(self, y: Array, args: _Rooted, state: _State) -> tuple[Array, _State]:
        """One round."""
        problem, root = args
        f, g = translated(problem, y / root, state.g)
        # Over-relaxed updates overshoot: the error is that after a plain one of Y.
        error = error_of(problem, f, scaling_y(problem, f))
        state = _judge(state, error)
        kept = y if problem.slack is None else f * root
        f, g = round_of_updates(problem, f, g, lambda _: 2 - state.gap)
        # No more updates where the marginals were met before.
        y = jnp.where(error <= self.atol, kept, f * root)
        return y, state._replace(g=g)

    def ended(self, state: _State) -> Array:
        """Whether the marginals are met, or the error no longer falls."""
        hopeless = jnp.isnan(state.error) | (state.stalled >= MAX_STALLED)
        return hopeless | (state.error <= self.atol)


def _judge(state: _State, error: Array) -> _State:
    """Adapt the relaxation, and note progress, every so many rounds."""
    rounds = state.rounds + 1
    due = rounds % JUDGE_EVERY == 0
    slow, rises = error > SLOW * state.mark, error > state.mark
    factor = jnp.where(rises, MORE, jnp.where(slow, LESS, 1)).astype(error.dtype)
    gap = jnp.where(due, jnp.clip(state.gap * factor, LEAST, 1), state.gap)
    better = error < PROGRESS * state.best
    stalled = jnp.where(better, 0, state.stalled + 1)
    return state._replace(
        gap=gap,
        error=error,
        mark=jnp.where(due, error, state.mark),
        best=jnp.where(due, jnp.minimum(error, state.best), state.best),
        stalled=jnp.where(due, stalled, state.stalled),
        rounds=rounds,
    )
