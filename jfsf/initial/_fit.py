"""Descriptors -> functional map C_yx, as the linear least-squares problem it is.

The energy of Nogneng and Ovsjanikov (2017) and Ren et al. (2018, 2019): descriptors are
preserved, C commutes with the Laplacians (resolvent mask), with multiplication by
descriptors, and with the oriented product of gradients. All four are linear in C, so
the minimum is exact, matrix-free, and differentiable through the optimality condition.

jaxopt is no longer maintained: this is the only file that imports it, and lineax stands
beside it behind the same function.

This file is long because the energy, its gradient and both solvers stand together.
"""

import warnings
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import einsum, map_sides, safe_divide
from jfsf.spectral import brackets
from jfsf.types import Spectrum

GAMMA = 0.5  # exponent of the resolvent mask, as in Ren et al. (SGP 2019)
MAX_STEPS = 2000


class Weights(NamedTuple):
    """Weights of the four terms, each of which is normalised to order 1 first.

    Signs count for orientation alone: negative asks for a mirrored map.
    """

    descriptors: Float[Array, ""] | float = 1.0
    laplacian: Float[Array, ""] | float = 0.1
    multiplication: Float[Array, ""] | float = 1.0
    orientation: Float[Array, ""] | float = 1.0


DEFAULT = Weights()


class ShapeTerms(NamedTuple):
    """What the energy reads of one shape, of a size that does not depend on n.

    evals: the first k eigenvalues.
    mean, variance: of each descriptor over the shape.
    coef: the centred descriptors in the eigenbasis.
    times: multiplication by each centred descriptor, in the eigenbasis.
    brackets: oriented products of eigenfunctions, see `jfsf.spectral.brackets`.
    """

    evals: Float[Array, " k"]
    mean: Float[Array, " d"]
    variance: Float[Array, " d"]
    coef: Float[Array, "k d"]
    times: Float[Array, "k d k"]
    brackets: Float[Array, "k k k"]


class Terms(NamedTuple):
    """The energy that `solve` minimises over C, weights included:

    weight_desc |C coef_y - coef_x|^2 + sum(mask C^2)
        + sum_e weight_e |C commute_y[:, e] - commute_x[:, e] C|^2

    coef_x, coef_y: descriptors in the eigenbases.
    mask: how much each entry of C breaks commutativity with the Laplacians.
    commute_x, commute_y: operators e that C is to commute with.
    weight_e: weights of those.
    """

    coef_x: Float[Array, "k_x d"]
    coef_y: Float[Array, "k_y d"]
    weight_desc: Float[Array, ""]
    mask: Float[Array, "k_x k_y"]
    commute_x: Float[Array, "k_x e k_x"]
    commute_y: Float[Array, "k_y e k_y"]
    weight_e: Float[Array, " e"]


class Fit(NamedTuple):
    """C_yx: the functional map, constants to constants.

    residual: norm of the energy's gradient in C, entries scaled by its curvature,
        relative to that at C = (constant to constant, 0 elsewhere); 0 is exact.
    """

    C_yx: Float[Array, "k_x k_y"]
    residual: Float[Array, ""]


@partial(jax.jit, static_argnames=("k", "solver", "gamma"))
def fit(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = DEFAULT,
    *,
    k: int = 30,
    solver: Literal["jaxopt", "lineax"] = "jaxopt",
    gamma: float = GAMMA,
) -> Fit:
    """The functional map C_yx (k, k) that best carries desc_y to desc_x.

    Args:
        spec_x, spec_y: spectra with k eigenpairs or more, faces wound outward. Without
            faces on either side the orientation term says nothing.
        desc_x, desc_y: column i of one corresponds to column i of the other. Each is
            centred and scaled to variance 1, both shapes with the same factor.
        weights: of the four terms; traced, so a sweep compiles once.
        k: size of the map.
        solver: conjugate gradients by "jaxopt", or the same by "lineax".
        gamma: exponent of the resolvent mask.

    Returns:
        The minimum, and how far from it the solver stopped (about 1e-10 in float64,
        1e-5 in float32). Gradients flow through spectra, descriptors and weights.

    Raises:
        ValueError: the descriptors do not fit the shapes or each other, k is below 2 or
            more than the eigenpairs there are, or `solver` is unknown.
    """
    problem = terms(spec_x, spec_y, desc_x, desc_y, weights, k=k, gamma=gamma)
    return solve(problem, solver=solver)


@partial(jax.jit, static_argnames=("k", "gamma"))
def terms(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = DEFAULT,
    *,
    k: int = 30,
    gamma: float = GAMMA,
) -> Terms:
    """The problem that `fit` solves; arguments and errors as there."""
    for name, desc, spec in (("x", desc_x, spec_x), ("y", desc_y, spec_y)):
        if desc.ndim != 2 or len(desc) != len(spec.mass):
            raise ValueError(
                f"fit: desc_{name} is {desc.shape}, the shape has {len(spec.mass)} "
                "vertices"
            )
        if not 2 <= k <= len(spec.evals):
            raise ValueError(
                f"fit: k is {k}, spec_{name} has {len(spec.evals)} eigenpairs"
            )
    if desc_x.shape[1] != desc_y.shape[1]:
        raise ValueError(
            f"fit: desc_x has {desc_x.shape[1]} columns, desc_y {desc_y.shape[1]}"
        )
    of_shape = partial(shape_terms, k=k)
    sides = map_sides(of_shape, (spec_x, desc_x), (spec_y, desc_y))
    return combine(*sides, weights, gamma=gamma)


