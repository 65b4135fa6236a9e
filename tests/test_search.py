"""What search refuses; what it finds is in test_match."""

import jax.numpy as jnp
import numpy as np
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


def test_too_few_hypotheses_are_an_error():
    with pytest.raises(ValueError, match="hypotheses is 60, the least is 61"):
        search(SPEC, SPEC, DESC, DESC, hypotheses=60)


def test_the_smallest_budget_finds_the_identity():
    found = search(SPEC, SPEC, DESC, DESC, hypotheses=61, num=3)
    assert np.array_equal(found.energy, np.sort(found.energy))
    np.testing.assert_allclose(found.C_yx[0], np.eye(SECOND[-1]), atol=0.05)
