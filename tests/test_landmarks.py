"""Landmarks: how far a map misses them, and that one it misses is not obeyed."""

import jax.numpy as jnp
import numpy as np

from jfsf import testing
from jfsf.initial import Start
from jfsf.matching import Settings
from jfsf.matching._kept_landmarks import kept_landmarks, landmark_distances
from jfsf.spectral import features
from jfsf.spectral._features import LANDMARK_TIMES
from jfsf.spectral._sampling import biharmonic

SETTINGS = Settings()
SPEC = testing.blob_spectrum(0, SETTINGS.search.eigenpairs)
RNG = np.random.default_rng(0)


def test_the_distance_is_relative_to_that_of_random_vertices():
    n = len(SPEC.mass)
    points, mass = np.asarray(biharmonic(SPEC)), np.asarray(SPEC.mass)
    square = np.sum((points[:, None] - points[None]) ** 2, axis=2)
    images, partners = RNG.integers(n, size=(2, 9))
    partners[0] = images[0]
    found = landmark_distances(jnp.asarray(images), jnp.asarray(partners), SPEC)
    expected = np.sqrt(square[images, partners] / (mass @ square @ mass))
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert found[0] == 0


def test_columns_of_a_missed_landmark_are_dropped():
    at_x = jnp.arange(0, 120, 40)
    square = jnp.sum((SPEC.vertices - SPEC.vertices[at_x[1:2]]) ** 2, 1)
    at_y = at_x.at[1].set(jnp.argmax(square))
    x, y = features(SPEC, landmarks=at_x), features(SPEC, landmarks=at_y)
    one = jnp.ones(())
    start = Start(jnp.eye(SETTINGS.search.final_ks[-1]), one, one, one / 4, one)
    given = (SPEC, SPEC), (x, y), start, (at_x, at_y)
    kept = kept_landmarks(*given, settings=SETTINGS)
    times = LANDMARK_TIMES
    end = x.descriptors.shape[1]
    missed = slice(end - 2 * times, end - times)
    seen = np.r_[end - 3 * times : end - 2 * times, end - times : end]
    for before, after in zip((x, y), kept, strict=True):
        assert (after.columns[:, missed] == 0).all()
        assert (before.columns[:, missed] != 0).any()
        # The refinement weighs all columns by a quarter: these count in full.
        np.testing.assert_array_equal(
            after.columns[:, seen], 4 * before.columns[:, seen]
        )
        rest = np.delete(np.arange(before.columns.shape[1]), np.r_[missed, seen])
        np.testing.assert_array_equal(after.columns[:, rest], before.columns[:, rest])
    # The first heat seen from a landmark is largest at the landmark itself.
    last = x.descriptors[:, end - 2 : end]
    assert (jnp.argmax(last, 0) == at_x[2]).all()