@partial(jax.jit, static_argnames="k")
def shape_terms(
    spec: Spectrum, descriptors: Float[Array, "n d"], *, k: int
) -> ShapeTerms:
    """What the energy reads of one shape; 2 <= k <= its eigenpairs."""
    phi, mass = spec.evecs[:, :k], spec.mass
    mean = einsum("n,nd->d", mass, descriptors)
    centred = descriptors - mean[None]
    variance = einsum("n,nd->d", mass, centred**2)
    coef = einsum("na,n,nd->ad", phi, mass, centred)
    times = einsum("na,n,nd,nb->adb", phi, mass, centred, phi)
    return ShapeTerms(spec.evals[:k], mean, variance, coef, times, brackets(spec, k=k))


@partial(jax.jit, static_argnames="gamma")
def combine(
    x: ShapeTerms, y: ShapeTerms, weights: Weights = DEFAULT, *, gamma: float = GAMMA
) -> Terms:
    """The problem of two shapes; weights are traced."""
    dtype = x.coef.dtype
    # Descriptors get mean square 1 over both shapes, by one factor for both, so that
    # their strength stays comparable.
    limits = jnp.finfo(dtype)
    # A constant column leaves rounding errors, which must not be scaled up.
    noise = (100 * limits.eps) ** 2 * (x.mean**2 + y.mean**2)
    norm = jnp.sqrt(x.variance / 2 + y.variance / 2 + noise + limits.tiny)

    def operators(side: ShapeTerms):
        coef = side.coef / norm[None]
        turn = einsum("cab,ad->cdb", side.brackets, coef)
        return coef, side.times / norm[None, :, None], turn

    (coef_x, times_x, turn_x), (coef_y, times_y, turn_y) = map_sides(
        operators, (x,), (y,)
    )
    # C times_y = times_x C and, if orientation is kept, C turn_y = turn_x C. A map that
    # mirrors reverses the sign of one side.
    w = Weights(*(jnp.asarray(w, dtype) for w in weights))
    sign = jnp.where(w.orientation < 0, -1, 1).astype(dtype)
    w = Weights(*(jnp.where(w < 0, -w, w) for w in w))
    mask = _resolvent_gap(x.evals, y.evals, gamma)
    ones = jnp.ones(coef_x.shape[1], dtype)
    return Terms(
        coef_x,
        coef_y,
        w.descriptors * len(mask) * _inverse(jnp.sum(coef_x**2 + coef_y**2) / 2),
        w.laplacian * mask * _inverse(jnp.mean(mask)),
        jnp.concatenate([times_x, sign * turn_x], 1),
        jnp.concatenate([times_y, turn_y], 1),
        jnp.concatenate(
            [
                w.multiplication * len(mask) * _inverse(_size(times_x, times_y)) * ones,
                w.orientation * len(mask) * _inverse(_size(turn_x, turn_y)) * ones,
            ]
        ),
    )


@partial(jax.jit, static_argnames="solver")
def solve(problem: Terms, *, solver: Literal["jaxopt", "lineax"] = "jaxopt") -> Fit:
    """Minimise the energy of `problem`; the first column of C is fixed to (1, 0, ...).

    Entries that the energy does not see are 0.

    Raises:
        ValueError: `solver` is unknown.
    """
    k_x, k_y = problem.mask.shape
    dtype = problem.mask.dtype
    constant = jnp.zeros((k_x, k_y), dtype).at[0, 0].set(1)
    # Scaled by the curvature, conjugate gradients need far fewer steps. The minimum
    # does not depend on it.
    curvature = jax.lax.stop_gradient(_diagonal(problem)[:, 1:])
    known = curvature > 0
    scale = jnp.where(known, jax.lax.rsqrt(jnp.where(known, curvature, 1)), 0)

    def to_map(free):
        return jnp.pad(free * scale, ((0, 0), (1, 0)))

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
        unit = target * _inverse(size)
        free = lineax.linear_solve(operator, unit, method, throw=False).value * size
    else:
        raise ValueError(f"solve: solver is 'jaxopt' or 'lineax', not {solver!r}")
    gap = jnp.sum((target - normal(free)) ** 2) * _inverse(jnp.sum(target**2))
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


def _resolvent_gap(evals_x, evals_y, gamma):
    top = jnp.maximum(evals_x[-1], evals_y[-1])
    re_x, im_x = _resolvent(evals_x / top, gamma)
    re_y, im_y = _resolvent(evals_y / top, gamma)
    return (re_x[:, None] - re_y[None]) ** 2 + (im_x[:, None] - im_y[None]) ** 2


def _resolvent(evals, gamma):
    # The derivative of a root is infinite at 0.
    power = jnp.where(evals > 0, evals, 1) ** gamma  # type: ignore
    power = jnp.asarray(jnp.where(evals > 0, power, 0))
    return power / (power**2 + 1), 1 / (power**2 + 1)


def _size(ops_x, ops_y):
    return (jnp.sum(ops_x**2) + jnp.sum(ops_y**2)) / 2


def _inverse(size: Array) -> Array:
    # 0 for a term without entries.
    return safe_divide(1.0, size)
