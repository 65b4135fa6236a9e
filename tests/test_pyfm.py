"""An example: somebody else's method against the laws, by `jfsf.testing`."""

import numpy as np
import pytest
from hypothesis import given
from pyFM.spectral import FM_to_p2p

from jfsf import testing
from jfsf.types import Maps

SPECTRA, EYE = testing.spectra(10), np.eye(10)


def convert(spec_x, spec_y, C_yx):
    """pyFM's conversion, with X = 2 and Y = 1."""
    evecs = np.asarray(spec_y.evecs), np.asarray(spec_x.evecs)
    return Maps(FM_to_p2p(C_yx, *evecs, use_adj=True), FM_to_p2p(C_yx.T, *evecs[::-1]))


@pytest.mark.slow
@given(SPECTRA, SPECTRA, testing.permutations(162), testing.permutations(162))
def test_relabelling_relabels(x, y, order_x, order_y):
    wanted = testing.relabel_maps(convert(x, y, EYE), order_x, order_y)
    x, y = testing.relabel_spectrum(x, order_x), testing.relabel_spectrum(y, order_y)
    np.testing.assert_array_equal(convert(x, y, EYE), wanted)


@given(SPECTRA, SPECTRA, testing.signs(10), testing.signs(10))
def test_signs_of_eigenvectors_change_nothing(x, y, by_x, by_y):
    C_yx = np.asarray(testing.flip_map(EYE, by_x, by_y))
    flipped = testing.flip_signs(x, by_x), testing.flip_signs(y, by_y)
    np.testing.assert_array_equal(convert(*flipped, C_yx), convert(x, y, EYE))
