"""Whether a map agrees with the landmarks that were given."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.spectral import DISTANCE_PAIRS, biharmonic
from jfsf.types import Spectrum

# A map misses a landmark whose image is farther than this from its partner: half as far
# as two random vertices. Exchanged hands are at 1 or more, noise of a map at 0.1.
MISSED = 0.5


def landmark_distances(
    images: Int[Array, " l"],
    partners: Int[Array, " l"],
    spec: Spectrum,
    *,
    distance_pairs: int = DISTANCE_PAIRS,
) -> Float[Array, " l"]:
    """Spectral distance from image to partner, relative to the mean of the shape.

    Args:
        images, partners: vertices of the shape.
        spec: of the shape; mass 0 is padding.
        distance_pairs: eigenpairs of the biharmonic distance.
    """
    points = biharmonic(spec, distance_pairs)
    apart = jnp.linalg.norm(points[images] - points[partners], axis=1)
    return apart / rms_distance(points, spec.mass)


def rms_distance(points: Float[Array, "n d"], mass: Float[Array, " n"]) -> Array:
    """Root mean squared distance of two random vertices: twice the variance."""
    centre = matmul(mass, points)
    return jnp.sqrt(2 * matmul(mass, jnp.sum((points - centre[None]) ** 2, 1)))
