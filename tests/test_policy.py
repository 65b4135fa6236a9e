"""Starts are attempted until one is likely: which, in which order, and how many.

The runner of these tests makes up the results of the stages from numbers: a start has
the probability of its match in `gap`. Copies are made up, too. Stages for real:
test_match.py, test_coarse.py, test_batch.py.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.special import expit, logit

from jfsf import Settings
from jfsf.initial import Start
from jfsf.matching import _bent_copies, _others, _pairs, _policy, _sources, confidence
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._confidence import (
    MISSED_WEIGHT,
    confidence_of,
    mirror_probability,
)
from jfsf.matching._pairs import PairState
from jfsf.matching._rigid import Moved
from jfsf.matching._rivals import Ranking
from jfsf.types import STAGES, Bent, Certificate, Match, Mesh

HALF = Settings(retry_below=0.5)
ONE = Settings(retry_below=0.5, nonisometric_attempts=1)
LANDMARKS = np.array([0]), np.array([0])


class Side(NamedTuple):
    """What is read of a shape's samples."""

    search: int
    refinement: int


class Copy(NamedTuple):
    """The copy of a shape, for its spectrum."""

    of: int
    evals: tuple = ()  # too few for the network


def starts(values, mirror_gap=np.nan):
    values = np.asarray(values, float)
    gaps = np.full_like(values, mirror_gap)
    return Start(values[..., None, None], values, values, values, gaps)


def match_of(start, missed=0.0, landmarks=None, sign=1):
    figures = dict.fromkeys(Certificate._fields, np.zeros(()))
    missed = np.full(0 if landmarks is None else 1, missed)
    figures |= {"log_odds": logit(start.gap), "share": np.nan, "landmarks": missed}
    figures |= {"rivals": np.nan, "mirrored": np.nan}
    figures |= {"person_agreement": np.nan}
    evidence = Certificate(**figures)
    known = confidence_of(evidence, sign != 0)
    evidence = evidence._replace(confidence=known)
    return Match(np.zeros(2, int), np.zeros(2, int), start.C_yx, evidence)


class Scripted:
    """A runner whose pairs, told apart by their spectra, are so likely right.

    first: for each pair, of its first start.
    others: of those for other proportions.
    on_copies: of the same on the copies, which say what is attempted, and in which
        order; there a first start is as likely as on the whole.
    guided: of the start that landmarks lead to, or the search beside a given map.
    missed: how far landmarks end from their partners.
    mirror: of the mirror image, which the search says fits better.
    ties: of the search's other candidates, which are as good.
    """

    def __init__(
        self,
        first,
        others=(),
        on_copies=None,
        guided=None,
        missed=0.0,
        mirror=None,
        ties=(),
    ):
        self.first, self.others, self.guided = first, others, guided
        self.on_copies, self.missed = on_copies or others, missed
        self.mirror, self.ties = mirror, ties
        self.given = False
        self.calls, self.bent = [], 0

    def map(self, name, stage, inputs, at_a_time=1):
        self.calls.append((name, len(inputs)))
        return [getattr(self, name.replace(" ", "_"))(*args) for args in inputs]

    def features(self, spec, descriptors, landmarks, self_map):
        return Side((spec, landmarks is not None), spec)

    def search(self, x, y, *options):
        if len(options) == 1:  # the map that is given
            self.given = True
            return starts(self.first[x])
        spec, knows_landmarks = x
        ties = starts(self.ties)._replace(gap=np.zeros(len(self.ties)))
        if isinstance(spec, Copy):
            assert options[0] < 0  # copies are searched for the mirror image only
            # Unlikely itself if nothing else is said, so that it does not count.
            return starts(0.001 if self.mirror is None else self.mirror), ties
        gap = np.nan if self.mirror is None else -0.5
        guided = knows_landmarks or self.given
        return starts(self.guided if guided else self.first[spec], gap), ties

    def kept_landmarks(self, pair, features, start, landmarks):
        return features

    def refinement(self, features, start):
        return np.zeros((3, 3))

    def further_starts(self, x, y, sign, self_map):
        # Extremities of copies are others, so the whole shapes are searched.
        assert not isinstance(x[0], Copy) and not isinstance(y[0], Copy)
        return starts(self.others[x[0]])

    def bending_and_conversion(self, pair, samples, C_yx, start, sign, landmarks):
        spec = pair[0]
        if np.isnan(start.gap) and start.orientation in self.ties:
            start = start._replace(gap=start.orientation)
        if isinstance(spec, Copy) and start.gap in self.others[spec.of]:
            at = list(self.others[spec.of]).index(float(start.gap))
            return match_of(start._replace(gap=self.on_copies[spec.of][at]))
        if not isinstance(spec, Copy) and not np.isnan(start.gap):
            # Maps of the copies are refined already.
            refined = start.gap in (*self.first, self.guided)
            bent = isinstance(C_yx, Bent)
            self.bent += bent
            assert bent or C_yx.shape == ((3, 3) if refined else (1, 1))
        return match_of(start, self.missed, landmarks, sign)

    def count(self, name):
        return sum(number for called, number in self.calls if called == name)


