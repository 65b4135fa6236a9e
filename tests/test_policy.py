"""Starts are attempted until one is confident: which, in which order, and how many.

The runner of these tests makes up the results of the stages from numbers: a start has
the confidence of its match in `gap`. Stages for real: test_match.py, test_batch.py.
"""

from typing import NamedTuple

import numpy as np
import pytest

from jfsf import Settings, policy
from jfsf.arguments import MatchInputs
from jfsf.initial import Start
from jfsf.policy import PairState, Source
from jfsf.types import STAGES, Certificate, Match

HALF = Settings(retry_below=0.5)
LANDMARKS = np.array([0]), np.array([0])


class Side(NamedTuple):
    """What is read of a shape's samples."""

    search: int
    refinement: int


def starts(values):
    values = np.asarray(values, float)
    return Start(values[..., None, None], values, values, values)


def match_of(start, missed=0.0, landmarks=None):
    figures = dict.fromkeys(Certificate._fields, np.zeros(()))
    missed = np.full(0 if landmarks is None else 1, missed)
    figures |= {"confidence": start.gap, "landmarks": missed}
    return Match(np.zeros(2, int), np.zeros(2, int), start.C_yx, Certificate(**figures))


class Scripted:
    """A runner whose pairs, told apart by their spectra, have such confidences.

    first: of each pair's first start.
    others: of those for other proportions, `screened` likewise; they are attempted in
        the order of the latter.
    guided: of the start that landmarks lead to.
    missed: how far landmarks end from their partners.
    """

    def __init__(self, first, others=(), screened=None, guided=None, missed=0.0):
        self.first, self.others, self.guided = first, others, guided
        self.screened, self.missed = screened or others, missed
        self.calls, self.rounds = [], []

    def map(self, name, stage, inputs, at_a_time=1):
        self.calls.append((name, len(inputs)))
        return [getattr(self, name.replace(" ", "_"))(*args) for args in inputs]

    def features(self, spec, descriptors, landmarks, self_map):
        return Side((spec, landmarks is not None), spec)

    def search(self, x, y, sign, self_map):
        spec, knows_landmarks = x
        return starts(self.guided if knows_landmarks else self.first[spec])

    def kept_landmarks(self, pair, features, start, landmarks):
        return features

    def refinement(self, features, start):
        return np.zeros((3, 3))

    def further_starts(self, x, y, sign, self_map):
        return starts(self.others[x[0]])

    def screening(self, pair, samples, C_yx, start, rounds, sign, landmarks):
        assert C_yx.shape == (3, 3) and rounds == Settings().screening_rounds
        at = list(self.others[pair[0]]).index(float(start.gap))
        return match_of(starts(self.screened[pair[0]][at]))

    def bending_and_conversion(
        self, pair, samples, C_yx, start, rounds, sign, landmarks
    ):
        assert rounds == Settings().bend_rounds
        return match_of(start, self.missed, landmarks)

    def count(self, name):
        return sum(number for called, number in self.calls if called == name)


def run(runner, pairs=1, *, settings=HALF, landmarks=None, **options):
    inputs = MatchInputs(landmarks=landmarks)
    some = [PairState((i, i), inputs) for i in range(pairs)]  # type: ignore[arg-type]
    return policy.match_pairs(some, runner, settings=settings, **options)


@pytest.mark.parametrize(
    ("first", "others", "chosen", "tried"),
    [
        (0.9, [1.0, 0.8], 0.9, 1),  # confident: nothing else is tried
        (0.5, [1.0, 0.8], 0.5, 1),
        (0.2, [0.6, 0.9, 0.1], 0.6, 2),  # the first that is confident
        (0.3, [0.1, 0.4], 0.4, 3),  # none is: the most confident
        (0.3, [0.1, 0.2], 0.3, 3),
        (0.3, [np.nan, 0.4], 0.4, 3),
        (0.0, [0.0], 0.0, 2),
        (np.nan, [0.9], np.nan, 1),  # there is nothing to compare
    ],
)
def test_the_most_confident_attempt_is_kept(first, others, chosen, tried):
    # As many starts as are tried: they are not screened.
    settings = Settings(retry_below=0.5, nonisometric_attempts=3)
    runner = Scripted([first], [others])
    (match,) = run(runner, settings=settings)
    np.testing.assert_equal(float(match.certificate.confidence), chosen)
    assert runner.count("refinement") == runner.count("bending and conversion") == tried
    assert runner.count("screening") == 0
    assert len(match.info.source) == tried
    np.testing.assert_equal(match.info.confidence[match.info.won], chosen)


@pytest.mark.parametrize(
    ("screened", "order"),
    [
        ([0.1, 0.7, 0.3], [0.2, 0.3]),
        ([np.nan, 0.2, 0.2], [0.2, 0.3]),  # ties: the earlier first
        ([np.nan, np.nan, 0.0], [0.3, 0.1]),
    ],
)
def test_the_starts_that_screening_likes_best_are_attempted(screened, order):
    runner = Scripted([0.0], [[0.1, 0.2, 0.3]], [screened])
    (match,) = run(runner)
    np.testing.assert_allclose(match.info.confidence, [0.0, *order])
    assert match.info.sources == ["search", "nonisometric", "nonisometric"]
    assert runner.count("screening") == 3


