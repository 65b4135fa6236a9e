"""Padded spectra and their common sizes."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.array import pad, padded_size

SPEC = testing.blob_spectrum(0, 10, 1)  # 42 vertices, 80 faces


def test_padding_has_no_area():
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


counts = st.sampled_from([1, 2, 4, 8])


@given(st.integers(0, 10**6), st.integers(0, 10**6), counts)
def test_padded_sizes_grow_and_waste_little(one, other, per_doubling):
    sizes = sorted((one, other))
    small, large = (padded_size(n, per_doubling=per_doubling) for n in sizes)
    assert 256 <= small <= large
    for n, padded in zip(sizes, (small, large), strict=True):
        assert 0 <= padded - n < max(256, n) / per_doubling or n <= 256 == padded
        assert padded_size(padded, per_doubling=per_doubling) == padded


@given(counts, st.integers(1, 5))
def test_there_are_so_many_sizes_a_doubling(per_doubling, factor):
    first = per_doubling * factor
    sizes = {
        padded_size(n, per_doubling=per_doubling, first=first)
        for n in range(1, 4 * first + 1)
    }
    wanted = [
        first * 2**i * (per_doubling + j) // per_doubling
        for i in range(2)
        for j in range(per_doubling)
    ]
    assert sorted(sizes) == [*wanted, 4 * first]


def test_two_sizes_a_doubling():
    sizes = {padded_size(n, per_doubling=2) for n in range(1025)}
    assert sizes == {256, 384, 512, 768, 1024}
    assert padded_size(4097) - padded_size(4096) == 512


@pytest.mark.parametrize("per_doubling, first", [(8, 12), (0, 256), (8, 0)])
def test_sizes_that_do_not_divide_are_an_error(per_doubling, first):
    with pytest.raises(ValueError, match=f"first is {first}, .* {per_doubling}$"):
        padded_size(5, per_doubling=per_doubling, first=first)
