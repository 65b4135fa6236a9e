"""Which way round is a map? The oriented product of gradients, in the eigenbasis.

{f, g} = n . (grad f x grad g) changes sign under a map that mirrors, and commutes with
pull-back under one that does not (Ren et al., SIGGRAPH Asia 2018). On a triangle it is
df ^ dg over twice the area, so its integral needs the winding of the faces only: no
normals, no lengths.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.types import Spectrum

PULLED = 8  # functions of Y pulled back, the constant left out
SEEN = 20  # functions of X that see them
BLOCK = 512  # faces at a time: their products stay in cache

MATTERS = 0.3  # root mean square of an oriented column; a descriptor's is 1

_einsum = partial(jnp.einsum, optimize="optimal", precision=jax.lax.Precision.HIGHEST)


@partial(jax.jit, static_argnames="k")
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
    corner = [phi[spec.faces[:, i]] for i in range(3)]
    mean = (corner[0] + corner[1] + corner[2]) / 3
    d1, d2 = corner[1] - corner[0], corner[2] - corner[0]

    def add(half, faces):
        mean, d1, d2 = faces
        pairs = mean.T[:, None] * d1.T[None]
        return half + _einsum("caf,fb->cab", pairs, d2), None

    half = jnp.zeros((k, k, k), phi.dtype)
    half = jax.lax.scan(add, half, tuple(map(_in_blocks, (mean, d1, d2))))[0] / 2
    return half - half.transpose(0, 2, 1)


def _in_blocks(values: Float[Array, "m k"]) -> Float[Array, "b f k"]:
    filled = jnp.pad(values, ((0, -len(values) % BLOCK), (0, 0)))
    return filled.reshape(-1, BLOCK, values.shape[1])


@jax.jit
def score(
    C_yx: Float[Array, "k_x k_y"],
    brackets_x: Float[Array, "s_x s_x s_x"],
    brackets_y: Float[Array, "s_y s_y s_y"],
) -> Float[Array, ""]:
    """Correlation of brackets pulled back with brackets of what is pulled back.

    The brackets of pairs of the first `PULLED` functions of Y, each as a function in
    the basis of X. With as many functions on both sides it does not change when
    eigenvectors change sign or turn among the first of X, or among the `PULLED` or the
    rest of the first of Y, and C_yx with them.

    Args:
        C_yx: functions on Y pulled back to X.
        brackets_x, brackets_y: of `SEEN` eigenfunctions (the "first" above), or of as
            many as C_yx has.

    Returns:
        In [-1, 1]: near +1 for an isometry that preserves orientation, -1 for one that
        mirrors, nan where there are no faces.
    """
    seen = min(len(brackets_x), len(brackets_y), *C_yx.shape)
    pulled = min(PULLED + 1, seen)
    C = C_yx[:seen, :seen]
    low = C[:, 1:pulled]
    on_x = _einsum("cab,ai,bj->cij", brackets_x[:seen, :seen, :seen], low, low)
    on_y = _einsum("cd,dij->cij", C, brackets_y[:seen, 1:pulled, 1:pulled])
    norm = jnp.sqrt(jnp.sum(on_x**2) * jnp.sum(on_y**2))
    return jnp.where(norm > 0, jnp.sum(on_x * on_y) / norm, jnp.nan)


@jax.jit
def bracket_fields(spec: Spectrum) -> Float[Array, "n s s"]:
    """{phi_a, phi_b} at each vertex, of the first `SEEN` eigenfunctions, smoothed.

    Each is projected on as many eigenfunctions. Zeros for a point cloud.
    """
    return at_vertices(spec, brackets(spec, k=min(SEEN, len(spec.evals))))


def at_vertices(spec: Spectrum, wound: Float[Array, "s s s"]) -> Float[Array, "n s s"]:
    """`brackets`, functions in the eigenbasis, at each vertex."""
    return _einsum("nc,cab->nab", spec.evecs[:, : len(wound)], wound)


def carried_fields(
    C_yx: Float[Array, "k_x k_y"],
    field_x: Float[Array, "n_x s s"],
    field_y: Float[Array, "n_y t t"],
    mass_y: Float[Array, " n_y"],
    size: Array | int,
) -> tuple[Float[Array, "n_x p"], Float[Array, "n_y p"]]:
    """Columns that agree where a map keeps orientation, and differ in sign where not.

    Beside the brackets of pairs of Y's first `PULLED` eigenfunctions, as functions on
    Y, stand those of what C_yx pulls back, on X. A point and the one behind it on a
    thin body have normals that oppose, so these tell front from back.

    Args:
        C_yx: functions on Y pulled back to X.
        field_x, field_y: `bracket_fields`.
        mass_y: 0 on padding.
        size: functions of Y that C_yx knows; may be traced. Columns of the others are
            0.

    Returns:
        Columns to append to the embeddings, of root mean square `MATTERS` over Y.
    """
    pulled = min(PULLED + 1, field_y.shape[1], C_yx.shape[1])
    low = C_yx[: field_x.shape[1], 1:pulled]
    seen = len(low)
    on_x = _einsum("nij,ia,jb->nab", field_x[:, :seen, :seen], low, low)
    a, b = jnp.triu_indices(pulled - 1, 1)
    on_x, on_y = on_x[:, a, b], field_y[:, 1:pulled, 1:pulled][:, a, b]
    square = mass_y @ on_y**2
    known = (b + 1 < size) & (square > 0)
    scale = jnp.where(known, MATTERS / jnp.sqrt(jnp.where(known, square, 1)), 0)
    return on_x * scale[None], on_y * scale[None]
