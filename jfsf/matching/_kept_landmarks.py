"""Whether a map agrees with the landmarks that were given."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.initial import Start
from jfsf.matching._settings import Settings
from jfsf.spectral import Features, embeddings
from jfsf.spectral._features import LANDMARK_TIMES
from jfsf.spectral._sampling import biharmonic, rms_distance
from jfsf.types import Spectrum

Landmarks = tuple[Int[Array, " l"], Int[Array, " l"]]  # of X, and their partners
# A map misses a landmark whose image is farther than this from its partner, the mean
# distance of two random vertices being 1. Exchanged hands are at 1 or more, noise of a
# map at 0.1.
MISSED = 0.5


def landmark_distances(
    images: Int[Array, " l"],
    partners: Int[Array, " l"],
    spec: Spectrum,
) -> Float[Array, " l"]:
    """Spectral distance from image to partner, relative to the mean of the shape.

    Args:
        images, partners: vertices of the shape.
        spec: of the shape; mass 0 is padding.
    """
    points = biharmonic(spec)
    apart = jnp.linalg.norm(points[images] - points[partners], axis=1)
    return apart / rms_distance(points, spec.mass)


@jit(static_argnames="settings")
def kept_landmarks(
    pair: tuple[Spectrum, Spectrum],
    features: tuple[Features, Features],
    start: Start,
    landmarks: Landmarks,
    *,
    settings: Settings = Settings(),
) -> tuple[Features, Features]:
    """Features without the columns of landmarks that a map misses.

    One wrong landmark among several is so not obeyed. Columns of the others count in
    full, whatever the start's weight of descriptors.

    Args:
        pair: both shapes, whole.
        features: made with these landmarks, whole or at samples.
        start: the map with which the refinement starts.
        landmarks: vertices of X, and their partners.
        settings: not read, but every step of an attempt takes them.
    """
    (spec_x, spec_y), (x, y), (at_x, at_y) = pair, features, landmarks
    bases = spec_x.evecs, spec_y.evecs
    emb_x, emb_y = embeddings(start.C_yx, *bases, space="direct")
    near = matmul(emb_x[at_x], emb_y.T) - jnp.sum(emb_y**2, 1)[None] / 2
    real = spec_y.mass > 0
    images = jnp.argmax(jnp.where(real[None], near, -jnp.inf), 1)
    away = landmark_distances(images, at_y, spec_y)
    # The last descriptors are those of the landmarks, curvature follows them.
    keep = jnp.repeat(away <= MISSED, LANDMARK_TIMES)
    end = x.descriptors.shape[1]
    factor = jnp.ones(x.columns.shape[1], x.columns.dtype)
    full = keep.astype(factor.dtype) / start.descriptor_weight
    factor = factor.at[end - len(keep) : end].set(full)
    weighed_x, weighed_y = (side.columns * factor[None] for side in (x, y))
    return x._replace(columns=weighed_x), y._replace(columns=weighed_y)
