"""Starts are tried until one is confident; on the host as under jit."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import Settings, pipeline
from jfsf.matching import _running
from jfsf.pipeline import InitialMap
from jfsf.types import Certificate, Match


def starts(values):
    values = jnp.asarray(values, float)
    return InitialMap(values[..., None, None], values, values, values)


def attempt(start, tried=None, missed=0.0):
    """A match as confident as the number in its start, with one landmark."""
    if tried is not None:
        tried.append(float(start.gap))
    figures = dict.fromkeys(Certificate._fields, jnp.zeros(()))
    figures |= {"confidence": start.gap, "landmarks": jnp.full(1, missed)}
    certificate = Certificate(**figures)
    maps = jnp.zeros(2, int)
    return Match(maps, maps, start.C_yx, certificate)


@pytest.mark.parametrize(
    ("first", "others", "chosen", "tried"),
    [
        (0.9, [1.0, 1.0], 0.9, 1),  # retry_below: nothing else is tried
        (0.5, [1.0, 1.0], 0.5, 1),
        (0.2, [0.1, 0.6, 0.9], 0.6, 3),  # the first that is confident
        (0.3, [0.1, 0.4, 0.2], 0.4, 4),  # none is: the most confident
        (0.3, [0.1, 0.2], 0.3, 3),
        (0.3, [np.nan, 0.4], 0.4, 3),
        (0.0, [0.0], 0.0, 2),
    ],
)
def test_the_most_confident_start_is_kept(first, others, chosen, tried):
    count = []
    half = len(others) // 2
    makers = [lambda: starts(others[:half]), lambda: starts(others[half:])]
    options = starts(first), makers, 0.5
    on_host = _running.most_confident(partial(attempt, tried=count), *options)
    traced = jax.jit(lambda: pipeline._most_confident(attempt, *options))()
    assert len(count) == tried
    for found in (on_host, traced):
        assert np.isclose(found.certificate.confidence, chosen)
        assert np.isclose(found.C_yx[0, 0], chosen)


@pytest.mark.parametrize(("other", "chosen"), [(0.6, 0.7), (0.9, 0.9)])
def test_a_missed_landmark_asks_for_another_map(other, chosen):
    tried = []
    options = starts(0.7), [lambda: starts([other]), lambda: starts([1.0])], 0.5
    missing = partial(attempt, missed=1.0)
    on_host = _running.most_confident(partial(missing, tried=tried), *options)
    traced = jax.jit(lambda: pipeline._most_confident(missing, *options))()
    np.testing.assert_allclose(tried, [0.7, other])
    for found in (on_host, traced):
        assert np.isclose(found.certificate.confidence, chosen)


@pytest.mark.parametrize(
    ("values", "num", "kept"),
    [
        ([0.1, 0.7, 0.3], 2, [0.7, 0.3]),
        ([0.1, 0.7, 0.3], 1, [0.7]),
        ([0.1, 0.7], 2, [0.1, 0.7]),  # all are tried, so none is compared
        ([np.nan, 0.2, 0.2, 0.1], 3, [0.2, 0.2, 0.1]),
        ([np.nan, np.nan, 0.0], 2, [0.0, np.nan]),
    ],
)
def test_the_most_promising_starts_are_tried(values, num, kept):
    given = starts(values)
    promise = lambda start: start.gap
    for choose in (
        _running.most_promising,
        jax.jit(pipeline._most_promising, static_argnums=(0, 2)),
    ):
        found = choose(promise, given, num)
        np.testing.assert_allclose(found.gap, kept)
        assert found.C_yx.shape == (len(kept), 1, 1)


def test_starts_are_chosen_under_vmap():
    first, others = starts([0.9, 0.2]), starts([[1.0, 1.0], [0.3, 0.6]])

    def choose(first, others):
        return pipeline._most_confident(attempt, first, [lambda: others], 0.5)

    found = jax.vmap(choose)(first, others)
    np.testing.assert_allclose(found.certificate.confidence, [0.9, 0.6])


def test_a_first_map_of_unknown_confidence_is_kept():
    options = starts(np.nan), [lambda: starts([0.9])], 0.5
    assert np.isnan(_running.most_confident(attempt, *options).certificate.confidence)
    traced = pipeline._most_confident(attempt, *options)
    assert np.isnan(traced.certificate.confidence)


def test_confident_is_a_probability():
    with pytest.raises(ValueError, match="confident is 2"):
        Settings(retry_below=2)
