"""Descriptors -> functional map C_yx: the linear fit, or a robust or orthogonal one."""

from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.initial._linear import Fit, Solver, solve
from jfsf.initial._nonlinear import SCALE, Loss, solve_nonlinear
from jfsf.initial._terms import DEFAULT, GAMMA, Weights, terms
from jfsf.types import Spectrum


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
