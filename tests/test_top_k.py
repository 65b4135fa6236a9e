"""Indices of the largest entries against a sort."""

import jax.numpy as jnp
import numpy as np
import pytest

from jfsf.array import argmax
from jfsf.array._precision import top_k


@pytest.mark.parametrize("k0, folds", [(1, 1), (7, 1), (40, 1), (7, 4)])
def test_top_k_is_the_largest_in_order(k0, folds):
    score = -(np.random.default_rng(0).normal(size=(40, 9)).astype(np.float32) ** 2)
    score[:4, 3] = score[2, 3]  # four equal entries
    found = np.asarray(top_k(jnp.asarray(score), k0, folds))
    kept = np.zeros((40, 9), bool)
    parts = score.reshape(folds, -1, 9)
    kept.reshape(folds, -1, 9)[:] = parts == parts.max(0) if folds > 1 else True
    largest = -np.sort(np.where(kept, -score, np.inf), 0)[:k0]
    np.testing.assert_allclose(np.take_along_axis(score, found, 0), largest, rtol=1e-5)
    assert found.shape == (k0, 9) and found.dtype == np.int32
    assert all(len(np.unique(column)) == k0 for column in found.T)


def test_top_k_of_scores_that_are_0_or_above():
    # As of points that coincide up to rounding.
    score = jnp.asarray([[1e-9], [-1.0], [0.0], [-2.0]], jnp.float32)
    found = top_k(score, 4)
    assert set(found[:2, 0].tolist()) == {0, 2} and found[2:, 0].tolist() == [1, 3]


@pytest.mark.parametrize("axis", [0, 1])
def test_argmax_is_the_first_of_the_largest(axis):
    score = np.random.default_rng(0).integers(0, 5, (40, 30)).astype(float)
    assert np.array_equal(argmax(jnp.asarray(score), axis), score.argmax(axis))
    of_nan = argmax(jnp.full((4, 4), jnp.nan), axis)
    assert np.all((of_nan >= 0) & (of_nan < 4))
