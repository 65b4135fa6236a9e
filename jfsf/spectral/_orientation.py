"""Which way round is a map? The oriented product of gradients, in the eigenbasis.

{f, g} = n . (grad f x grad g) changes sign under a map that mirrors, and commutes with
pull-back under one that does not (Ren et al., SIGGRAPH Asia 2018). On a triangle it is
df ^ dg over twice the area, so its integral needs the winding of the faces only: no
normals, no lengths.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._loops import varying_as
from jfsf.types import Spectrum

FUNCTIONS = 20  # eigenfunctions in which brackets are expressed
PULLED_BACK = 8  # eigenfunctions of Y that are pulled back, without the constant
# Root mean square of an appended column of brackets; a descriptor's is 1.
COLUMN_WEIGHT = 0.3
BLOCK = 512  # faces at a time, so that their products stay in the cache


@jit(static_argnames="k")
def brackets(spec: Spectrum, *, k: int) -> Float[Array, "k k k"]:
    """B[c, a, b] = integral of phi_c {phi_a, phi_b}, of the first k eigenfunctions.

    Exact for functions linear on each face; antisymmetric in a and b; no unit.

    Args:
        spec: faces wound outward (`jfsf.mesh.orient`); padding faces add nothing.
        k: at most its eigenpairs.

    Returns:
        The tensor; zeros for a point cloud.

    Raises:
        ValueError: there are fewer than k eigenpairs.
    """
    if not 1 <= k <= spec.evecs.shape[1]:
        raise ValueError(
            f"brackets: k is {k}, there are {spec.evecs.shape[1]} eigenpairs"
        )
    phi = spec.evecs[:, :k]

    def add(half, faces):
        first, second, third = (phi[faces[:, i]] for i in range(3))
        mean, d1, d2 = (first + second + third) / 3, second - first, third - first
        pairs = mean.T[:, None] * d1.T[None]
        return half + einsum("caf,fb->cab", pairs, d2), None

    # Faces of one vertex fill the last block; they add nothing.
    blocks = jnp.pad(spec.faces, ((0, -len(spec.faces) % BLOCK), (0, 0)))
    half = varying_as(jnp.zeros((k, k, k), phi.dtype), phi, blocks)
    half = jax.lax.scan(add, half, blocks.reshape(-1, BLOCK, 3))[0] / 2
    return half - half.transpose(0, 2, 1)


@jit(static_argnames="pulled_back")
def orientation_score(
    C_yx: Float[Array, "k_x k_y"],
    brackets_x: Float[Array, "s_x s_x s_x"],
    brackets_y: Float[Array, "s_y s_y s_y"],
    *,
    pulled_back: int = PULLED_BACK,
) -> Float[Array, ""]:
    """Correlation of brackets pulled back with brackets of what is pulled back.

    s = <P, Q> / (|P| |Q|), over c < r and 1 <= i, j <= `pulled_back`, with

        P[c, i, j] = sum_ab B_x[c, a, b] C[a, i] C[b, j],   {C f_i, C f_j} on X,
        Q[c, i, j] = sum_d C[c, d] B_y[d, i, j],            C {f_i, f_j},

    f_i the eigenfunctions of Y and all indices below r, the size of the smallest of C
    and the brackets. With s_x = s_y the score does not change when
    eigenvectors change sign, or are rotated among the first s_x of X, the first
    `pulled_back` of Y, or the rest of the first s_y of Y, and C_yx with them.

    Args:
        C_yx: functions on Y pulled back to X.
        brackets_x, brackets_y: `brackets` of both shapes.
        pulled_back: eigenfunctions of Y, the constant left out.

    Returns:
        In [-1, 1]: near +1 for an isometry that preserves orientation, -1 for one that
        mirrors, nan where there are no faces.
    """
    size = min(len(brackets_x), len(brackets_y), *C_yx.shape)
    end = min(pulled_back + 1, size)
    C = C_yx[:size, :size]
    low = C[:, 1:end]
    on_x = einsum("cab,ai,bj->cij", brackets_x[:size, :size, :size], low, low)
    on_y = einsum("cd,dij->cij", C, brackets_y[:size, 1:end, 1:end])
    norm = jnp.sqrt(jnp.sum(on_x**2) * jnp.sum(on_y**2))
    return jnp.where(norm > 0, jnp.sum(on_x * on_y) / norm, jnp.nan)


@jit(static_argnames="k")
def bracket_fields(spec: Spectrum, *, k: int = FUNCTIONS) -> Float[Array, "n s s"]:
    """{phi_a, phi_b} at each vertex, of the first k eigenfunctions, smoothed.

    Each is projected on the same k eigenfunctions. Zeros for a point cloud.
    """
    return at_vertices(spec, brackets(spec, k=min(k, len(spec.evals))))


def at_vertices(
    spec: Spectrum, brackets: Float[Array, "s s s"]
) -> Float[Array, "n s s"]:
    """`brackets`, coefficients in the eigenbasis, as values at each vertex."""
    return einsum("nc,cab->nab", spec.evecs[:, : len(brackets)], brackets)


def carried_fields(
    C_yx: Float[Array, "k_x k_y"],
    field_x: Float[Array, "n_x s s"],
    field_y: Float[Array, "n_y t t"],
    mass_y: Float[Array, " n_y"],
    size: Array | int,
) -> tuple[Float[Array, "n_x p"], Float[Array, "n_y p"]]:
    """Columns that agree where a map keeps orientation, and differ in sign where not.

    On Y they are the brackets of pairs of its first eigenfunctions. On X they are the
    brackets of those functions pulled back by C_yx. The normals in front and behind on
    a thin body are opposite, so these columns tell front from back.

    Args:
        C_yx: functions on Y pulled back to X.
        field_x, field_y: `bracket_fields`.
        mass_y: 0 on padding.
        size: eigenfunctions of Y that C_yx maps; may be traced. Columns of the others
            are 0.

    Returns:
        Columns to append to the embeddings.
    """
    end = min(PULLED_BACK + 1, field_y.shape[1], C_yx.shape[1])
    low = C_yx[: field_x.shape[1], 1:end]
    rows = len(low)
    on_x = einsum("nij,ia,jb->nab", field_x[:, :rows, :rows], low, low)
    a, b = jnp.triu_indices(end - 1, 1)
    on_x, on_y = on_x[:, a, b], field_y[:, 1:end, 1:end][:, a, b]
    square = matmul(mass_y, on_y**2)
    known = (b + 1 < size) & (square > 0)
    scale = jnp.where(known, COLUMN_WEIGHT / jnp.sqrt(jnp.where(known, square, 1)), 0)
    return on_x * scale[None], on_y * scale[None]
