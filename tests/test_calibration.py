"""The shipped factors of the confidence of a map are those of the script, and hold."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

FOLDER = Path(__file__).parents[1] / "experiments"


@pytest.fixture
def script():
    return import_module("experiments.fit.calibration")


@pytest.mark.slow
def test_the_shipped_constants_are_the_scripts(script):
    assert script.text_of(script.RESULTS) == script.CONSTANTS.read_text()


def test_they_are_not_fitted_to_sets_that_are_reported(script):
    shipped = json.loads(script.CONSTANTS.read_text())
    sets = script.protocol.SETS
    assert all("fit" in sets[name].roles for name in shipped["fitted_to"])
    assert set(shipped["as_shipped"]) == set(shipped["held_out"]) - {
        *shipped["fitted_to"],
        "all",
    }


def test_they_hold_on_sets_that_they_were_not_fitted_to(script):
    found = json.loads(script.CONSTANTS.read_text())["held_out"]["all"]
    assert found["calibration_error"] <= 0.05
    assert found["wrong_of_sure"] <= 0.02 * found["sure"]
    right = found["pairs"] - found["wrong"]
    assert found["right_below_0.7"] <= 0.15 * right


def test_a_fit_recovers_factors_and_keeps_their_signs(script):
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(20_000, 3))
    factors = np.array([0.5, 1.0, -0.7, 0.4])
    right = rng.uniform(size=len(columns)) < expit(factors[0] + columns @ factors[1:])
    signs = {"a": 1, "b": -1, "c": -1}
    found = script.fit(columns, right, np.ones(len(right)), signs)
    # What speaks against sense is left out.
    assert found[3] == 0
    np.testing.assert_allclose(found[:3], factors[:3], atol=0.15)
    weight = np.where(columns[:, 0] > 0, 1.0, 0.0)
    some = script.fit(columns, right, weight, signs)
    half = script.fit(columns[weight > 0], right[weight > 0], weight[weight > 0], signs)
    assert np.sign(some[2]) == np.sign(half[2]) == -1


def test_a_rank_tells_the_maps_of_a_pair_apart_whatever_the_pair(script):
    rng = np.random.default_rng(1)
    pools = []
    for _ in range(300):
        hard = rng.normal(size=(1, 3)) * 5  # shared by all maps of a pair
        columns = hard + rng.normal(size=(8, 3))
        rank = columns @ [-2.0, -1.0, 0.5]
        errors = np.where(
            np.arange(8) == np.argmax(rank + rng.gumbel(size=8)), 0.02, 0.4
        )
        pools.append((columns, errors))
    found = script.fit_rank(pools)
    np.testing.assert_allclose(found, [-2.0, -1.0, 0.5], atol=0.35)


def test_scores_count_what_people_would_regret(script):
    found = np.array([0.95, 0.95, 0.6, 0.2])
    right = np.array([True, False, True, False])
    scores = script.scores(found, right)
    assert scores["pairs"] == 4 and scores["wrong"] == 2
    assert scores["sure"] == 2 and scores["wrong_of_sure"] == 1
    assert scores["right_below_0.7"] == 1 and scores["auc"] == 0.625
