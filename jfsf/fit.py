"""Descriptors -> functional map C_yx, as the linear least-squares problem it is.

The energy of Nogneng and Ovsjanikov (2017) and Ren et al. (2018, 2019): descriptors are
preserved, C commutes with the Laplacians (resolvent mask), with multiplication by
descriptors, and with the oriented product of gradients. All four are linear in C, so
the minimum is exact, matrix-free, and differentiable through the optimality condition.

jaxopt is no longer maintained: this is the only file that imports it, and lineax stands
beside it behind the same function.
"""

import warnings
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.orientation import brackets
from jfsf.sides import both
from jfsf.types import Spectrum

GAMMA = 0.5  # exponent of the resolvent mask (Ren et al., SGP 2019)
MAX_STEPS = 2000

_einsum = partial(jnp.einsum, optimize="optimal", precision=jax.lax.Precision.HIGHEST)


class Weights(NamedTuple):
    """Weights of the four terms, each of which is normalised to order 1 first.

    Signs count for orientation alone: negative asks for a mirrored map.
    """

    descriptors: Float[Array, ""] | float = 1.0
    laplacian: Float[Array, ""] | float = 0.1
    multiplication: Float[Array, ""] | float = 1.0
    orientation: Float[Array, ""] | float = 1.0


DEFAULT = Weights()


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


@partial(jax.jit, static_argnames=("k", "solver"))
def fit(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = DEFAULT,
    *,
    k: int = 30,
    solver: Literal["jaxopt", "lineax"] = "jaxopt",
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

    Returns:
        The minimum, and how far from it the solver stopped (about 1e-10 in float64,
        1e-5 in float32). Gradients flow through spectra, descriptors and weights.

    Raises:
        ValueError: the descriptors do not fit the shapes or each other, k is below 2 or
            more than the eigenpairs there are, or `solver` is unknown.
    """
    return solve(terms(spec_x, spec_y, desc_x, desc_y, weights, k=k), solver=solver)


@partial(jax.jit, static_argnames="k")
def terms(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = DEFAULT,
    *,
    k: int = 30,
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
    dtype = spec_x.evecs.dtype
    desc_x, desc_y = _standard(desc_x, spec_x.mass, desc_y, spec_y.mass)

    def operators(spec, desc):
        phi = spec.evecs[:, :k]
        coef = _einsum("na,n,nd->ad", phi, spec.mass, desc)
        times = _einsum("na,n,nd,nb->adb", phi, spec.mass, desc, phi)
        return coef, times, _einsum("cab,ad->cdb", brackets(spec, k=k), coef)

    (coef_x, times_x, turn_x), (coef_y, times_y, turn_y) = both(
        operators, (spec_x, desc_x), (spec_y, desc_y)
    )
    # C times_y = times_x C and, where orientation is kept, C turn_y = turn_x C; a
    # mirrored map reverses the sign of one side.
    w = Weights(*(jnp.asarray(w, dtype) for w in weights))
    sign = jnp.where(w.orientation < 0, -1, 1).astype(dtype)
    w = Weights(*(jnp.where(w < 0, -w, w) for w in w))
    mask = _resolvent_gap(spec_x.evals[:k], spec_y.evals[:k])
    each = jnp.ones(coef_x.shape[1], dtype)
    return Terms(
        coef_x,
        coef_y,
        w.descriptors * k * _inverse(jnp.sum(coef_x**2 + coef_y**2) / 2),
        w.laplacian * mask * _inverse(jnp.mean(mask)),
        jnp.concatenate([times_x, sign * turn_x], 1),
        jnp.concatenate([times_y, turn_y], 1),
        jnp.concatenate(
            [
                w.multiplication * k * _inverse(_size(times_x, times_y)) * each,
                w.orientation * k * _inverse(_size(turn_x, turn_y)) * each,
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
    seen = curvature > 0
    scale = jnp.where(seen, jax.lax.rsqrt(jnp.where(seen, curvature, 1)), 0)

    def to_map(free):
        return jnp.pad(free * scale, ((0, 0), (1, 0)))

    def normal(free):
        return _half_gradient(problem, to_map(free))[:, 1:] * scale

    pull = problem.weight_desc * _einsum("ad,bd->ab", problem.coef_x, problem.coef_y)
    target = (pull - _half_gradient(problem, constant))[:, 1:] * scale
    tol = 1e-5 if dtype == jnp.float32 else 1e-10
    # Each takes half as long to import as all else; a program that is kept needs none.
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
        # Its relative tolerance is one for each entry: too strict for small ones.
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
    # The operator's number stands in the middle: each is one large matrix product.
    gap = _einsum("ab,bec->aec", C, y) - _einsum("aeb,bc->aec", x, C)
    gap = gap * w[None, :, None]
    seen = problem.weight_desc * _einsum("ab,bd->ad", C, problem.coef_y)
    return (
        _einsum("ad,bd->ab", seen, problem.coef_y)
        + problem.mask * C
        + _einsum("aec,bec->ab", gap, y)
        - _einsum("aeb,aec->bc", x, gap)
    )


def _diagonal(problem):
    """Diagonal of `_half_gradient`, entry by entry of C."""
    x, y, w = problem.commute_x, problem.commute_y, problem.weight_e
    own_x = _einsum("e,aeb->b", w, x**2)
    own_y = _einsum("e,bec->b", w, y**2)
    both = own_x[:, None] + own_y[None]
    cross = _einsum("e,aea,beb->ab", w, x, y)
    # What cancels must not leave a curvature of 0 or less.
    both = jnp.maximum(both - 2 * cross, 10 * jnp.finfo(both.dtype).eps * both)
    own = problem.weight_desc * jnp.sum(problem.coef_y**2, 1)
    return own[None] + problem.mask + both


def _resolvent_gap(evals_x, evals_y):
    top = jnp.maximum(evals_x[-1], evals_y[-1])
    re_x, im_x = _resolvent(evals_x / top)
    re_y, im_y = _resolvent(evals_y / top)
    return (re_x[:, None] - re_y[None]) ** 2 + (im_x[:, None] - im_y[None]) ** 2


def _resolvent(evals):
    # The slope of a root is infinite at 0.
    power = jnp.where(evals > 0, evals, 1) ** GAMMA  # type: ignore
    power = jnp.where(evals > 0, power, 0)
    return power / (power**2 + 1), 1 / (power**2 + 1)


def _standard(desc_x, mass_x, desc_y, mass_y):
    """Mean 0 on each shape, mean square 1 over both: strength stays comparable."""
    mean_x = _einsum("n,nd->d", mass_x, desc_x)
    mean_y = _einsum("n,nd->d", mass_y, desc_y)
    desc_x, desc_y = desc_x - mean_x[None], desc_y - mean_y[None]
    square = _einsum("n,nd->d", mass_x, desc_x**2) / 2
    square = square + _einsum("n,nd->d", mass_y, desc_y**2) / 2
    # A constant column leaves rounding errors: they must not be blown up.
    limits = jnp.finfo(square.dtype)
    noise = (100 * limits.eps) ** 2 * (mean_x**2 + mean_y**2)
    norm = jnp.sqrt(square + noise + limits.tiny)
    return desc_x / norm[None], desc_y / norm[None]


def _size(ops_x, ops_y):
    return (jnp.sum(ops_x**2) + jnp.sum(ops_y**2)) / 2


def _inverse(size: Array) -> Array:
    # 0 for a term that says nothing, and for its slope.
    found = size > 0
    return jnp.where(found, jnp.reciprocal(jnp.where(found, size, 1)), 0)
