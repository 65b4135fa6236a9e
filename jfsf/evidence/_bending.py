"""How well two shapes that were bent onto each other coincide."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import map_sides, matmul, safe_divide
from jfsf.geometry import normals
from jfsf.settings import EvidenceSettings
from jfsf.types import Filtered, Maps, Spectrum


@partial(jax.jit, static_argnames="rounding")
def bending_residual(
    maps: Filtered | Maps,
    moved_x: Float[Array, "n_x 3"],
    moved_y: Float[Array, "n_y 3"],
    spec_x: Spectrum,
    spec_y: Spectrum,
    *,
    rounding: float = EvidenceSettings().rounding,
) -> Float[Array, ""]:
    """Mean distance of a vertex, bent onto the other shape, from the surface there.

    In sqrt(area), over both shapes: r = (r_xy + r_yx) / 2,

        r_xy = max(0, sum_i a_i |n_j . (p_i - y_j)| - c h),  j = T_xy[i],

    a_i the share of a vertex in the area of X, p_i its position bent onto Y, y_j and
    n_j position and normal of its image at rest, h = sqrt(area of Y / its vertices) and
    c = `rounding`. r_yx is the same the other way.

    A wrong map asks for more than a surface that resists stretching gives, so it stays
    apart. The distance is along the normal of the vertex's image: along the surface it
    would be that of rounding to vertices. What rounding leaves along the normal is
    subtracted.

    Args:
        maps: between the vertices.
        moved_x, moved_y: positions of X deformed onto Y, and of Y deformed onto X.
        spec_x, spec_y: both at rest.
        rounding: see `jfsf.settings.EvidenceSettings`.

    Returns:
        0 or more; nan if one of them has no faces, or those of padding only, and so no
        normals.
    """
    if len(spec_x.faces) == 0 or len(spec_y.faces) == 0:
        return jnp.full((), jnp.nan, moved_x.dtype)

    def apart(mass, bent, target, faces, T, mass_target):
        outward = normals(target, faces)[T]
        gap = jnp.abs(jnp.sum((bent - target[T]) * outward, 1))
        real = jnp.sum((mass_target > 0).astype(mass.dtype))
        spacing = jnp.sqrt(safe_divide(mass_target.sum(), real))
        return jnp.maximum(matmul(mass, gap) / mass.sum() - rounding * spacing, 0)

    target_x = spec_x.vertices, spec_x.faces
    target_y = spec_y.vertices, spec_y.faces
    both = map_sides(
        apart,
        (spec_x.mass, moved_x, *target_y, maps.T_xy, spec_y.mass),
        (spec_y.mass, moved_y, *target_x, maps.T_yx, spec_x.mass),
    )
    surfaces = jnp.any(spec_x.faces) & jnp.any(spec_y.faces)
    return jnp.where(surfaces, jnp.mean(jnp.stack(both)), jnp.nan)