def shares_of(likely):
    """As if all maps differed."""
    odds = np.nan_to_num(np.exp(logit(np.asarray(likely, float))))
    return odds / odds.sum()


@pytest.fixture(autouse=True)
def alike(monkeypatch):
    """Numbers of maps of the copies that are like the first; the others differ.

    The copies rank as they are likely.
    """
    found = []

    def padded_copies(copies, inputs):
        return tuple(copies), inputs._replace(initial=None)

    def share_among(matches, pair):
        assert all(isinstance(spec, Copy) for spec in pair)
        odds = np.array([m.certificate.log_odds for m in matches])
        differ = ~np.eye(len(odds), dtype=bool)
        differ[0, found] = differ[found, 0] = False
        rank = np.nan_to_num(odds, nan=-np.inf)
        return Ranking(shares_of(expit(odds)), rank, differ, 1.0 * differ)

    monkeypatch.setattr(_pairs, "coarse_copy", lambda spec, settings: Copy(spec))
    monkeypatch.setattr(_bent_copies, "bends_copies", lambda *_: False)
    monkeypatch.setattr(_sources, "padded_copies", padded_copies)
    monkeypatch.setattr(_sources, "share_among", share_among)
    apart = lambda matches, pair: 1.0 - np.eye(len(matches))
    monkeypatch.setattr(_others, "map_distances", apart)
    for module in (_others, _sources):
        monkeypatch.setattr(module, "is_disk", lambda spec: False)
    monkeypatch.setattr(_sources, "moved_by_map", lambda *args, **options: None)
    monkeypatch.setattr(_others, "_are_round", lambda pair: False)
    return found


def run(runner, pairs=1, *, settings=HALF, **inputs):
    own = MatchInputs(**inputs)
    some = [PairState((i, i), own) for i in range(pairs)]  # type: ignore[arg-type]
    return _policy.match_pairs(some, runner, settings=settings)


def likely(match):
    return float(expit(match.certificate.log_odds))


@pytest.mark.parametrize(
    ("first", "others", "on_copies", "chosen", "tried"),
    [
        (0.9, [0.99, 0.8], None, 0.9, 1),  # likely: nothing else is tried
        (0.5, [0.99, 0.8], None, 0.5, 1),
        (0.2, [0.6, 0.9, 0.1], None, 0.9, 2),  # the first that is likely
        (0.2, [0.6, 0.9, 0.1], [0.3, 0.2, 0.1], 0.6, 2),
        (0.3, [0.1, 0.4], None, 0.4, 3),  # none is: what ranks first
        (0.3, [0.1, 0.2], None, 0.3, 3),
        (0.3, [0.1, 0.2], [0.6, 0.2], 0.1, 3),
        (0.3, [np.nan, 0.4], None, 0.4, 3),
        (0.01, [0.02], None, 0.02, 2),
        (np.nan, [0.9], None, np.nan, 1),  # there is nothing to compare
    ],
)
def test_what_ranks_first_on_the_copies_wins(first, others, on_copies, chosen, tried):
    settings = Settings(retry_below=0.5, nonisometric_attempts=3)
    runner = Scripted([first], [others], on_copies and [on_copies])
    (match,) = run(runner, settings=settings)
    np.testing.assert_allclose(likely(match), chosen)
    assert len(match.info.source) == tried
    # All others, the first, and its mirror image.
    on_copies = 0 if tried == 1 else 2 + len(others)
    assert runner.count("refinement") == 1 + on_copies
    assert runner.count("bending and conversion") == tried + on_copies
    sure = match.info.confidence[match.info.won]
    np.testing.assert_equal(sure, float(match.certificate.confidence))


