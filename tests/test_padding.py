"""Padding: what it adds, and that it fits."""

import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import testing
from jfsf.padding import bucket, pad

SPEC = testing.blob_spectrum(0, 10, 1)  # 42 vertices, 80 faces


def test_it_adds_no_area():
    padded = pad(SPEC, 50, 99)
    assert padded.evecs.shape == (50, 10) and padded.faces.shape == (99, 3)
    assert not padded.mass[42:].any() and not padded.evecs[42:].any()
    assert not padded.faces[80:].any() and padded.faces.dtype == SPEC.faces.dtype
    for mine, theirs in ((padded.mass, SPEC.mass), (padded.evecs, SPEC.evecs)):
        assert np.array_equal(mine[:42], theirs)
    assert np.array_equal(padded.evals, SPEC.evals)


def test_nothing_to_add():
    same = pad(SPEC, 42, 80)
    assert all(map(jnp.array_equal, same, SPEC))


@pytest.mark.parametrize("n, m", [(41, 80), (42, 79)])
def test_too_small_is_an_error(n, m):
    with pytest.raises(
        ValueError, match=rf"\(42, 80\) .* do not fit into \({n}, {m}\)"
    ):
        pad(SPEC, n, m)


@pytest.mark.parametrize("size", [1, 7, 511, 512, 513, 6890])
def test_bucket_is_the_next_multiple(size):
    found = bucket(size)
    assert found % 512 == 0 and 0 <= found - size < 512
    assert bucket(size, 1) == size
