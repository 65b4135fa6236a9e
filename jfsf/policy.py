"""Which starts are attempted, and when it ends: for one pair or many. Host side.

An attempt (`jfsf.attempt`) makes a match of a start, and says how likely it is right.
Sources of starts are asked in turn, for all pairs that are still in doubt: below
`Settings.retry_below`, or after a first map that misses a landmark. So the first
attempts of all pairs are made together, then the doubtful pairs are gathered, and pairs
without doubt cost nothing more. The most confident match of a pair is kept.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import jax
import numpy as np

from jfsf.arguments import MatchInputs
from jfsf.attempt import (
    SamplesPair,
    check_search,
    finish,
    given_start,
    refine_start,
    shape_samples,
)
from jfsf.evidence import kept_landmarks
from jfsf.initial import Start, best_start, nonisometric_starts
from jfsf.runtime import Runner
from jfsf.settings import Settings
from jfsf.types import SOURCES, STAGES, Match, MatchInfo, Spectrum


@dataclass(eq=False)
class PairState:
    """A pair on the way.

    spectra: of X and Y, padded.
    inputs: padded, too.
    samples: of both shapes, made without landmarks.
    landmark_samples: made with them; the same where there are none.
    attempts: the source of each start, and its match.
    best: the most confident match; `won` is the number of its attempt.
    refined_size: rows and columns of a refined map.
    seconds: by stage; its share where a stage ran for several pairs.
    """

    spectra: tuple[Spectrum, Spectrum]
    inputs: MatchInputs
    samples: SamplesPair | Any = None
    landmark_samples: SamplesPair | Any = None
    attempts: list[tuple[str, Match]] = field(default_factory=list)
    best: Match | Any = None
    won: int = 0
    refined_size: tuple[int, int] = (0, 0)
    seconds: dict[str, float] = field(default_factory=dict)

    def in_doubt(self, settings: Settings) -> bool:
        """Whether another start is to be attempted."""
        if self.best is None:
            return True
        evidence = self.best.certificate
        # The landmark is wrong, or the map: another is made to see.
        missed = np.any(np.asarray(evidence.landmarks) > settings.evidence.missed)
        # Not so with nan: there is nothing to compare.
        doubtful = bool(evidence.confidence < settings.retry_below)
        return doubtful or (len(self.attempts) == 1 and bool(missed))

    def keep(self, source: str, match: Match) -> None:
        """Note an attempt; its match is the best if it is the most confident so far."""
        likely = match.certificate.confidence
        if self.best is None or likely > self.best.certificate.confidence:
            self.best, self.won = match, len(self.attempts)
        self.attempts.append((source, match))

    def results(self) -> list[Match]:
        """The match of each attempt, in their order, each with its `Match.info`."""
        confidence = [match.certificate.confidence for _, match in self.attempts]
        info = MatchInfo(
            np.array([SOURCES.index(name) for name, _ in self.attempts], np.int32),
            np.array(confidence, dtype=np.asarray(confidence[0]).dtype),
            np.array(self.won, np.int32),
            np.array([self.seconds.get(stage, np.nan) for stage in STAGES]),
        )
        own = (info._replace(won=np.array(i, np.int32)) for i in range(len(confidence)))
        return [
            m._replace(info=i) for (_, m), i in zip(self.attempts, own, strict=True)
        ]

    def result(self) -> Match:
        """The best match."""
        return self.results()[self.won]


class Source(NamedTuple):
    """A source of starts.

    name: one of `jfsf.types.SOURCES`.
    make: a list of starts for each of the pairs, the best first.
    unless: it is not asked for pairs that have a start of this source.
    """

    name: str
    make: Callable[[Sequence[PairState], Runner, Settings], list[list[Start]]]
    unless: str | None = None


def match_pairs(
    pairs: Sequence[PairState],
    runner: Runner,
    *,
    settings: Settings,
    further: Sequence[Source] = (),
) -> list[Match]:
    """Match pairs, and try those in doubt again.

    Args:
        pairs: all with landmarks or all without; likewise an initial map.
        runner: of the stages.
        settings: of all stages, and of further attempts.
        further: sources that are asked before the starts for shapes of other
            proportions.

    Raises:
        ValueError: arrays that do not fit each other, or settings that do not.
    """
    _describe(pairs, runner, settings)
    for source in _sources(pairs[0].inputs, settings, further):
        open_pairs = [
            pair
            for pair in pairs
            if pair.in_doubt(settings) and source.unless not in dict(pair.attempts)
        ]
        starts = source.make(open_pairs, runner, settings) if open_pairs else []
        for turn in range(max(map(len, starts), default=0)):
            tried = [
                (pair, own[turn])
                for pair, own in zip(open_pairs, starts, strict=True)
                if turn < len(own) and pair.in_doubt(settings)
            ]
            if tried:
                _attempt(source.name, tried, runner, settings)
    return [pair.result() for pair in pairs]


def compile_first_attempt(
    pair: PairState, runner: Runner, *, settings: Settings
) -> None:
    """Have the programs compiled that every pair needs; few pairs need others.

    Args:
        pair: of shapes and types in place of arrays.
        runner: `jfsf.runtime.CompileOnly`.
        settings: of all stages.
    """
    _describe([pair], runner, settings)
    source = _sources(pair.inputs, settings, ())[0]
    ((start,),) = source.make([pair], runner, settings)
    _attempt(source.name, [(pair, start)], runner, settings)


def _sources(
    inputs: MatchInputs, settings: Settings, further: Sequence[Source]
) -> list[Source]:
    """In the order in which they are asked."""
    if inputs.initial is not None:
        return [Source("given", _given)]
    check_search(settings)
    if not settings.retry_below:
        return [Source("search", partial(_search, landmarks=True))]
    # The first search does not know the landmarks, so it cannot be misled by them.
    sources = [Source("search", partial(_search, landmarks=False))]
    if inputs.landmarks is not None:
        sources.append(Source("landmarks", partial(_search, landmarks=True)))
    return [*sources, *further, Source("nonisometric", _nonisometric, "coarse copies")]


def _given(pairs, runner, settings) -> list[list[Start]]:
    inputs = [(*pair.spectra, pair.inputs.initial) for pair in pairs]
    stage = partial(given_start, settings=settings)
    return [[start] for start in _timed(runner, "search", stage, pairs, inputs)]


def _search(pairs, runner, settings, *, landmarks: bool) -> list[list[Start]]:
    sides = [pair.landmark_samples if landmarks else pair.samples for pair in pairs]
    inputs = _search_inputs(pairs, sides)
    stage = partial(best_start, settings=settings.search)
    return [[start] for start in _timed(runner, "search", stage, pairs, inputs)]


def _nonisometric(pairs, runner, settings) -> list[list[Start]]:
    """Those that are most confident after a little bending, not yet refined."""
    inputs = _search_inputs(pairs, [pair.samples for pair in pairs])
    stage = partial(nonisometric_starts, settings=settings.search)
    stacked = _timed(runner, "further starts", stage, pairs, inputs)
    starts = list(map(_unstacked, stacked))
    if len(starts[0]) <= settings.nonisometric_attempts:
        return starts
    each = [
        (pair, start) for pair, own in zip(pairs, starts, strict=True) for start in own
    ]
    maps = [(*one, _resized(one[1].C_yx, one[0].refined_size)) for one in each]
    matches = _finish("screening", maps, settings.screening_rounds, runner, settings)
    scores = [float(match.certificate.confidence) for match in matches]
    scores = np.nan_to_num(np.reshape(scores, (len(pairs), -1)), nan=-1.0)
    order = np.argsort(-scores, 1, stable=True)[:, : settings.nonisometric_attempts]
    return [[own[i] for i in row] for own, row in zip(starts, order, strict=True)]


def _attempt(
    source: str, tried: list[tuple[PairState, Start]], runner, settings
) -> None:
    """Refine and finish each start of a pair; `jfsf.attempt.attempt` in two programs.

    That of the refinement serves shapes of all sizes.
    """
    pairs = [pair for pair, _ in tried]
    features = [
        tuple(side.refinement for side in pair.landmark_samples) for pair in pairs
    ]
    if pairs[0].inputs.landmarks is not None:
        inputs = [
            (pair.spectra, own, start, pair.inputs.landmarks)
            for (pair, start), own in zip(tried, features, strict=True)
        ]
        stage = partial(kept_landmarks, settings=settings)
        features = _timed(runner, "kept landmarks", stage, pairs, inputs)
    inputs = [(own, start) for (_, start), own in zip(tried, features, strict=True)]
    stage = partial(refine_start, settings=settings)
    maps = _timed(runner, "refinement", stage, pairs, inputs)
    each = [(*one, C_yx) for one, C_yx in zip(tried, maps, strict=True)]
    matches = _finish(
        "bending and conversion", each, settings.bend_rounds, runner, settings
    )
    for pair, C_yx, match in zip(pairs, maps, matches, strict=True):
        pair.refined_size = C_yx.shape
        pair.keep(source, match)


def _finish(name: str, each, rounds: int, runner, settings) -> list[Match]:
    """`jfsf.attempt.finish` of each (pair, start, C_yx)."""
    inputs = [
        (
            pair.spectra,
            tuple(side.search for side in pair.samples),
            C_yx,
            start,
            rounds,
            pair.inputs.sign,
            pair.inputs.landmarks,
        )
        for pair, start, C_yx in each
    ]
    stage = partial(finish, settings=settings)
    return _timed(runner, name, stage, [pair for pair, *_ in each], inputs)


def _describe(pairs: Sequence[PairState], runner, settings) -> None:
    """Both shapes of each pair at samples, without landmarks and with them."""

    def both(with_landmarks: bool):
        inputs = []
        for pair in pairs:
            _, descriptors, _, _, self_map = pair.inputs
            at = pair.inputs.landmarks if with_landmarks else None
            sides = pair.spectra, descriptors or (None, None), at or (None, None)
            inputs += [(*side, self_map) for side in zip(*sides, strict=True)]
        stage = partial(shape_samples, settings=settings)
        twice = [pair for pair in pairs for _ in range(2)]
        sides = _timed(runner, "features", stage, twice, inputs, at_a_time=2)
        return zip(sides[::2], sides[1::2], strict=True)

    for pair, samples in zip(pairs, both(False), strict=True):
        pair.samples = pair.landmark_samples = samples
    if pairs[0].inputs.landmarks is not None:
        for pair, samples in zip(pairs, both(True), strict=True):
            pair.landmark_samples = samples


def _timed(runner, name: str, stage: partial, pairs, inputs, at_a_time: int = 1):
    """The results of a stage; each pair notes its share of the seconds."""
    started = perf_counter()
    results = runner.map(name, stage, inputs, at_a_time)
    share = (perf_counter() - started) / max(len(pairs), 1)
    for pair in pairs:
        pair.seconds[name] = pair.seconds.get(name, 0.0) + share
    return results


def _search_inputs(pairs, sides) -> list[tuple]:
    both = zip((pair.inputs for pair in pairs), sides, strict=True)
    return [(x.search, y.search, own.sign, own.self_map) for own, (x, y) in both]


def _unstacked(starts: Start) -> list[Start]:
    # By numpy, as below: operations on jax arrays would compile for each size.
    host = jax.device_get(starts)
    one = lambda i: jax.tree.map(lambda values: np.asarray(values[i]), host)
    return [one(i) for i in range(len(host.gap))]


def _resized(C_yx, size: tuple[int, int]):
    """As large as a refined map, cut or with zeros: one program finishes both."""
    C_yx = C_yx[: size[0], : size[1]]
    return np.pad(C_yx, [(0, n - k) for n, k in zip(size, C_yx.shape, strict=True)])
