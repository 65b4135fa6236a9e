"""The shipped factors of the confidence of a vertex are those of the script."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from jfsf.matching._vertices import VERTEX_EVIDENCE

FOLDER = Path(__file__).parents[1] / "experiments"


@pytest.fixture
def script():
    return import_module("experiments.fit.calibrate_vertices")


def test_the_shipped_constants_are_the_scripts(script):
    results = sorted((FOLDER / "results").glob(script.RESULTS))
    assert script.text_of(results) == script.CONSTANTS.read_text()


def test_they_hold_on_sets_that_they_were_not_fitted_to(script):
    held_out = json.loads(script.CONSTANTS.read_text())["held_out"]
    assert len(held_out) == 2
    for scores in held_out.values():
        assert scores["calibration_error"] <= 0.05
    right, every = (
        scores["of_these_in_the_least_sure_tenth"]
        for scores in (held_out["maps that are right on the whole"], held_out["all"])
    )
    assert right >= 0.5 and every >= 0.5


def test_a_fit_recovers_factors_and_ignores_what_speaks_against_sense(script):
    rng = np.random.default_rng(0)
    n, f = 20_000, len(VERTEX_EVIDENCE)
    columns = rng.normal(size=(n, f + 1))
    factors = np.array([0.5, -1.0, 0.7, 0.4])
    right = rng.uniform(size=n) < script.predict(factors, columns)
    errors = np.where(right, 0.01, 0.2)
    data = script.Vertices(columns, errors, np.full(n, 1 / n), np.ones(n, bool))
    found = script.fit(data)
    assert f == 2 and found[2] == 0
    known = [0, 1, 3]
    np.testing.assert_allclose(found[known], factors[known], atol=0.15)


def test_vertices_are_written_as_text_and_read(script, monkeypatch):
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
