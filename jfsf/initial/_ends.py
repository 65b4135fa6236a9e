"""What an extremity looks like, whatever its size: hands are not feet.

Where arms are longer than legs, a map that turns a body upside down may stretch less
than the right one. Three numbers without a unit tell the ends of limbs apart: how
slender they are, and how much they are curved in sum, since five fingers have more tips
than one toe cap.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.geometry._surface import corner_sides, divergence, sum_at_vertices, surface
from jfsf.types import Spectrum

# An end reaches from the tip to this share of the way to the middle of the shape.
REACH = 0.5
# Width of its border: 1 / SHARPNESS of that reach.
SHARPNESS = 8.0
# Added to an area: an end without samples is not infinitely slender.
LEAST_AREA = 1e-3


@jit
def total_curvatures(
    spec: Spectrum, samples: Int[Array, " s"], cells: Int[Array, "n 2"]
) -> Float[Array, "s 2"]:
    """Total curvature of the cell of each sample: both scale-invariant.

    Args:
        spec: of the whole shape; without faces nothing is curved.
        samples: vertices.
        cells: `sample_cells`.

    Returns:
        The integral of |K|, by angle defects, and of H^2 (Willmore energy), by the
        cotangent Laplacian. Vertices on a boundary count 0.
    """
    faces = spec.faces
    _, _, rest, stiff = surface(spec.vertices, faces, spec.mass)

    def at_vertices(values):
        return sum_at_vertices(values, faces, len(spec.mass))

    to, fro = corner_sides(rest)
    across = jnp.linalg.norm(jnp.cross(to, fro), axis=2)
    angle = at_vertices(jnp.arctan2(across, jnp.sum(to * fro, 2)))
    laplacian = divergence(stiff * rest, faces, len(spec.mass))
    # The edges opposite to a vertex make a closed loop, unless it is on a boundary.
    gap = jnp.linalg.norm(at_vertices(rest), axis=1)
    around = at_vertices(jnp.linalg.norm(rest, axis=2))
    inside = (angle > 0) & (gap < 1e-3 * around) & (spec.mass > 0)
    # Not the mass: it may have another unit than the vertices.
    area = jnp.where(inside, at_vertices(across) / 6, 1)
    values = jnp.stack(
        [jnp.abs(2 * jnp.pi - angle), jnp.sum(laplacian**2, 1) / (4 * area)], 1
    )
    values = jnp.where(inside[:, None], values, 0)
    return jnp.zeros((len(samples), 2), values.dtype).at[cells[:, 0]].add(values)


def tip_descriptors(
    geodesics: Float[Array, "e s"],
    reach: Float[Array, " e"],
    mass: Float[Array, " s"],
    total_curvatures: Float[Array, "s 2"],
) -> Float[Array, "e 3"]:
    """Slenderness and total curvatures of the ends of limbs, as logarithms.

    Args:
        geodesics: from each tip to all samples.
        reach: from each tip to the middle of the shape.
        mass: of samples, in sum 1.
        total_curvatures: see there.
    """
    tiny = jnp.finfo(geodesics.dtype).tiny
    border = REACH * jnp.maximum(reach, tiny)[:, None]
    inside = jax.nn.sigmoid(SHARPNESS * (1 - geodesics / border))
    slender = jnp.log(matmul(inside, mass[:, None]) + LEAST_AREA) - 2 * jnp.log(border)
    return jnp.concatenate([slender, jnp.log(1 + matmul(inside, total_curvatures))], 1)
