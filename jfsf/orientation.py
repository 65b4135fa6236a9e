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


@partial(jax.jit, static_argnames="k")
def brackets(spec: Spectrum, *, k: int) -> Float[Array, "k k k"]:
    """B[c, a, b] = integral of phi_c {phi_a, phi_b}; zeros for a point cloud.

    Antisymmetric in a and b. Faces must be wound outward (`mesh.orient`).
    """
    phi = spec.evecs[:, :k]
    corner = [phi[spec.faces[:, i]] for i in range(3)]
    mean = (corner[0] + corner[1] + corner[2]) / 3
    d1, d2 = corner[1] - corner[0], corner[2] - corner[0]
    half = jnp.einsum("fc,fa,fb->cab", mean, d1, d2, optimize="optimal") / 2
    return half - half.transpose(0, 2, 1)


@jax.jit
def score(
    C_yx: Float[Array, "k_x k_y"],
    brackets_x: Float[Array, "s s s"],
    brackets_y: Float[Array, "s s s"],
) -> Float[Array, ""]:
    """Correlation of brackets pulled back with brackets of what is pulled back.

    Near +1 for an isometry that preserves orientation, -1 for one that mirrors, nan
    where there are no faces. It does not change when eigenvectors change sign or turn
    inside a repeated eigenspace (C_yx with them), but for the cut at `PULLED`.

    Args:
        C_yx: functions on Y pulled back to X.
        brackets_x, brackets_y: of `SEEN` eigenfunctions or as many as C_yx has.
    """
    seen = min(len(brackets_x), len(brackets_y), *C_yx.shape)
    pulled = min(PULLED + 1, seen)
    C = C_yx[:seen, :seen]
    low = C[:, 1:pulled]
    on_x = jnp.einsum("cab,ai,bj->cij", brackets_x[:seen, :seen, :seen], low, low)
    on_y = jnp.einsum("cd,dij->cij", C, brackets_y[:seen, 1:pulled, 1:pulled])
    norm = jnp.sqrt(jnp.sum(on_x**2) * jnp.sum(on_y**2))
    return jnp.where(norm > 0, jnp.sum(on_x * on_y) / norm, jnp.nan)
