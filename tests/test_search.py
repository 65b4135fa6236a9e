"""What search refuses; what it finds is in test_match."""

import jax.numpy as jnp
import pytest

from jfsf import testing
from jfsf.descriptors import wks
from jfsf.search import SECOND, search

SPEC = testing.blob_spectrum(0, SECOND[-1])
DESC = wks(SPEC, num=5)


@pytest.mark.parametrize("side", ["x", "y"])
def test_too_few_eigenpairs_are_an_error(side):
    few = testing.blob_spectrum(0, 20)
    pair = {"spec_x": SPEC, "spec_y": SPEC} | {f"spec_{side}": few}
    with pytest.raises(ValueError, match=f"spec_{side} has 20 eigenpairs, it needs"):
        search(pair["spec_x"], pair["spec_y"], DESC, DESC)


def test_an_unknown_orientation_is_an_error():
    with pytest.raises(ValueError, match="not 'up'"):
        search(SPEC, SPEC, DESC, jnp.ones_like(DESC), orientation="up")  # type: ignore
