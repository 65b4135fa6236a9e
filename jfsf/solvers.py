"""Fixed points and non-linear least squares, solved to a tolerance by optimistix.

Both are differentiated by the implicit function theorem: no step is kept for the way
back. The linear systems are solved matrix-free by jax's conjugate gradients. This is
the only file that imports optimistix; as that takes as long as all other imports
together, functions import this file when they are called.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import lineax
import optimistix
from jaxtyping import Array, Int, PyTree

# Of the linear system of one step of least squares, which need not be exact.
STEP_TOL, STEP_ITERATIONS = 1e-3, 30


class Solution(NamedTuple):
    """value: where the solver ended.

    num_steps: steps it took.
    """

    value: Array
    num_steps: Int[Array, ""]


class Iteration(Protocol):
    """How a fixed point is approached. A pytree; its arrays have no derivatives."""

    def begin(self, y: Array, args: PyTree) -> PyTree:
        """The state before the first step."""
        ...

    def step(self, y: Array, args: PyTree, state: PyTree) -> tuple[Array, PyTree]:
        """The next iterate and state."""
        ...

    def ended(self, state: PyTree) -> Array:
        """Whether to stop: solved, or no hope of it."""
        ...


def fixed_point(
    update: Callable[[Array, PyTree], Array],
    iteration: Iteration,
    start: Array,
    args: PyTree,
    *,
    max_steps: int,
    linear_tol: Array | float,
) -> Solution:
    """A fixed point of `update`, which is applied once more at the end.

    Derivatives with respect to `args` are those of the exact fixed point.

    Args:
        update: the map (y, args) -> y. The Jacobian of update(y) - y must be symmetric
            and negative semi-definite.
        iteration: steps towards the fixed point, of any kind.
        start: where to begin.
        args: whatever `update` and `iteration` need.
        max_steps: of the iteration.
        linear_tol: relative tolerance of the linear system of the derivative.
    """
    found = optimistix.fixed_point(
        update,
        _FixedPointSolver(iteration=iteration),
        start,
        args,
        max_steps=max_steps,
        adjoint=optimistix.ImplicitAdjoint(_ConjugateGradients(linear_tol, -1)),
        throw=False,
    )
    return Solution(found.value, jnp.asarray(found.stats["num_steps"], jnp.int32))


def least_squares(
    residuals: Callable[[Array, PyTree], PyTree],
    start: Array,
    args: PyTree,
    *,
    tol: float,
    max_steps: int = 200,
) -> Solution:
    """A local minimum of the sum of squared residuals, by Levenberg and Marquardt.

    Derivatives with respect to `args` are those of the exact minimum.

    Args:
        residuals: the map (y, args) -> arrays, with y scaled to a curvature of order 1.
        start: where to begin.
        args: whatever `residuals` needs.
        tol: relative change of y at which to stop.
        max_steps: evaluations of the residuals, at most.
    """
    found = optimistix.least_squares(
        residuals,
        _LevenbergMarquardt(tol),
        start,
        args,
        max_steps=max_steps,
        adjoint=optimistix.ImplicitAdjoint(_ConjugateGradients(tol, 1)),
        throw=False,
    )
    return Solution(found.value, jnp.asarray(found.stats["num_steps"], jnp.int32))


class _FixedPointSolver(optimistix.AbstractFixedPointSolver):
    """An `Iteration`, as optimistix wants it."""

    iteration: Any
    atol: float = 0.0
    rtol: float = 0.0
    norm: Callable[[PyTree], Array] = optimistix.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        """The state before the first step."""
        return self.iteration.begin(y, args)

    def step(self, fn, y, args, options, state, tags):
        """One step."""
        return *self.iteration.step(y, args, state), None

    def terminate(self, fn, y, args, options, state, tags):
        """Whether to stop; the caller looks at the value itself."""
        return self.iteration.ended(state), optimistix.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        """The update itself: derivatives are taken at a fixed point."""
        return fn(y, args)[0], aux, {}


class _LevenbergMarquardt(optimistix.LevenbergMarquardt):
    """Ends where a step is too small to matter, taken or not.

    optimistix ends at steps that are taken only. Near a minimum rounding hides whether
    the sum of squares falls, and steps are refused for ever.
    """

    def __init__(self, tol: float):
        super().__init__(tol, tol)
        inner = _ConjugateGradients(STEP_TOL, 0, STEP_ITERATIONS)
        self.descent = _Descent(inner)

    def terminate(self, fn, y, args, options, state, tags):
        """Whether to stop."""
        step = self.norm(state.y_eval - y)
        large = step > self.rtol * self.norm(y)  # and not nan
        return state.terminate | ~(large | state.first_step), state.result


class _Descent(optimistix.DampedNewtonDescent):
    """A damping of y's own dtype: optimistix's is float64 wherever jax allows it."""

    def step(self, step_size, state):
        """The damped step of this size."""
        dtype = jax.tree.leaves(state.f_info.residual)[0].dtype
        return super().step(step_size.astype(dtype), state)


class _ConjugateGradients(lineax.AbstractLinearSolver):
    """jax's; `tol` is relative to the right side.

    sign: of a symmetric, semi-definite operator. 0 for one that is not square, and the
        normal equations.

    lineax's own gives up, with nan, where the operator is nearly singular.
    """

    tol: Any
    sign: int
    max_steps: int = 1000

    def init(self, operator, options):
        """The operator, ready to be applied many times."""
        return lineax.linearise(operator)

    def compute(self, state, vector, options):
        """The solution; where steps run out, what was reached."""
        # The normal equations, or the system with a positive operator.
        turn = (lambda v: self.sign * v) if self.sign else state.T.mv
        apply, right = (lambda v: turn(state.mv(v))), turn(vector)
        value, _ = jax.scipy.sparse.linalg.cg(
            apply, right, tol=self.tol, maxiter=self.max_steps
        )
        return value, lineax.RESULTS.successful, {}

    def transpose(self, state, options):
        """Symmetric operators alone are transposed, for derivatives."""
        return state, options

    def conj(self, state, options):
        """Real."""
        return state, options

    def assume_full_rank(self) -> bool:
        """The part of a solution that the operator does not see is not asked for."""
        return True