def test_pairs_in_doubt_are_gathered():
    first = [0.9, 0.1, 0.7, 0.2, 0.6]
    others = {1: [0.3, 0.8, 0.2], 3: [0.1, 0.3, 0.4]}
    screened = {1: [0.0, 0.9, 0.5], 3: [0.5, 0.6, 0.7]}
    runner = Scripted(first, others, screened)
    matches = run(runner, 5)
    confidence = [float(match.certificate.confidence) for match in matches]
    np.testing.assert_allclose(confidence, [0.9, 0.8, 0.7, 0.4, 0.6])
    # All first attempts together, the doubtful ones together, then the last alone.
    assert runner.calls == [
        *(("features", 10), ("search", 5)),
        *(("refinement", 5), ("bending and conversion", 5)),
        *(("further starts", 2), ("screening", 6)),
        *(("refinement", 2), ("bending and conversion", 2)),
        *(("refinement", 1), ("bending and conversion", 1)),
    ]
    assert [len(match.info.source) for match in matches] == [1, 2, 1, 3, 1]


def test_the_match_of_each_attempt_is_kept():
    pair = PairState((0, 0), MatchInputs())  # type: ignore[arg-type]
    runner = Scripted([0.2], [[0.1, 0.4]])
    (best,) = policy.match_pairs([pair], runner, settings=HALF)
    tried = pair.results()
    likely = [float(match.certificate.confidence) for match in tried]
    np.testing.assert_allclose(likely, [0.2, 0.1, 0.4])
    assert [int(match.info.won) for match in tried] == [0, 1, 2]
    starts = [match.info.start for match in tried]
    assert starts == ["search", "nonisometric", "nonisometric"]
    assert best.info.won == pair.won == 2
    assert best.certificate.confidence == 0.4
    for match in tried:
        np.testing.assert_allclose(match.info.confidence, likely)


def test_without_a_policy_there_is_one_attempt():
    once = Settings(retry_below=0)
    runner = Scripted([0.0, 0.0])
    run(runner, 2, settings=once)
    assert runner.count("refinement") == 2 and runner.count("further starts") == 0
    # Then the search reads the landmarks.
    (match,) = run(Scripted([0.0], guided=0.3), settings=once, landmarks=LANDMARKS)
    assert match.certificate.confidence == 0.3


@pytest.mark.parametrize(("other", "chosen"), [(0.6, 0.7), (0.9, 0.9)])
def test_a_missed_landmark_asks_for_another_map(other, chosen):
    runner = Scripted([0.7], [[1.0]], guided=other, missed=1.0)
    (match,) = run(runner, landmarks=LANDMARKS)
    assert match.certificate.confidence == chosen
    np.testing.assert_allclose(match.info.confidence, [0.7, other])
    assert match.info.sources == ["search", "landmarks"]
    assert match.info.start == ("search" if chosen == 0.7 else "landmarks")


def test_a_landmark_that_is_met_asks_for_nothing():
    runner = Scripted([0.7], guided=0.9, missed=0.1)
    assert run(runner, landmarks=LANDMARKS)[0].info.sources == ["search"]


def test_an_initial_map_is_the_only_start():
    runner = Scripted([0.0])
    runner.search = lambda *args: starts(0.2)
    pair = PairState((0, 0), MatchInputs(initial=np.eye(3)))  # type: ignore[arg-type]
    (match,) = policy.match_pairs([pair], runner, settings=HALF)
    assert match.info.sources == ["given"]


@pytest.mark.parametrize("has_copies", [True, False])
def test_copies_are_asked_first_and_replace_the_other_starts(has_copies):
    def copies(pairs, *_):
        return [[starts(0.3)] if has_copies else [] for _ in pairs]

    further = [Source("coarse copies", copies)]
    runner = Scripted([0.1], [[0.2, 0.4]])
    (match,) = run(runner, further=further)
    others = ["coarse copies"] if has_copies else ["nonisometric"] * 2
    assert match.info.sources == ["search", *others]
    assert match.info.start == others[-1]


def test_seconds_are_shared_by_the_pairs_of_a_stage():
    one, other = run(Scripted([0.9, 0.1], {1: [0.2]}), 2)
    seconds = dict(zip(STAGES, one.info.seconds, strict=True))
    assert seconds["search"] >= 0 and np.isnan(seconds["further starts"])
    more = dict(zip(STAGES, other.info.seconds, strict=True))
    assert more["search"] == seconds["search"] and more["further starts"] >= 0


def test_retry_below_is_a_probability():
    with pytest.raises(ValueError, match="retry_below is 2"):
        Settings(retry_below=2)


def test_a_refinement_that_begins_above_the_search_needs_an_initial_map():
    with pytest.raises(ValueError, match="ks begins at 50, .* finds maps of 40"):
        run(Scripted([0.0]), settings=Settings(ks=(50, 60)))
