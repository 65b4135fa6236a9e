"""What the fits to descriptors read: both shapes' terms of the energy.

The energy of Nogneng and Ovsjanikov (2017) and Ren et al. (2018, 2019): descriptors are
preserved, C commutes with the Laplacians (resolvent mask), with multiplication by
descriptors, and with the oriented product of gradients. All four are linear in C.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf._exported import exported
from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.array._precision import safe_divide
from jfsf.spectral._orientation import brackets
from jfsf.types import Spectrum

GAMMA = 0.5  # exponent of the resolvent mask, as in Ren et al. (SGP 2019)


@exported
class Weights(NamedTuple):
    """Weights of the four terms of the energy, each of which has order 1 before.

    descriptors: weight of the term that preserves descriptors.
    laplacian: weight of the term that commutes with the Laplacians.
    multiplication: weight of the term that commutes with multiplication by descriptors.
    orientation: weight of the term that preserves orientation; negative asks for a
        mirrored map. The sign of the other weights does not matter.
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
    brackets: oriented products of eigenfunctions, see `brackets`.
    """

    evals: Float[Array, " k"]
    mean: Float[Array, " d"]
    variance: Float[Array, " d"]
    coef: Float[Array, "k d"]
    times: Float[Array, "k d k"]
    brackets: Float[Array, "k k k"]


class Terms(NamedTuple):
    """The energy that `solve` minimises over C, weights included:

    E(C) = weight_desc |C coef_y - coef_x|^2 + sum(mask C^2)
           + sum_e weight_e |C commute_y[:, e] - commute_x[:, e] C|^2,

    with Frobenius norms. `combine` says what the arrays are.

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


@jit(static_argnames=("k", "gamma"))
def terms(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    weights: Weights = DEFAULT,
    *,
    k: int = 30,
    gamma: float = GAMMA,
    column_weights: Float[Array, " d"] | None = None,
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
    return combine(*sides, weights, column_weights, gamma=gamma)


@jit(static_argnames="k")
def shape_terms(
    spec: Spectrum, descriptors: Float[Array, "n d"], *, k: int
) -> ShapeTerms:
    """What the energy reads of one shape; 2 <= k <= its eigenpairs."""
    phi, mass = spec.evecs[:, :k], spec.mass
    mean = einsum("n,nd->d", mass, descriptors)
    centred = descriptors - mean[None]
    variance = einsum("n,nd->d", mass, centred**2)
    coef = einsum("na,n,nd->ad", phi, mass, centred)

    # All descriptors at once would take k d numbers a vertex.
    def times_one(column):
        return matmul((phi * (mass * column)[:, None]).T, phi)

    times = jax.lax.map(times_one, centred.T).swapaxes(0, 1)
    return ShapeTerms(spec.evals[:k], mean, variance, coef, times, brackets(spec, k=k))


@jit(static_argnames="gamma")
def combine(
    x: ShapeTerms,
    y: ShapeTerms,
    weights: Weights = DEFAULT,
    column_weights: Float[Array, " d"] | None = None,
    *,
    gamma: float = GAMMA,
) -> Terms:
    """The problem of two shapes; weights are traced. See `fit` for the arguments.

    With A and B the coefficients of the descriptors of X and of Y, (k, d), centred,
    scaled to mean square 1 and weighted by `column_weights`, the energy is

        E(C) = k w_1 / |A, B|^2 |C B - A|^2
               + w_2 / mean(M) sum_ij M_ij C_ij^2
               + k w_3 / |F, G|^2 sum_e |C G_e - F_e C|^2
               + k w_4 / |P, Q|^2 sum_e |C Q_e - s P_e C|^2,

    |A, B|^2 = (|A|^2 + |B|^2) / 2, w the sizes of the four weights, s the sign of the
    fourth. F_e and G_e multiply by descriptor e, P_e and Q_e are f -> {A_e, f}
    (`brackets`), all in the eigenbases. M is the resolvent mask (Ren et
    al., SGP 2019), with x = (eigenvalue / the largest)^gamma of either shape:

        M_ij = |1 / (x_i - sqrt(-1)) - 1 / (y_j - sqrt(-1))|^2.
    """
    dtype, number = x.coef.dtype, x.coef.shape[1]
    if column_weights is not None and column_weights.shape != (number,):
        raise ValueError(
            f"fit: column_weights are {column_weights.shape}, there are {number} "
            "descriptors"
        )
    # Descriptors get mean square 1 over both shapes, by one factor for both, so that
    # their strength stays comparable.
    limits = jnp.finfo(dtype)
    # A constant column leaves rounding errors, which must not be scaled up.
    noise = (100 * limits.eps) ** 2 * (x.mean**2 + y.mean**2)
    norm = jnp.sqrt(x.variance / 2 + y.variance / 2 + noise + limits.tiny)
    ones = jnp.ones(number, dtype)
    strength = ones if column_weights is None else column_weights.astype(dtype)

    def operators(side: ShapeTerms):
        coef = side.coef / norm[None] * strength[None]
        turn = einsum("cab,ad->cdb", side.brackets, coef)
        times = side.times / norm[None, :, None] * strength[None, :, None]
        return coef, times, turn

    (coef_x, times_x, turn_x), (coef_y, times_y, turn_y) = map_sides(
        operators, (x,), (y,)
    )
    # C times_y = times_x C and, if orientation is kept, C turn_y = turn_x C. A map that
    # mirrors reverses the sign of one side.
    w = Weights(*(jnp.asarray(w, dtype) for w in weights))
    sign = jnp.where(w.orientation < 0, -1, 1).astype(dtype)
    w = Weights(*(jnp.where(w < 0, -w, w) for w in w))
    mask = _resolvent_gap(x.evals, y.evals, gamma)
    return Terms(
        coef_x,
        coef_y,
        w.descriptors * len(mask) * inverse(jnp.sum(coef_x**2 + coef_y**2) / 2),
        w.laplacian * mask * inverse(jnp.mean(mask)),
        jnp.concatenate([times_x, sign * turn_x], 1),
        jnp.concatenate([times_y, turn_y], 1),
        jnp.concatenate(
            [
                w.multiplication * len(mask) * inverse(_size(times_x, times_y)) * ones,
                w.orientation * len(mask) * inverse(_size(turn_x, turn_y)) * ones,
            ]
        ),
    )


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


def inverse(size: Array) -> Array:
    """1 / size, and 0 for a term without entries."""
    return safe_divide(1.0, size)
