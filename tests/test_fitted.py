"""Constants that scripts in `experiments/` fit are those of their committed results."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from jfsf.apps.collections._cycles import AGREE
from jfsf.apps.collections._member import WITHIN
from jfsf.learned._places import PEOPLE
from jfsf.matching.parts import PartSettings
from jfsf.matching.parts._starts import WEIGHTS

FOLDER = Path(__file__).parents[1] / "experiments"


def load(name: str, script: str = ""):
    """A script, `fit.NAME` or what is given, and what it has written."""
    result = FOLDER / "results" / f"{name}.json"
    module = import_module(f"experiments.{script or f'fit.{name}'}")
    return module, json.loads(result.read_text())


def test_the_weights_of_parts_are_the_scripts():
    script, found = load("fit_parts")
    assert found["fitted"] == WEIGHTS._asdict()
    # An optimiser on another machine may end a little beside.
    assert script.fit(found["rows"]) == pytest.approx(found["fitted"], abs=0.02)
    # More maps find at most one more right one of all pairs, for a second each.
    settings = PartSettings()
    right = lambda table: sum(row["right"] for row in table.values())
    shipped = right(found["tries"][str(settings.refined)])
    assert shipped >= max(map(right, found["tries"].values())) - 1
    assert right(found["stops"][str(settings.sure)]) == shipped


def test_how_likely_a_region_is_right_is_the_scripts():
    script, found = load("fit_parts")
    factors = found["confidence"]["factors"]
    # Byte for byte what the script writes.
    assert script.REGIONS.read_text(encoding="utf-8") == script.regions(factors)
    assert script.fit_confidence(found["rows"]) == pytest.approx(factors, abs=0.02)
    assert script.fit_confidence(found["rows"][:1]) == {}
    # What speaks for a map on the other sets does on each.
    scores = found["confidence"]["scores"]
    held = {name: one for name, one in scores.items() if "held_out" in name}
    assert len(held) == 4
    for one in held.values():
        assert one["maps"]["auc"] > 0.7 and one["chosen"]["wrong_of_sure"] <= 1


def test_which_pairs_are_of_people_is_the_scripts():
    script, found = load("learn_people_alone", "learn.evaluate")
    assert found["limit"] == script.limit(found["sets"]) == PEOPLE
    pairs = [
        (pair["likeness"] >= PEOPLE, script.are_people(name, pair["x"]))
        for name, row in found["sets"].items()
        for pair in row["each"]
    ]
    taken, people = np.array(pairs).T
    assert (taken & ~people).sum() <= 0.02 * (~people).sum() + 1  # and a centaur
    assert (people & ~taken).sum() <= 0.02 * people.sum()


def test_how_often_wrong_maps_agree_is_the_scripts():
    script, found = load("fit_cycles")
    agree, disagree = (found["triangles"][name] for name in ("agree", "disagree"))
    fitted = script.fitted(np.array([agree, disagree]))
    assert fitted == found["fitted"] == AGREE.tolist()
    assert np.sum(list(found["by_class"].values()), 0).tolist() == [agree, disagree]


def test_when_a_mirror_image_is_right_is_the_scripts():
    script, found = load("fit_mirror")
    # Byte for byte what the script writes.
    assert script.SHIPPED.read_text(encoding="utf-8") == script.shipped(
        found["factors"]
    )
    assert script.fit(found["rows"]) == pytest.approx(found["factors"], abs=0.02)
    assert script.held_out(found["rows"]).keys() == script.KINDS.keys()


def test_how_far_from_the_others_a_way_counts_little_is_nearly_the_best():
    found = load("fit_agree")[1]
    assert WITHIN == found["settings"]["shipped"]
    for row in found["sets"].values():
        best = min(row[str(within)] for within in found["settings"]["distances"])
        assert row[str(WITHIN)] < row["alone"]
        assert row[str(WITHIN)] <= 1.01 * best
