"""An example: somebody else's method against the laws, by `jfsf.testing`.

The method is pyFM's conversion of a functional map, with X = 2 and Y = 1.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

from jfsf import testing
from jfsf.types import Maps

SPECTRA = testing.spectra(10)
pyfm = pytest.importorskip("pyFM.spectral")


def convert(spec_x, spec_y, C_yx) -> Maps:
    evecs = [np.asarray(s.evecs) for s in (spec_y, spec_x)]
    C_yx = np.asarray(C_yx)
    T_xy = pyfm.FM_to_p2p(C_yx, *evecs, use_adj=True)
    T_yx = pyfm.FM_to_p2p(C_yx.T, *evecs[::-1])
    return Maps(jnp.asarray(T_xy), jnp.asarray(T_yx))


@given(SPECTRA, SPECTRA, testing.permutations(162), testing.permutations(162))
def test_relabelling_relabels(spec_x, spec_y, order_x, order_y):
    specs = (
        testing.relabel_spectrum(s, o)
        for s, o in ((spec_x, order_x), (spec_y, order_y))
    )
    plain = convert(spec_x, spec_y, jnp.eye(10))
    wanted = testing.relabel_maps(plain, order_x, order_y)
    for ours, theirs in zip(convert(*specs, jnp.eye(10)), wanted, strict=True):
        assert np.array_equal(ours, theirs)


@given(SPECTRA, SPECTRA, testing.signs(10), testing.signs(10))
def test_signs_of_eigenvectors_change_nothing(spec_x, spec_y, by_x, by_y):
    flipped = testing.flip_signs(spec_x, by_x), testing.flip_signs(spec_y, by_y)
    plain = convert(spec_x, spec_y, jnp.eye(10))
    C_yx = testing.flip_map(jnp.eye(10), by_x, by_y)
    for ours, theirs in zip(convert(*flipped, C_yx), plain, strict=True):
        assert np.array_equal(ours, theirs)
