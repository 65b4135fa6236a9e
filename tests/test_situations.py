"""Pairs that were once wrong in silence: a mirrored shape is said to be one."""

import pytest

from experiments.accuracy import situations


@pytest.mark.slow  # matches in earnest, doubtful pairs too
@pytest.mark.parametrize("name", ["left and right", "left and right, bones", "bodies"])
def test_a_mirrored_shape_is_said_to_be(name):
    found = situations.of_pairs(name, 2)
    assert [row["expected"] for row in found["pairs"]] == [True, True]
    for row in found["pairs"]:
        assert row["says_mirror"] == (name != "bodies")
