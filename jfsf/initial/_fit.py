"""Descriptors -> functional map C_yx: the linear fit, or a robust or orthogonal one.

A descriptor that is wrong on one shape, a landmark in the wrong place say, pulls the
least-squares fit as hard as all others. A robust loss lets it go (Huber, 1964; Geman
and McClure, 1985). C is orthogonal where the map keeps areas (Ovsjanikov et al., 2012);
that term is not linear in C.
"""

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.initial._linear import Entries, Fit, Solver, free_entries, solve
from jfsf.initial._terms import DEFAULT, GAMMA, Terms, Weights, inverse, terms
from jfsf.types import Spectrum

Loss = Literal["square", "huber", "geman-mcclure"]
SCALE = 0.3


@jit(static_argnames=("loss", "max_steps", "solver"))
def solve_nonlinear(
    problem: Terms,
    orthogonality: Float[Array, ""] | float = 0.0,
    scale: Float[Array, ""] | float = SCALE,
    *,
    loss: Loss = "square",
    max_steps: int = 200,
    solver: Solver = "jaxopt",
) -> Fit:
    """A local minimum near that of `solve`, from which Levenberg-Marquardt starts.

    Args:
        problem: see `combine`.
        orthogonality: weight w of a further term, w |C^T C - I|_F^2.
        scale: where the loss is no longer quadratic, relative to what a descriptor
            costs at C = 0.
        loss: of r, the root of what a descriptor costs: its own mismatch and that of
            its two operators. "square" is r^2; "huber" goes on with the same slope from
            r = scale; "geman-mcclure" is r^2 / (1 + r^2 / scale^2), which forgets a
            descriptor that is far off.
        max_steps: of Levenberg-Marquardt. Ten are enough for the start of a search.
        solver: of the linear start.

    Returns:
        The map, and how far from a minimum the solver stopped; see `Fit`. Gradients are
        those of the exact minimum.

    Raises:
        ValueError: `loss` or `solver` is unknown.
    """
    if loss not in ("square", "huber", "geman-mcclure"):
        raise ValueError(
            f"fit: loss is 'square', 'huber' or 'geman-mcclure', not {loss!r}"
        )
    # The import takes as long as all others together.
    from jfsf.solvers import least_squares

    dtype = problem.mask.dtype
    entries = free_entries(problem)
    seen = entries.scale > 0
    start = solve(problem, solver=solver).C_yx[:, 1:]
    start = jnp.asarray(jnp.where(seen, start / jnp.where(seen, entries.scale, 1), 0))
    residuals = partial(_residuals, loss=loss)
    args = (
        problem,
        entries,
        jnp.asarray(orthogonality, dtype),
        jnp.asarray(scale, dtype),
    )
    solution = least_squares(
        residuals,
        jax.lax.stop_gradient(start),
        args,
        tol=1e-5 if dtype == jnp.float32 else 1e-10,
        max_steps=max_steps,
    )

    @jax.grad
    def gradient(free):
        parts = residuals(free, args)
        return sum(jnp.sum(part**2) for part in parts) / 2

    size = jnp.sum(gradient(jnp.zeros_like(start)) ** 2)
    gap = jnp.sum(gradient(solution.value) ** 2) * inverse(size)
    return Fit(entries.constant + entries.to_map(solution.value), jnp.sqrt(gap))


def _residuals(free: Array, args: tuple[Terms, Entries, Array, Array], *, loss: Loss):
    """Terms whose squares add up to the energy."""
    problem, entries, orthogonality, scale = args
    C = entries.constant + entries.to_map(free)
    x, y = problem.commute_x, problem.commute_y
    gap = einsum("ab,bec->aec", C, y) - einsum("aeb,bc->aec", x, C)
    mismatch = matmul(C, problem.coef_y) - problem.coef_x
    gram = matmul(C.T, C) - jnp.eye(C.shape[1], dtype=C.dtype)
    # A descriptor has two operators: by multiplication and by its gradient.
    number = mismatch.shape[1]
    share = problem.weight_desc * jnp.sum(mismatch**2, 0)
    own = problem.weight_e * jnp.sum(gap**2, (0, 2))
    share = share + jnp.sum(own.reshape(2, number), 0)
    kept = _loss_per_square(share, scale**2 * len(C) / number, loss)
    twice = jnp.concatenate([kept, kept])
    return (
        _root(problem.weight_desc * kept)[None] * mismatch,
        _root(problem.mask) * C,
        _root(problem.weight_e * twice)[None, :, None] * gap,
        _root(orthogonality) * gram,
    )


def _loss_per_square(square: Array, limit: Array, loss: Loss) -> Array:
    """loss(r) / r^2 of r^2, with scale^2 for a limit."""
    if loss == "square":
        return jnp.ones_like(square)
    if loss == "geman-mcclure":
        return limit / (square + limit)
    far = square > limit
    ratio = jnp.where(far, limit / jnp.where(far, square, 1), 1)
    return jnp.where(far, 2 * jnp.sqrt(ratio) - ratio, 1)


def _root(weight: Array) -> Array:
    # The derivative of a root is infinite at 0.
    return jnp.where(weight > 0, jnp.sqrt(jnp.where(weight > 0, weight, 1)), 0)


@jit(static_argnames=("k", "solver", "gamma", "loss"))
def fit(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = DEFAULT,
    *,
    k: int = 30,
    solver: Solver = "jaxopt",
    gamma: float = GAMMA,
    column_weights: Float[Array, " d"] | None = None,
    loss: Loss = "square",
    scale: Float[Array, ""] | float = SCALE,
    orthogonality: Float[Array, ""] | float | None = None,
) -> Fit:
    """The functional map C_yx (k, k) that best carries desc_y to desc_x.

    It minimises E(C) of `jfsf.initial._terms.combine` (descriptors, Laplacians,
    multiplication, orientation) over all C whose first column is (1, 0, ...):
    constants go to constants.

    Args:
        spec_x, spec_y: spectra with k eigenpairs or more, faces wound outward. Without
            faces on either side the orientation term says nothing.
        desc_x, desc_y: descriptors, a row for each vertex; column i of one corresponds
            to column i of the other. Each is centred and scaled to variance 1, both
            shapes by the same factor.
        weights: weights of the four terms; traced, so a sweep compiles once.
        k: number of rows and of columns of C_yx.
        solver: conjugate gradients by "jaxopt", or the same by "lineax".
        gamma: exponent of the resolvent mask.
        column_weights: weights of the descriptors relative to each other; equal if
            None.
        loss, scale: how descriptors that do not agree count, see `solve_nonlinear`.
        orthogonality: weight of |C^T C - I|_F^2, with the squared norms of the other
            terms of the order of k; None leaves the term out.

    Returns:
        The minimum, and how far from it the solver stopped (about 1e-10 in float64,
        1e-5 in float32). With "square" and no orthogonality the problem is linear and
        the minimum unique; else it is a local one near that of the linear problem.
        Gradients flow through spectra, descriptors and all weights.

    Raises:
        ValueError: the descriptors do not fit the shapes, each other or their weights,
            k is below 2 or more than the eigenpairs there are, or `solver` or `loss`
            is unknown.
    """
    problem = terms(
        spec_x,
        spec_y,
        desc_x,
        desc_y,
        weights,
        k=k,
        gamma=gamma,
        column_weights=column_weights,
    )
    if loss == "square" and orthogonality is None:
        return solve(problem, solver=solver)
    weight = 0.0 if orthogonality is None else orthogonality
    return solve_nonlinear(problem, weight, scale, loss=loss, solver=solver)
