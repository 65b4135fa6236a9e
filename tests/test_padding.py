"""Padding: common sizes, and what is padded to them."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf.runtime._sizes import (
    PaddedShape,
    common_size,
    pad,
    padded,
    padded_pair,
    padded_shapes,
    spectrum_like,
)
from jfsf.testing import blob_spectrum

SPEC = blob_spectrum(0, 8, 1)  # 42 vertices, 80 faces


def test_padding_has_no_mass():
    wide = pad(SPEC, 50, 99)
    assert wide.mass.shape == (50,) and wide.faces.shape == (99, 3)
    for name in ("evecs", "mass", "vertices"):
        ours, own = getattr(wide, name), getattr(SPEC, name)
        np.testing.assert_array_equal(ours[:42], own)
        assert not ours[42:].any()
    np.testing.assert_array_equal(wide.faces[:80], SPEC.faces)
    assert not wide.faces[80:].any()


@pytest.mark.parametrize("n, m", [(41, 80), (42, 79)])
def test_no_vertex_or_face_is_lost(n, m):
    with pytest.raises(ValueError, match=r"pad: \(42, 80\) .* do not fit"):
        pad(SPEC, n, m)


def test_numpy_stays_numpy():
    host = jax.tree.map(np.asarray, SPEC)
    assert all(isinstance(leaf, np.ndarray) for leaf in pad(host, 50, 90))
    assert isinstance(pad(jax.tree.map(jnp.asarray, SPEC), 50, 90).mass, jax.Array)


@given(st.integers(0, 10**7), st.integers(0, 10**7))
def test_common_sizes_grow_and_are_few(one, other):
    small, large = sorted((one, other))
    assert small <= common_size(small) <= common_size(large)
    size = common_size(large)
    assert common_size(size) == size
    # A step is the size before, and a quarter of a power of two from 20 480 up.
    assert size < 2 * max(large, 320) and (large <= 20_480 or size <= 1.25 * large)


def test_common_sizes_are_those_that_are_written_down():
    sizes = sorted({common_size(n) for n in range(0, 60_000, 7)})
    assert sizes[:7] == [320, 640, 1280, 2560, 5120, 10_240, 20_480]
    assert sizes[7:] == [25_600, 30_720, 35_840, 40_960, 51_200, 61_440]
    assert all(a < b for a, b in pairwise(sizes))


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ([(300, 596), (500, 996)], [(640, 1280), (640, 1280)]),
        ([(300, 596), (9000, 17_996)], [(320, 640), (10_240, 20_480)]),
        ([(300, 0), (300, 596)], [(320, 640), (320, 640)]),  # a cloud beside a mesh
        ([(300, 0), (300, 0)], [(320, 0), (320, 0)]),
        ([(300, 900)], [(640, 1280)]),  # a self map of a mesh with handles
    ],
)
def test_a_pair_gets_one_size_unless_one_is_far_larger(sizes, expected):
    found = padded_shapes(40, sizes)
    assert found == [PaddedShape(40, *size) for size in expected]


@pytest.mark.parametrize("x64", [False, True])
def test_a_spectrum_is_as_was_said_before_it_was_there(x64):
    with jax.enable_x64(x64):
        for shape in padded_shapes(6, [(42, 80)]):
            spec = padded(SPEC, shape)
            like = spectrum_like(shape)
            assert jax.tree.map(jax.typeof, spec) == jax.tree.map(jax.typeof, like)


def test_a_pair_is_cut_to_equally_many_eigenpairs():
    x, y = padded_pair(SPEC, blob_spectrum(1, 6, 2))
    assert x.evecs.shape == y.evecs.shape == (320, 6)
    np.testing.assert_allclose(x.evals, SPEC.evals[:6])