@pytest.mark.parametrize(
    ("on_copies", "order"),
    [
        ([0.1, 0.7, 0.3], [0.2, 0.3]),
        ([np.nan, 0.2, 0.2], [0.2, 0.3]),  # ties: the earlier first
        ([np.nan, np.nan, 0.1], [0.3, 0.1]),
    ],
)
def test_the_maps_that_rank_highest_on_the_copies_are_attempted(on_copies, order):
    pair = PairState((0, 0), MatchInputs())  # type: ignore[arg-type]
    runner = Scripted([0.01], [[0.1, 0.2, 0.3]], [on_copies])
    settings = Settings(retry_below=0.5, nonisometric_attempts=2)
    (match,) = _policy.match_pairs([pair], runner, settings=settings)
    np.testing.assert_allclose(
        list(map(likely, pair.results(settings))), [0.01, *order]
    )
    assert match.info.sources == ["search", "coarse copies", "coarse copies"]


def test_pairs_in_doubt_are_gathered():
    first = [0.9, 0.1, 0.7, 0.2, 0.6]
    others = {1: [0.3, 0.8, 0.22], 3: [0.11, 0.35, 0.4]}
    on_copies = {1: [0.05, 0.9, 0.5], 3: [0.5, 0.6, 0.7]}
    runner = Scripted(first, others, on_copies)
    settings = Settings(retry_below=0.5, nonisometric_attempts=2)
    matches = run(runner, 5, settings=settings)
    np.testing.assert_allclose(list(map(likely, matches)), [0.9, 0.8, 0.7, 0.4, 0.6])
    # All first attempts together, the doubtful ones together, then the last alone.
    assert runner.calls == [
        *(("features", 10), ("search", 5)),
        *(("refinement", 5), ("bending and conversion", 5)),
        *(("features", 4), ("further starts", 2), ("search", 2)),
        *(("refinement", 10), ("bending and conversion", 10)),
        *(("bending and conversion", 2), ("bending and conversion", 1)),
    ]
    assert [len(match.info.source) for match in matches] == [1, 2, 1, 3, 1]


def test_the_match_of_each_attempt_is_kept():
    pair = PairState((0, 0), MatchInputs())  # type: ignore[arg-type]
    runner = Scripted([0.2], [[0.1, 0.4]])
    settings = Settings(retry_below=0.5, nonisometric_attempts=2)
    (best,) = _policy.match_pairs([pair], runner, settings=settings)
    tried = pair.results(settings)
    np.testing.assert_allclose(list(map(likely, tried)), [0.2, 0.4, 0.1])
    assert [int(match.info.won) for match in tried] == [0, 1, 2]
    assert [match.info.start for match in tried] == best.info.sources
    assert best.info.sources == ["search", "coarse copies", "coarse copies"]
    assert best.info.won == pair.won == 1
    for match in tried:
        np.testing.assert_equal(match.info.confidence, best.info.confidence)


def test_the_rivals_of_a_map_count():
    pair = PairState((0, 0), MatchInputs())  # type: ignore[arg-type]
    runner = Scripted([0.2], [[0.1, 0.4]], [[0.3, 0.5]])
    _policy.match_pairs([pair], runner, settings=ONE)
    tried = pair.results(ONE)
    # In the order of the attempts: first, then the likeliest of the copies.
    shares = shares_of([0.2, 0.3, 0.5])[[0, 2]]
    np.testing.assert_allclose([m.certificate.share for m in tried], shares)
    for match, share in zip(tried, shares, strict=True):
        wanted = confidence(match.certificate.log_odds, share)
        np.testing.assert_allclose(match.certificate.confidence, wanted)


def test_a_near_copy_of_the_first_map_is_not_attempted(alike):
    alike.append(2)  # 0.4; the first map is number 0
    runner = Scripted([0.2], [[0.1, 0.4]])
    (match,) = run(runner, settings=ONE)
    assert match.info.sources == ["search"]
    np.testing.assert_allclose(likely(match), 0.2)
    # It stands as the copy does.
    np.testing.assert_allclose(match.certificate.share, shares_of([0.2, 0.1, 0.4])[2])


def test_with_one_attempt_nothing_is_bent_where_the_first_map_ranks_first():
    (match,) = run(Scripted([0.4], [[0.1, 0.2]]), settings=ONE)
    assert match.info.sources == ["search"]
    np.testing.assert_allclose(match.certificate.share, shares_of([0.4, 0.1, 0.2])[0])


