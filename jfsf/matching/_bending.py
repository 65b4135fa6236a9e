"""How well two shapes that were bent onto each other coincide, and at what cost."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.array._sides import map_sides
from jfsf.geometry import normals
from jfsf.geometry._stretches import log_stretches
from jfsf.matching._settings import EvidenceSettings
from jfsf.types import Filtered, Maps, Spectrum

# Of the area, the part of the triangles that is sheared most says most: a wrong map
# that is an isometry nearly everywhere tears a belt at a waist, or the root of a limb.
MOST_SHEARED = 0.01


class Bending(NamedTuple):
    """What is left when a wrong map is bent away, as means over both shapes.

    residual: distance between the bent shapes along the normal, in sqrt(area).
    shear: of triangles, all but `MOST_SHEARED` of the area is sheared less.
    area_std: standard deviation of the logarithm by which triangles grow.
    normal_gap: how far normals differ; 0 for none.
    """

    residual: Float[Array, ""]
    shear: Float[Array, ""]
    area_std: Float[Array, ""]
    normal_gap: Float[Array, ""]


@jit(static_argnames="rounding")
def bending(
    maps: Filtered | Maps,
    moved_x: Float[Array, "n_x 3"],
    moved_y: Float[Array, "n_y 3"],
    spec_x: Spectrum,
    spec_y: Spectrum,
    *,
    rounding: float = EvidenceSettings().rounding,
) -> Bending:
    """How two shapes lie that were bent onto each other. All in sqrt(area).

    A wrong map asks for more than a surface that resists stretching gives: the shapes
    stay apart, or are sheared where the map turns. With a_i the share of a vertex in
    the area of X, p_i its position bent onto Y and m_i its normal there, y_j and n_j
    position and normal of its image at rest, j = T_xy[i]:

        residual_xy = max(0, sum_i a_i |n_j . (p_i - y_j)| - c h),
        normal_gap_xy = 1 - |sum_i a_i m_i . n_j|,

    h = sqrt(area of Y / its vertices) and c = `rounding`, for what rounding to vertices
    leaves. With s_1 <= s_2 the stretches of a triangle of X (`log_stretches`), and
    t = log(s_1 s_2) / 2, over triangles by their area at rest:

        shear_xy = quantile 1 - `MOST_SHEARED` of log(s_2 / s_1),
        area_std_xy = standard deviation of t.

    Each is the mean of this and of the same the other way.

    Args:
        maps: between the vertices.
        moved_x, moved_y: positions of X deformed onto Y, and of Y deformed onto X.
        spec_x, spec_y: both at rest.
        rounding: see `jfsf.matching.EvidenceSettings`.

    Returns:
        Numbers of 0 or more; nan if one of them has no faces, or those of padding only.
    """
    if len(spec_x.faces) == 0 or len(spec_y.faces) == 0:
        return Bending(*[jnp.full((), jnp.nan, moved_x.dtype)] * 4)

    def one_way(spec, bent, target, T):
        outward = normals(target.vertices, target.faces)[T]
        share = spec.mass / spec.mass.sum()
        gap = jnp.abs(jnp.sum((bent - target.vertices[T]) * outward, 1))
        real = jnp.sum((target.mass > 0).astype(share.dtype))
        spacing = jnp.sqrt(safe_divide(target.mass.sum(), real))
        residual = jnp.maximum(matmul(share, gap) - rounding * spacing, 0)
        alike = jnp.sum(normals(bent, spec.faces) * outward, 1)
        normal_gap = 1 - jnp.abs(matmul(share, alike))
        area, smaller, larger = log_stretches(spec.vertices, bent, spec.faces)
        area = area / area.sum()
        growth = (smaller + larger) / 2
        mean = matmul(area, growth)
        variance = matmul(area, (growth - mean) ** 2)
        shear = _quantile(larger - smaller, area, 1 - MOST_SHEARED)
        return jnp.stack([residual, shear, jnp.sqrt(variance), normal_gap])

    both = map_sides(
        one_way,
        (spec_x, moved_x, spec_y, maps.T_xy),
        (spec_y, moved_y, spec_x, maps.T_yx),
    )
    surfaces = jnp.any(spec_x.faces) & jnp.any(spec_y.faces)
    mean = jnp.where(surfaces, jnp.mean(jnp.stack(both), 0), jnp.nan)
    return Bending(*mean)


def _quantile(values, weight, share: float):
    """The value below which this share of the weight lies; weights sum to 1."""
    order = jnp.argsort(values)
    below = jnp.cumsum(weight[order])
    at = jnp.searchsorted(below, jnp.asarray(share, below.dtype) * below[-1])
    return values[order[jnp.minimum(at, len(values) - 1)]]
