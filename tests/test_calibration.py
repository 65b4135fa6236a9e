"""The shipped factors of confidences are those of their scripts, and hold."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from jfsf.apps.collections._cycles import LEAST
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


def test_no_confidence_counts_for_more_than_was_observed(script):
    every = json.loads(script.CONSTANTS.read_text())["held_out"]["all"]
    most = script.most_wrong(every)
    assert every["wrong_at_most"] == most
    assert round(most, 2) == LEAST
    # So many right ones would be seen of maps that are wrong so often.
    assert every["wrong_of_sure"] == 0
    np.testing.assert_allclose((1 - most) ** every["sure"], 0.05, rtol=0.01)


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
        hard = rng.normal(size=(1, 4)) * 5  # shared by all maps of a pair
        columns = hard + rng.normal(size=(8, 4))
        rank = columns @ [-2.0, -1.0, 0.5, 0.7]
        errors = np.where(
            np.arange(8) == np.argmax(rank + rng.gumbel(size=8)), 0.02, 0.4
        )
        pools.append((columns, errors))
    found = script.fit_rank(pools)
    np.testing.assert_allclose(found, [-2.0, -1.0, 0.5, 0.7], atol=0.35)


def test_scores_count_what_people_would_regret(script):
    found = np.array([0.95, 0.95, 0.6, 0.2])
    right = np.array([True, False, True, False])
    scores = script.scores(found, right)
    assert scores["pairs"] == 4 and scores["wrong"] == 2
    assert scores["sure"] == 2 and scores["wrong_of_sure"] == 1
    assert scores["right_below_0.7"] == 1 and scores["auc"] == 0.625


def test_the_shipped_constants_of_vertices_are_the_scripts(vertices):
    assert vertices.text_of(vertices.RESULTS) == vertices.CONSTANTS.read_text()


def test_those_of_vertices_hold_on_sets_that_they_were_not_fitted_to(vertices):
    held_out = json.loads(vertices.CONSTANTS.read_text())["held_out"]
    assert 0.87 <= held_out["median_of_sets"]["coverage"] <= 0.96
    assert held_out["median_of_sets"]["spearman"] >= 0.3
    assert held_out["confidence"]["calibration_error"] <= 0.06


def made_up(vertices, rng, *, sets=4, points=2000):
    """Errors whose scale is known, and their 0.9 quantile beside it."""
    f, found = len(VERTEX_EVIDENCE), {}
    factors = np.array([0.0, 0.6, 0.0, 0.4])
    for name in range(sets):
        evidence = rng.normal(size=(points, f))
        # Far above `LEAST_ERROR`, which is added to errors.
        scale = np.exp(factors[0] + evidence @ factors[1:])
        errors = scale * np.abs(rng.normal(size=points))
        # The second speaks for a vertex, which must not count.
        evidence[:, 1] = -np.log(errors)
        found[str(name)] = [vertices.Side(evidence, errors, 0.9, True)]
    return found, factors[1:]


def test_a_fit_of_vertices_recovers_factors_and_covers(vertices):
    rng = np.random.default_rng(0)
    sets, factors = made_up(vertices, rng)
    fitted = vertices.fit(sets)
    assert abs(fitted.factors[2]) < 1e-9
    np.testing.assert_allclose(fitted.factors[1:], factors, atol=0.08)
    new, _ = made_up(vertices, rng, sets=1, points=20_000)
    found = vertices.scores(new["0"], fitted)
    assert abs(found["coverage"] - vertices.COVERED) < 0.01
    assert found["spearman"] > 0.4


def test_the_quantile_is_that_of_split_conformal_prediction(vertices):
    rng = np.random.default_rng(0)
    for n in (9, 10, 19, 57):
        scores = rng.normal(size=n)
        rank = int(np.ceil((n + 1) * 0.9))  # Papadopoulos et al. 2002
        wanted = np.sort(scores)[rank - 1]
        assert vertices.quantile(scores, np.full(n, 1 / n)) == wanted
    assert vertices.quantile(scores[:5], np.full(5, 0.2)) == np.inf
    # A weight of two is a score twice, but for the one to come.
    weights = rng.integers(1, 4, 400)
    found = vertices.quantile(values := rng.normal(size=400), weights)
    again = np.quantile(np.repeat(values, weights), 0.9)
    assert abs(found - again) < 0.05


def test_vertices_are_written_as_text_and_read(vertices):
    rows = import_module("experiments.accuracy.vertex_rows")
    rng = np.random.default_rng(0)
    evidence = rng.normal(size=(50, len(VERTEX_EVIDENCE)))
    at = rows.chosen(50)
    errors = rng.uniform(size=len(at))
    assert len({*at}) == 50 and len({*rows.chosen(500)}) == rows.NUMBER
    found, known = rows.from_row(rows.to_row(evidence, at, errors))
    np.testing.assert_allclose(found, evidence[at], atol=0.0051)
    np.testing.assert_allclose(known, errors, atol=0.000051)
