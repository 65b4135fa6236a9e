"""Maps <-> functional maps, and the embeddings that converters compare.

C_YX = Phi_X^+ Phi_Y[T_XY] (eq. 4 of Pai et al., CVPR 2021) pulls functions on Y back to
X; its transpose D_XY maps delta functions of X to delta functions of Y.
"""

from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.types import Spectrum

Space = Literal["adjoint", "direct"]


@jit
def functional_map(
    T_xy: Int[Array, " n_x"], spec_x: Spectrum, spec_y: Spectrum
) -> Float[Array, "k_x k_y"]:
    """C_yx of a map from X to Y: Phi_X^+ Phi_Y[T_xy] (eq. 4 of Pai et al., CVPR 2021).

    Args:
        T_xy: the vertex of Y for each vertex of X.
        spec_x, spec_y: spectra; also of samples (`jfsf.spectral.restrict`), whose
            eigenvectors are no longer orthonormal: the pseudo-inverse is the weighted
            least squares one. X needs as many vertices as eigenpairs, or more.

    Raises:
        ValueError: T_xy does not have one entry for each vertex of X, or X has fewer
            vertices than eigenpairs.
    """
    if T_xy.shape != (len(spec_x.evecs),):
        raise ValueError(
            f"functional_map: T_xy has shape {T_xy.shape}, X has "
            f"{len(spec_x.evecs)} vertices"
        )
    return coefficients(spec_y.evecs[T_xy], spec_x)


@jit
def coefficients(values: Float[Array, "n c"], spec: Spectrum) -> Float[Array, "k c"]:
    """Phi^+ values: functions in an eigenbasis, by weighted least squares.

    Raises:
        ValueError: fewer vertices than eigenpairs.
    """
    n, k = spec.evecs.shape
    if n < k:
        raise ValueError(
            f"a basis of {k} eigenfunctions is read at {n} points, which do not tell "
            f"them apart; take {k} points or more, or fewer functions"
        )
    weighted = spec.evecs * spec.mass[:, None]
    right = matmul(weighted.T, values)
    return jax.scipy.linalg.solve(matmul(weighted.T, spec.evecs), right, assume_a="pos")


@jit(static_argnames="space")
def embeddings(
    C_yx: Float[Array, "k_x k_y"],
    evecs_x: Float[Array, "n_x k"],
    evecs_y: Float[Array, "n_y l"],
    *,
    space: Space = "adjoint",
) -> tuple[Float[Array, "n_x d"], Float[Array, "n_y d"]]:
    """The aligned embeddings (emb_x, emb_y) whose rows a converter compares.

    "adjoint" is (Phi_X C_yx, Phi_Y): eqs. 5 and 10 of Pai et al. (CVPR 2021), exact for
    delta functions. "direct" is (Phi_X, Phi_Y C_yx^T): the space of ZoomOut and older
    work, which holds up when C_yx loses rank. Where C_yx is orthonormal they agree.
    Eigenvectors beyond C_yx's size are left out.

    Raises:
        ValueError: C_yx is larger than the bases, or `space` is unknown.
    """
    k_x, k_y = C_yx.shape
    if k_x > evecs_x.shape[1] or k_y > evecs_y.shape[1]:
        raise ValueError(
            f"embeddings: C_yx is {C_yx.shape}, the bases have {evecs_x.shape[1]} and "
            f"{evecs_y.shape[1]} eigenvectors"
        )
    evecs_x, evecs_y = evecs_x[:, :k_x], evecs_y[:, :k_y]
    if space == "adjoint":
        return matmul(evecs_x, C_yx), evecs_y
    if space == "direct":
        return evecs_x, matmul(evecs_y, C_yx.T)
    raise ValueError(f"embeddings: space is 'adjoint' or 'direct', not {space!r}")


@jit
def polar(C_yx: Float[Array, "k_x k_y"]) -> Float[Array, "k_x k_y"]:
    """The nearest matrix with orthonormal columns (or rows): U V^T of the SVD.

    A matrix without full rank has many such; one of them is returned.
    """
    return _polar(C_yx)


@jax.custom_jvp
def _polar(C_yx):
    u, _, vt = jnp.linalg.svd(C_yx, full_matrices=False)
    return matmul(u, vt)


@_polar.defjvp
def _polar_slope(primals, tangents):
    """Smooth where C has full rank; that of the SVD is not, where values repeat."""
    (C,), (slope,) = primals, tangents
    u, sizes, vt = jnp.linalg.svd(C, full_matrices=False)
    inner = matmul(matmul(u.T, slope), vt.T)
    turn = safe_divide(inner - inner.T, sizes[:, None] + sizes[None, :])
    change = matmul(matmul(u, turn), vt)
    # What leaves the span of the columns, or of the rows; one of the two is 0.
    shrink = matmul(vt.T * safe_divide(jnp.ones_like(sizes), sizes)[None], vt)
    change += matmul(slope - matmul(u, matmul(u.T, slope)), shrink)
    shrink = matmul(u * safe_divide(jnp.ones_like(sizes), sizes)[None], u.T)
    change += matmul(shrink, slope - matmul(matmul(slope, vt.T), vt))
    return matmul(u, vt), change


def truncate(spec: Spectrum, k: int) -> Spectrum:
    """The spectrum with its first k eigenpairs only."""
    if not 1 <= k <= len(spec.evals):
        raise ValueError(f"truncate: k is {k}, there are {len(spec.evals)} eigenpairs")
    return spec._replace(evals=spec.evals[:k], evecs=spec.evecs[:, :k])


def truncate_pair(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Cut both spectra to the number of eigenpairs of the shorter one."""
    k = min(len(spec_x.evals), len(spec_y.evals))
    return truncate(spec_x, k), truncate(spec_y, k)


def uniform(mass: Float[Array, " n"]) -> Float[Array, " n"]:
    """Equal weight on every vertex, none on padding; sums to 1."""
    real = (mass > 0).astype(mass.dtype)
    return real / real.sum()
