"""The shipped factors of confidences are those of their scripts, and hold."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from jfsf.matching._vertices import VERTEX_EVIDENCE

FOLDER = Path(__file__).parents[1] / "experiments"


@pytest.fixture
def script():
    return import_module("experiments.fit.calibration")


@pytest.fixture
def vertices():
    return import_module("experiments.fit.calibrate_vertices")


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


def test_the_shipped_constants_of_vertices_are_the_scripts(vertices):
    results = sorted((FOLDER / "results").glob(vertices.RESULTS))
    assert vertices.text_of(results) == vertices.CONSTANTS.read_text()


def test_those_of_vertices_hold_on_sets_that_they_were_not_fitted_to(vertices):
    held_out = json.loads(vertices.CONSTANTS.read_text())["held_out"]
    assert len(held_out) == 2
    for scores in held_out.values():
        assert scores["calibration_error"] <= 0.05
    right, every = (
        scores["of_these_in_the_least_sure_tenth"]
        for scores in (held_out["maps that are right on the whole"], held_out["all"])
    )
    assert right >= 0.5 and every >= 0.5


def test_a_fit_of_vertices_recovers_factors_and_ignores_what_speaks_against_sense(
    vertices,
):
    rng = np.random.default_rng(0)
    n, f = 20_000, len(VERTEX_EVIDENCE)
    columns = rng.normal(size=(n, f + 1))
    factors = np.array([0.5, -1.0, 0.7, 0.4])
    right = rng.uniform(size=n) < vertices.predict(factors, columns)
    errors = np.where(right, 0.01, 0.2)
    data = vertices.Vertices(columns, errors, np.full(n, 1 / n), np.ones(n, bool))
    found = vertices.fit(data)
    assert f == 2 and found[2] == 0
    known = [0, 1, 3]
    np.testing.assert_allclose(found[known], factors[known], atol=0.15)


def test_vertices_are_written_as_text_and_read(vertices):
    rows = import_module("experiments.accuracy.vertex_rows")
    rng = np.random.default_rng(0)
    evidence = rng.normal(size=(50, len(VERTEX_EVIDENCE)))
    at = rows.chosen(50)
    errors = rng.uniform(size=len(at))
    assert len(set(at)) == rows.NUMBER and (np.diff(at) > 0).all()
    assert list(rows.chosen(4)) == [0, 1, 2, 3]
    found, known = rows.from_row(rows.to_row(evidence, at, errors, np.full(50, 0.5)))
    np.testing.assert_allclose(found, evidence[at], atol=0.0051)
    np.testing.assert_allclose(known, errors, atol=0.00051)