def test_two_maps_are_bent_by_default_the_map_so_far_among_them():
    (match,) = run(Scripted([0.4], [[0.1, 0.2]]))
    assert match.info.sources == ["search", "coarse copies"]
    np.testing.assert_allclose(likely(match), 0.4)
    (match,) = run(Scripted([0.1], [[0.3, 0.2, 0.15]]))
    assert match.info.sources == ["search", *["coarse copies"] * 2]
    np.testing.assert_allclose(likely(match), 0.3)


def test_a_map_without_doubt_has_no_rivals():
    (match,) = run(Scripted([0.9]))
    assert np.isnan(match.certificate.share)
    np.testing.assert_allclose(match.certificate.confidence, 0.9)


def test_left_and_right_that_cannot_be_told_halve_the_confidence():
    (match,) = run(Scripted([0.9]), sign=np.int32(0))
    np.testing.assert_allclose(match.certificate.confidence, 0.45)
    # That is no reason to try further starts.
    assert match.info.sources == ["search"]
    (match,) = run(Scripted([0.9]), sign=np.int32(0), landmarks=LANDMARKS)
    np.testing.assert_allclose(match.certificate.confidence, 0.9)


def test_without_a_policy_there_is_one_attempt():
    once = Settings(retry_below=0)
    runner = Scripted([0.01, 0.01])
    run(runner, 2, settings=once)
    assert runner.count("refinement") == 2 and runner.count("further starts") == 0
    # Then the search reads the landmarks.
    (match,) = run(Scripted([0.01], guided=0.3), settings=once, landmarks=LANDMARKS)
    np.testing.assert_allclose(likely(match), 0.3)


@pytest.mark.parametrize(("other", "chosen"), [(0.6, 0.7), (0.9, 0.9)])
def test_a_missed_landmark_asks_for_another_map(other, chosen):
    runner = Scripted([0.7], guided=other, missed=1.0)
    settings = Settings(retry_below=0.1)
    (match,) = run(runner, settings=settings, landmarks=LANDMARKS)
    np.testing.assert_allclose(likely(match), chosen)
    # Less confident than it is likely by itself.
    weight = MISSED_WEIGHT
    wanted = np.power([0.7, other], 1 + weight)
    np.testing.assert_allclose(match.info.confidence, wanted)
    assert match.info.sources == ["search", "landmarks"]
    assert match.info.start == ("search" if chosen == 0.7 else "landmarks")


def test_a_landmark_that_is_met_asks_for_nothing():
    runner = Scripted([0.7], guided=0.9, missed=0.1)
    assert run(runner, landmarks=LANDMARKS)[0].info.sources == ["search"]


@pytest.mark.parametrize("first", [0.05, 0.95])
def test_a_given_map_is_kept_and_compared(first):
    runner = Scripted([first], [[0.6, 0.7]], guided=0.8)
    # None is so likely that it counts as a rival.
    (match,) = run(runner, settings=Settings(retry_below=0.99), initial=np.eye(3))
    assert match.info.sources == ["given"]
    np.testing.assert_allclose(likely(match), first)
    # With all starts that are tried on the copies, that of the search included.
    share = shares_of([first, 0.8, 0.6, 0.7])[0]
    np.testing.assert_allclose(match.certificate.share, share)
    wanted = confidence(match.certificate.log_odds, share)
    np.testing.assert_allclose(match.certificate.confidence, wanted)
    assert runner.count("refinement") == 1 + 4


def test_a_given_map_without_evidence_is_not_compared():
    runner = Scripted([np.nan])
    (match,) = run(runner, initial=np.eye(3))
    assert runner.count("features") == 2 and np.isnan(match.certificate.share)


def test_a_given_map_is_compared_on_request_only():
    runner = Scripted([0.05])
    (match,) = run(runner, settings=Settings(retry_below=0), initial=np.eye(3))
    assert runner.count("refinement") == 1 and np.isnan(match.certificate.share)


def test_maps_that_fit_equally_well_are_counted():
    runner = Scripted([0.95], [[]], ties=[0.95, 0.94, 0.6])
    (match,) = run(runner, settings=Settings(retry_below=0.9))
    evidence = match.certificate
    # The third is less likely by itself.
    assert evidence.rivals == 2 and match.info.sources == ["search"]
    np.testing.assert_allclose(evidence.confidence, 1 / 3)
    np.testing.assert_allclose(evidence.share, shares_of([0.95, 0.95, 0.94, 0.6])[0])
    assert runner.count("refinement") == 1 + 4 and runner.count("further starts") == 0


