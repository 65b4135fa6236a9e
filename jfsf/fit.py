"""Descriptors -> functional map C_yx, as the linear least-squares problem it is.

The energy of Nogneng and Ovsjanikov (2017) and Ren et al. (2018, 2019): descriptors are
preserved, C commutes with the Laplacians (resolvent mask), with multiplication by
descriptors, and with the oriented product of gradients. All four are linear in C, so the
minimum is exact, matrix-free, and differentiable through the optimality condition.

jaxopt is no longer maintained: this is the only file that imports it, and lineax stands
beside it behind the same function.
"""

import warnings
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import lineax
from jaxtyping import Array, Float

from jfsf.orientation import brackets
from jfsf.types import Spectrum

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from jaxopt.linear_solve import solve_normal_cg

GAMMA = 0.5  # exponent of the resolvent mask (Ren et al., SGP 2019)
MAX_STEPS = 2000


class Weights(NamedTuple):
    """Weights of the four terms, each of which is normalised to order 1 first.

    orientation: negative asks for a mirrored map.
    """

    descriptors: Float[Array, ""] | float = 1.0
    laplacian: Float[Array, ""] | float = 0.1
    multiplication: Float[Array, ""] | float = 1.0
    orientation: Float[Array, ""] | float = 1.0


class Terms(NamedTuple):
    """The least-squares problem: what C must carry to what, weights included."""

    coef_x: Float[Array, "k_x d"]
    coef_y: Float[Array, "k_y d"]
    mask: Float[Array, "k_x k_y"]
    commute_x: Float[Array, "e k_x k_x"]
    commute_y: Float[Array, "e k_y k_y"]


class Fit(NamedTuple):
    """C_yx: the functional map, constants to constants.

    residual: norm of the gradient at the solution, relative to the start's.
    """

    C_yx: Float[Array, "k_x k_y"]
    residual: Float[Array, ""]


@partial(jax.jit, static_argnames=("k", "solver"))
def fit(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = Weights(),  # noqa: B008
    *,
    k: int = 30,
    solver: Literal["jaxopt", "lineax"] = "jaxopt",
) -> Fit:
    """The functional map C_yx (k, k) that best carries desc_y to desc_x.

    Args:
        spec_x, spec_y: spectra with k eigenpairs or more.
        desc_x, desc_y: column i of one corresponds to column i of the other.
        weights: of the four terms; traced, so a sweep compiles once.

    Raises:
        ValueError: the descriptors do not fit the shapes or each other, k is more than
            the eigenpairs there are, or `solver` is unknown.
    """
    for name, desc, spec in (("x", desc_x, spec_x), ("y", desc_y, spec_y)):
        if len(desc) != len(spec.mass):
            raise ValueError(
                f"fit: desc_{name} has {len(desc)} rows, the shape has "
                f"{len(spec.mass)} vertices"
            )
        if not 2 <= k <= len(spec.evals):
            raise ValueError(
                f"fit: k is {k}, spec_{name} has {len(spec.evals)} eigenpairs"
            )
    if desc_x.shape[1] != desc_y.shape[1]:
        raise ValueError(
            f"fit: desc_x has {desc_x.shape[1]} columns, desc_y {desc_y.shape[1]}"
        )
    return solve(terms(spec_x, spec_y, desc_x, desc_y, weights, k=k), solver=solver)


@partial(jax.jit, static_argnames="k")
def terms(spec_x, spec_y, desc_x, desc_y, weights=Weights(), *, k: int = 30) -> Terms:  # noqa: B008
    """The problem that `fit` solves; arguments as there."""
    phi_x, phi_y = spec_x.evecs[:, :k], spec_y.evecs[:, :k]
    desc_x = _centre(desc_x, spec_x.mass)
    desc_y = _centre(desc_y, spec_y.mass)
    # One scale for both shapes: a difference in strength stays visible.
    norm = jnp.sqrt(
        (spec_x.mass @ desc_x**2 + spec_y.mass @ desc_y**2) / 2 + jnp.finfo(phi_x).tiny
    )
    desc_x, desc_y = desc_x / norm, desc_y / norm
    coef_x = (phi_x.T * spec_x.mass) @ desc_x
    coef_y = (phi_y.T * spec_y.mass) @ desc_y

    times_x = jnp.einsum("na,nd,nb->dab", phi_x * spec_x.mass[:, None], desc_x, phi_x)
    times_y = jnp.einsum("na,nd,nb->dab", phi_y * spec_y.mass[:, None], desc_y, phi_y)
    turn_x = jnp.einsum("cab,ad->dcb", brackets(spec_x, k=k), coef_x)
    turn_y = jnp.einsum("cab,ad->dcb", brackets(spec_y, k=k), coef_y)
    # C times_y = times_x C and, where orientation is kept, C turn_y = turn_x C; mirrored
    # maps reverse the sign of one side.
    sign = jnp.where(weights.orientation < 0, -1, 1).astype(turn_x.dtype)
    mask = _resolvent_mask(spec_x.evals[:k], spec_y.evals[:k])

    w = Weights(*(jnp.sqrt(jnp.abs(jnp.asarray(w, phi_x.dtype))) for w in weights))
    a = w.multiplication * _relative(times_x, times_y)
    b = w.orientation * _relative(turn_x, turn_y)
    d = w.descriptors / jnp.sqrt(jnp.mean(jnp.sum(coef_x**2 + coef_y**2, 0)) / 2)
    d = d * jnp.sqrt(jnp.asarray(k / desc_x.shape[1], phi_x.dtype))
    return Terms(
        d * coef_x,
        d * coef_y,
        w.laplacian * mask * k / jnp.linalg.norm(mask),
        jnp.concatenate([a * times_x, b * sign * turn_x]),
        jnp.concatenate([a * times_y, b * turn_y]),
    )


