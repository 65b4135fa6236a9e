"""Metrics of a functional map, or of aligned embeddings: pure jitted JAX that vmaps.

From section 5 of the paper (Pai et al. 2021) and its supplement. The authors measure on
spectra in mesh units, and ours have area 1. Dividing the lengths of a shape by
sqrt(area) multiplies its eigenvalues by area and its eigenfunctions by sqrt(area).
"""

from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._loops import varying_as
from jfsf.neighbours import neighbours


@jit
def orthogonality(C_yx: Float[Array, "k_x k_y"]) -> Float[Array, ""]:
    """|C^T C - I|_2, the spectral norm: 0 for an area-preserving map.

    At least 1 when k_x < k_y, where C^T C cannot have full rank. No unit.
    "Orthogonality" in table 2 of Pai et al. (CVPR 2021).

    Args:
        C_yx: functions on Y pulled back to X.

    Raises:
        ValueError: C_yx is not a matrix.
    """
    _matrix("orthogonality", C_yx)
    gram = matmul(C_yx.T, C_yx)
    return jnp.abs(
        jnp.linalg.eigvalsh(gram - jnp.eye(len(gram), dtype=gram.dtype))
    ).max()


@jit(static_argnames="ord")
def laplacian_commutativity(
    C_yx: Float[Array, "k_x k_y"],
    evals_x: Float[Array, " k_x"],
    evals_y: Float[Array, " k_y"],
    *,
    ord: Literal[2, "fro"] = 2,
) -> Float[Array, ""]:
    """|L_X C - C L_Y| / |C|: 0 for an isometry; in units of the eigenvalues.

    L_X and L_Y are the eigenvalues on a diagonal. "Laplacian commutativity" in table 2
    of Pai et al. (CVPR 2021).

    Args:
        C_yx: functions on Y pulled back to X.
        evals_x, evals_y: eigenvalues.
        ord: spectral norm (2), which the paper's tables use, or Frobenius ("fro").

    Raises:
        ValueError: shapes differ, or another `ord`.
    """
    if C_yx.shape != evals_x.shape + evals_y.shape:
        raise ValueError(
            f"laplacian_commutativity: C_yx is {C_yx.shape}, evals_x and evals_y are "
            f"{evals_x.shape} and {evals_y.shape}"
        )
    if ord not in (2, "fro"):
        raise ValueError(f"laplacian_commutativity: ord is {ord!r}, not 2 or 'fro'")
    gap = (evals_x[:, None] - evals_y[None, :]) * C_yx
    return jnp.linalg.norm(gap, ord) / jnp.linalg.norm(C_yx, ord)


@jit
def zoomout_energy(C_yx: Float[Array, "k_x k_y"]) -> Float[Array, ""]:
    """sum over k of |C_k^T C_k - I|_F / k, C_k the leading k by k block.

    k runs from 1 to min(k_x, k_y). "ZoomOut energy" in table 2 of Pai et al. (CVPR
    2021). After Melzi et al. (2019), who square the norm; that table does not. No unit.

    Args:
        C_yx: functions on Y pulled back to X.

    Raises:
        ValueError: C_yx is not a matrix.
    """
    _matrix("zoomout_energy", C_yx)
    k = min(C_yx.shape)
    eye = jnp.eye(k, dtype=C_yx.dtype)

    def step(gram: Array, i: Array):
        row = C_yx[i, :k]
        gram += row[:, None] * row[None, :]
        inside = jnp.arange(k) <= i
        gap = jnp.where(inside[:, None] & inside[None, :], gram - eye, 0)
        return gram, _root((gap * gap).sum()) / (i + 1).astype(gap.dtype)

    start = varying_as(jnp.zeros_like(eye), C_yx)
    return jax.lax.scan(step, start, jnp.arange(k))[1].sum()


@jit
def spectral_chamfer(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    *,
    mass_x: Float[Array, " n_x"] | None = None,
    mass_y: Float[Array, " n_y"] | None = None,
) -> Float[Array, ""]:
    """Mean distance from a row of emb_x to the nearest of emb_y, plus the converse.

    mean_i min_j |x_i - y_j| + mean_j min_i |x_i - y_j|, of rows x_i and y_j: "chamfer
    distance" in table 2 of Pai et al. (CVPR 2021).

    Symmetric and differentiable. The authors report sums in place of means, on spectra
    in mesh units: with n vertices on both shapes theirs is ours times
    n / sqrt(area of Y). Their tables appear to be in units of 10^4.

    Args:
        emb_x, emb_y: aligned embeddings; for the paper's numbers the adjoint ones,
            (Phi_X C_yx, Phi_Y), with C_yx the functional map of the map to be measured.
        mass_x, mass_y: 0 marks padding; the means are over the rest, unweighted.

    Raises:
        ValueError: widths differ, or a mass has another length.
    """
    if emb_x.ndim != 2 or emb_y.ndim != 2 or emb_x.shape[1] != emb_y.shape[1]:
        raise ValueError(
            f"spectral_chamfer: emb_x is {emb_x.shape}, emb_y is {emb_y.shape}"
        )
    for name, mass, emb in (("mass_x", mass_x, emb_x), ("mass_y", mass_y, emb_y)):
        if mass is not None and mass.shape != emb.shape[:1]:
            raise ValueError(
                f"spectral_chamfer: {name} is {mass.shape}, its embedding is "
                f"{emb.shape}"
            )
    forward = _mean_nearest(emb_x, emb_y, mass_x, mass_y)
    return forward + _mean_nearest(emb_y, emb_x, mass_y, mass_x)


def _matrix(name, C_yx):
    if C_yx.ndim != 2:
        raise ValueError(f"{name}: C_yx is {C_yx.shape}, expected (k_x, k_y)")


def _mean_nearest(queries: Array, points: Array, mass_queries, mass_points) -> Array:
    valid = None if mass_points is None else mass_points > 0
    # The index of the nearest point is piecewise constant: it has no gradient.
    fixed = jax.lax.stop_gradient((queries, points))
    nearest = neighbours(*fixed, valid, k0=1).idx[:, 0]
    dist = _root(jnp.sum((queries - points[nearest]) ** 2, 1))
    if mass_queries is None:
        return dist.mean()
    use = mass_queries > 0
    return jnp.where(use, dist, 0).sum() / use.sum().astype(dist.dtype)


def _root(x: Array) -> Array:
    # The gradient of sqrt at 0 is inf; here it is 0. nan stays nan.
    zero = x == 0
    return jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, x)))