@pytest.mark.parametrize("mirror", [0.999, 0.95, 0.3])
def test_a_mirror_image_that_fits_better_is_tried_on_the_copies(mirror):
    runner = Scripted([0.95], [[]], mirror=mirror)
    (match,) = run(runner, settings=Settings(retry_below=0.9), sign=1)
    evidence = match.certificate
    # One that is in doubt itself says nothing. Energies are made up, and equal.
    mirrored = mirror_probability(0.0) if mirror >= 0.9 else np.nan
    np.testing.assert_allclose(evidence.mirrored, mirrored)
    likely = min(0.95, 1 - np.nan_to_num(mirrored))
    np.testing.assert_allclose(evidence.confidence, likely)
    # It is no map that was asked for.
    assert match.info.sources == ["search"] and np.isnan(evidence.share)
    assert runner.count("search") == 2 and runner.count("refinement") == 3


def test_disks_are_compared_with_their_turns(alike, monkeypatch):
    turned = [starts(np.array(0.999)), starts(np.array(0.3))]
    monkeypatch.setattr(_sources, "disk_starts", lambda *args: turned)
    monkeypatch.setattr(_others, "is_disk", lambda spec: True)
    (match,) = run(Scripted([0.95], [[]]), settings=Settings(retry_below=0.9))
    # It ranks above the map so far, which is not in doubt by itself.
    assert match.info.sources == ["search", "coarse copies"] and match.info.won == 1


def test_seconds_are_shared_by_the_pairs_of_a_stage():
    one, other = run(Scripted([0.9, 0.1], {1: [0.2]}), 2)
    seconds = dict(zip(STAGES, one.info.seconds, strict=True))
    assert seconds["search"] >= 0 and np.isnan(seconds["coarse copies"])
    more = dict(zip(STAGES, other.info.seconds, strict=True))
    assert more["search"] == seconds["search"] and more["coarse copies"] >= 0


def test_retry_below_is_a_probability():
    with pytest.raises(ValueError, match="retry_below is 2"):
        Settings(retry_below=2)


def test_a_refinement_that_begins_above_the_search_needs_an_initial_map():
    with pytest.raises(ValueError, match="ks begins at 50, .* finds maps of 40"):
        run(Scripted([0.5]), settings=Settings(ks=(50, 60)))


@pytest.mark.parametrize(
    ("apart", "disks", "given", "moved"),
    [
        (0.008, False, {}, True),
        (0.01, False, {}, False),
        (0.01, True, {}, True),
        (0.02, True, {}, False),
        (0.008, False, {"landmarks": LANDMARKS}, False),
        (0.008, False, {"initial": np.eye(3)}, False),
    ],
)
def test_where_a_motion_brings_shapes_near_its_map_is_the_match(
    monkeypatch, apart, disks, given, moved
):
    found = Moved(Bent(*np.ones((2, 4, 3))), apart)
    monkeypatch.setattr(_sources, "moved_by_map", lambda *args, **options: found)
    monkeypatch.setattr(_sources, "is_disk", lambda spec: disks)
    (match,) = run(Scripted([0.95], [[0.1]], guided=0.95), **given)
    assert (match.info.start == "motion") == moved
    assert match.info.sources.count("motion") == moved
    # Whatever the confidence of either.
    np.testing.assert_allclose(likely(match), 0.95, atol=1e-6)


@pytest.mark.parametrize("mine", [False, True])
def test_a_deform_of_ones_own_is_handed_the_map_of_a_motion(monkeypatch, mine):
    found = Moved(Bent(*np.ones((2, 4, 3))), 0.001)
    mesh = Mesh(np.zeros((3, 3)), np.zeros((1, 3), np.int32))
    monkeypatch.setattr(_sources, "moved_by_map", lambda *args, **options: found)
    monkeypatch.setattr(_sources, "is_disk", lambda spec: False)
    monkeypatch.setattr(_sources, "surface_of", lambda spec: mesh)
    monkeypatch.setattr(_sources, "pulled_back", lambda T, spectra, size: np.eye(3))
    own = {"deform": lambda *args, **options: None} if mine else {}
    runner = Scripted([0.95])
    (match,) = run(runner, settings=Settings(**own))
    assert match.info.start == "motion" and runner.bent == (not mine)


def test_a_motion_is_not_asked_for_if_the_limit_is_0(monkeypatch):
    monkeypatch.setattr(_sources, "moved_by_map", None)
    (match,) = run(Scripted([0.95]), settings=Settings(rigid_below=0))
    assert match.info.sources == ["search"]