@partial(jax.jit, static_argnames="solver")
def solve(problem: Terms, *, solver: Literal["jaxopt", "lineax"] = "jaxopt") -> Fit:
    """Minimise |C coef_y - coef_x|^2 + |mask C|^2 + sum_e |C commute_y - commute_x C|^2.

    The first column of C is fixed: constants go to constants.
    """
    k_x, k_y = problem.mask.shape
    dtype = problem.mask.dtype
    constant = jnp.zeros((k_x, k_y), dtype).at[0, 0].set(1)
    scale = 1 / jnp.sqrt(_diagonal(problem)[:, 1:])

    def linear(free):
        # Scaled by the diagonal, conjugate gradients need far fewer steps.
        C = jnp.pad(free * scale, ((0, 0), (1, 0)))
        return (
            C @ problem.coef_y,
            problem.mask * C,
            C @ problem.commute_y - problem.commute_x @ C,
        )

    fixed = (
        problem.coef_x - constant @ problem.coef_y,
        -problem.mask * constant,
        problem.commute_x @ constant - constant @ problem.commute_y,
    )
    zero = jnp.zeros((k_x, k_y - 1), dtype)
    transposed = jax.linear_transpose(linear, zero)
    tol = 1e-5 if dtype == jnp.float32 else 1e-10
    if solver == "jaxopt":
        free = solve_normal_cg(linear, fixed, init=zero, tol=tol, maxiter=MAX_STEPS)
    elif solver == "lineax":
        normal = lineax.FunctionLinearOperator(
            lambda z: transposed(linear(z))[0],
            jax.ShapeDtypeStruct(zero.shape, dtype),
            lineax.positive_semidefinite_tag,
        )
        free = lineax.linear_solve(
            normal,
            transposed(fixed)[0],
            lineax.CG(rtol=tol, atol=0.0, max_steps=MAX_STEPS),
            throw=False,
        ).value
    else:
        raise ValueError(f"solve: solver is 'jaxopt' or 'lineax', not {solver!r}")
    start = transposed(fixed)[0]
    left = start - transposed(linear(free))[0]
    C_yx = constant + jnp.pad(free * scale, ((0, 0), (1, 0)))
    return Fit(C_yx, jnp.linalg.norm(left) / jnp.linalg.norm(start))


def _diagonal(problem: Terms):
    """Diagonal of the normal operator, entry by entry of C."""
    x, y = problem.commute_x, problem.commute_y
    cross = jnp.einsum("dii,djj->ij", x, y)
    return (
        jnp.sum(problem.coef_y**2, 1)[None, :]
        + problem.mask**2
        + jnp.sum(y**2, (0, 2))[None, :]
        + jnp.sum(x**2, (0, 1))[:, None]
        - 2 * cross
    )


def _resolvent_mask(evals_x, evals_y):
    top = jnp.maximum(evals_x[-1], evals_y[-1])
    re_x, im_x = _resolvent(evals_x / top)
    re_y, im_y = _resolvent(evals_y / top)
    gap = (re_x[:, None] - re_y) ** 2 + (im_x[:, None] - im_y) ** 2
    return jnp.sqrt(gap)


def _resolvent(evals):
    power = evals**GAMMA
    return power / (power**2 + 1), 1 / (power**2 + 1)


def _centre(desc, mass):
    return desc - mass @ desc


def _relative(ops_x, ops_y):
    """One over the size of the operators, a descriptor and a column of C at a time."""
    size = jnp.mean(jnp.sum(ops_x**2 + ops_y**2, (1, 2))) / 2
    found = size > 0
    count = len(ops_x) / ops_x.shape[1]
    return jnp.where(found, 1 / jnp.sqrt(jnp.where(found, size, 1) * count), 0)
