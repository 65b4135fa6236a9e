"""Which starts are attempted, and when it ends: for one pair or many. Host side.

An attempt (`jfsf.attempt`) makes a match of a start, and says how likely it is right.
Sources of starts are asked in turn, for all pairs that are still in doubt: below
`Settings.retry_below`, or after a first map that misses a landmark. So the first
attempts of all pairs are made together, then the doubtful pairs are gathered, and pairs
without doubt cost nothing more. The most confident match of a pair is kept.

The last source, of starts for other proportions, tries all of them on coarse copies
(`jfsf.coarse`), which takes little time, together with the map so far. Only if another
map ranks above this one it goes on to the whole shapes. Maps that differ and rank
nearly as high are rivals: a map that cannot be told from another one is not certain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
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
from jfsf.coarse import CoarseCopy, coarse_copy, padded_copies
from jfsf.evidence import kept_landmarks, of_certificate, share_among, with_likely
from jfsf.initial import Start, best_start, nonisometric_starts
from jfsf.runtime import Runner
from jfsf.settings import Settings
from jfsf.types import SOURCES, STAGES, Match, MatchInfo, Spectrum


class Attempt(NamedTuple):
    """A match and where it comes from.

    source: of its start, one of `jfsf.types.SOURCES`.
    start: the map it began with.
    match: as `jfsf.attempt.finish` returns it.
    """

    source: str
    start: Start
    match: Match

    @property
    def confidence(self) -> float:
        """Of the match, by its own evidence and the landmarks; -1 if it is unknown."""
        return float(np.nan_to_num(self.match.certificate.confidence, nan=-1.0))


class Proposal(NamedTuple):
    """A start to attempt.

    start: the map to begin with.
    share: see `PairState.shares`.
    better: whether its match replaces the one so far; None: if it is more confident.
    """

    start: Start
    share: float = np.nan
    better: bool | None = None


@dataclass(eq=False)
class PairState:
    """A pair on the way.

    spectra: of X and Y, padded.
    inputs: padded, too.
    samples: of both shapes, made without landmarks.
    landmark_samples: made with them; the same where there are none.
    attempts: in their order.
    shares: for each of them, how it stands among the maps of the coarse copies
        (`jfsf.evidence.share_among`); nan if it was not compared with these.
    won: the number of the attempt that is the match.
    copies: the same of the coarse copies, if there are any, and how these lie.
    seconds: by stage; its share where a stage ran for several pairs.
    """

    spectra: tuple[Spectrum, Spectrum]
    inputs: MatchInputs
    samples: SamplesPair | Any = None
    landmark_samples: SamplesPair | Any = None
    attempts: list[Attempt] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    won: int = 0
    copies: "tuple[PairState, tuple[CoarseCopy, CoarseCopy]] | None" = None
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def best(self) -> Match:
        """The match so far."""
        return self.attempts[self.won].match

    def in_doubt(self, settings: Settings) -> bool:
        """Whether another start is to be attempted."""
        if not self.attempts:
            return True
        evidence = self.best.certificate
        # The landmark is wrong, or the map: another is made to see.
        missed = np.any(np.asarray(evidence.landmarks) > settings.evidence.missed)
        # Half of it where left and right cannot be told, of every map: no other start
        # would help. Not so with nan: there is nothing to compare.
        told = self.inputs.sign != 0 or self.inputs.landmarks is not None
        most = 1.0 if told else 0.5
        doubtful = bool(evidence.confidence < most * settings.retry_below)
        return doubtful or (len(self.attempts) == 1 and bool(missed))

    def keep(
        self, attempt: Attempt, share: float = np.nan, better: bool | None = None
    ) -> None:
        """Note an attempt; `share` and `better` are those of its `Proposal`."""
        if self.attempts and better is None:
            better = attempt.confidence > self.attempts[self.won].confidence
        if self.attempts and better:
            self.won = len(self.attempts)
        self.attempts.append(attempt)
        self.shares.append(share)

    def results(self, settings: Settings) -> list[Match]:
        """The match of each attempt, its rivals counted, with `Match.info`."""
        told = bool(self.inputs.sign != 0)
        certificates = []
        for attempt, share in zip(self.attempts, self.shares, strict=True):
            evidence = attempt.match.certificate
            share = jnp.asarray(share, evidence.confidence.dtype)
            evidence = evidence._replace(share=share)
            likely = of_certificate(evidence, told, settings=settings.evidence)
            certificates.append(evidence._replace(confidence=likely))
        confidence = [evidence.confidence for evidence in certificates]
        info = MatchInfo(
            np.array([SOURCES.index(a.source) for a in self.attempts], np.int32),
            np.array(confidence, dtype=np.asarray(confidence[0]).dtype),
            np.array(self.won, np.int32),
            np.array([self.seconds.get(stage, np.nan) for stage in STAGES]),
        )
        matches = []
        for attempt, evidence in zip(self.attempts, certificates, strict=True):
            own = info._replace(won=np.array(len(matches), np.int32))
            match = attempt.match
            changed = match.certificate.confidence, evidence.confidence
            x, y = match.confidence_x, match.confidence_y
            if x is not None and y is not None:
                x, y = (with_likely(side, *changed) for side in (x, y))
            vertices = {"confidence_x": x, "confidence_y": y}
            match = match._replace(certificate=evidence, info=own, **vertices)
            matches.append(match)
        return matches

    def result(self, settings: Settings) -> Match:
        """The best match."""
        return self.results(settings)[self.won]


class Source(NamedTuple):
    """A source of starts.

    name: one of `jfsf.types.SOURCES`.
    make: a list of starts for each of the pairs, the best first.
    always: it is asked for pairs without doubt, too.
    refined: its maps are refined already: they are bent at once.
    """

    name: str
    make: Callable[[Sequence[PairState], Runner, Settings], list[list[Proposal]]]
    always: bool = False
    refined: bool = False


def match_pairs(
    pairs: Sequence[PairState], runner: Runner, *, settings: Settings
) -> list[Match]:
    """Match pairs, and try those in doubt again.

    Args:
        pairs: all with landmarks or all without; likewise an initial map.
        runner: of the stages.
        settings: of all stages, and of further attempts.

    Raises:
        ValueError: arrays that do not fit each other, or settings that do not.
    """
    _describe(pairs, runner, settings)
    for source in _sources(pairs[0].inputs, settings):
        open_pairs = [
            pair for pair in pairs if source.always or pair.in_doubt(settings)
        ]
        starts = source.make(open_pairs, runner, settings) if open_pairs else []
        for turn in range(max(map(len, starts), default=0)):
            tried = [
                (pair, own[turn])
                for pair, own in zip(open_pairs, starts, strict=True)
                if turn < len(own) and pair.in_doubt(settings)
            ]
            if tried:
                _attempt(source, tried, runner, settings)
    return [pair.result(settings) for pair in pairs]


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
    source = _sources(pair.inputs, settings)[0]
    ((start,),) = source.make([pair], runner, settings)
    _matches([(pair, start.start)], runner, settings)


def _sources(inputs: MatchInputs, settings: Settings) -> list[Source]:
    """In the order in which they are asked."""
    if inputs.initial is not None:
        # Another map may fit as well as the given one, however well that fits.
        others = [Source("coarse copies", _rivals_of_given, always=True)]
        return [Source("given", _given), *(others if settings.retry_below else [])]
    check_search(settings)
    if not settings.retry_below:
        return [Source("search", partial(_search, landmarks=True))]
    # The first search does not know the landmarks, so it cannot be misled by them.
    sources = [Source("search", partial(_search, landmarks=False))]
    if inputs.landmarks is not None:
        sources.append(Source("landmarks", partial(_search, landmarks=True)))
    return [*sources, Source("coarse copies", _from_copies, refined=True)]


def _given(pairs, runner, settings) -> list[list[Proposal]]:
    inputs = [(*pair.spectra, pair.inputs.initial) for pair in pairs]
    stage = partial(given_start, settings=settings)
    return [[Proposal(s)] for s in _timed(runner, "search", stage, pairs, inputs)]


def _search(pairs, runner, settings, *, landmarks: bool) -> list[list[Proposal]]:
    sides = [pair.landmark_samples if landmarks else pair.samples for pair in pairs]
    inputs = _search_inputs(pairs, sides)
    stage = partial(best_start, settings=settings.search)
    return [[Proposal(s)] for s in _timed(runner, "search", stage, pairs, inputs)]


def _rivals_of_given(pairs, runner, settings) -> list[list[Proposal]]:
    """No starts: the given map is kept. But its share is known."""
    _from_copies(pairs, runner, settings)
    return [[] for _ in pairs]


def _from_copies(pairs, runner, settings) -> list[list[Proposal]]:
    """The maps of coarse copies that are most likely there, as starts."""
    started = perf_counter()
    for pair in pairs:
        pair.copies = _copied(pair, settings)
    copies = [pair.copies[0] for pair in pairs]
    _describe(copies, runner, settings)
    inputs = _search_inputs(copies, [copy.samples for copy in copies])
    stage = partial(nonisometric_starts, settings=settings.search)
    stacked = _timed(runner, "further starts", stage, copies, inputs)
    first: list[list[Start]] = [[] for _ in pairs]
    if pairs[0].inputs.initial is not None:
        stage = partial(best_start, settings=settings.search)
        first = [[s] for s in _timed(runner, "search", stage, copies, inputs)]
    tried = []
    for pair, copy, starts, found in zip(pairs, copies, stacked, first, strict=True):
        # The best so far is a rival: of the copies, too.
        known = pair.attempts[pair.won]
        own = [known.start._replace(C_yx=known.match.C_yx), *found, *_unstacked(starts)]
        size = min(len(start.C_yx) for start in own)
        tried += [(copy, s._replace(C_yx=s.C_yx[:size, :size])) for s in own]
    matches = _matches(tried, runner, settings, at_a_time=2)
    for (copy, start), match in zip(tried, matches, strict=True):
        copy.keep(Attempt("nonisometric", start, match))
    proposed = [
        _proposals(pair, copy, settings)
        for pair, copy in zip(pairs, copies, strict=True)
    ]
    share = (perf_counter() - started) / max(len(pairs), 1)
    for pair in pairs:
        pair.seconds["coarse copies"] = share
    return proposed


def _proposals(pair: PairState, copy: PairState, settings: Settings) -> list[Proposal]:
    """What is attempted on the whole shapes, the map so far counted.

    The first attempt of the copy is the map so far, which gets its share.
    """
    own = [attempt.match for attempt in copy.attempts]
    share, rank, differ = share_among(own, copy.spectra, settings=settings)
    order = np.argsort(-rank, kind="stable")
    best = int(order[0])
    better = bool(differ[best, 0])
    # A near copy of the map so far ranks first: it is the same map, a little better.
    pair.shares[pair.won] = float(share[0] if better else share[best])
    number, chosen = settings.nonisometric_attempts - (not better), [0]
    for i in order:
        if all(differ[i, j] for j in chosen):
            chosen.append(int(i))
    return [
        Proposal(_of_copies(copy.attempts[i]), float(share[i]), better and i == best)
        for i in chosen[1 : 1 + number]
    ]


def _copied(pair: PairState, settings: Settings):
    x, y = (coarse_copy(spec, settings=settings) for spec in pair.spectra)
    return PairState(*padded_copies((x, y), pair.inputs)), (x, y)


def _of_copies(attempt: Attempt) -> Start:
    """The map of an attempt on copies, as a start for the whole shapes."""
    match = attempt.match
    score = match.certificate.orientation
    return attempt.start._replace(C_yx=match.C_yx, orientation=score)


def _attempt(
    source: Source, tried: list[tuple[PairState, Proposal]], runner, settings
) -> None:
    """Attempt each start of a pair, and keep its match there."""
    starts = [(pair, proposal.start) for pair, proposal in tried]
    if source.refined:
        maps = [start.C_yx for _, start in starts]
        matches = _finished(starts, maps, runner, settings)
    else:
        matches = _matches(starts, runner, settings)
    for (pair, (start, share, better)), match in zip(tried, matches, strict=True):
        pair.keep(Attempt(source.name, start, match), share, better)


def _matches(
    tried: list[tuple[PairState, Start]], runner, settings, at_a_time: int = 1
) -> list[Match]:
    """Refine and finish each start; `jfsf.attempt.attempt` in two programs.

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
        features = _timed(runner, "kept landmarks", stage, pairs, inputs, at_a_time)
    inputs = [(own, start) for (_, start), own in zip(tried, features, strict=True)]
    stage = partial(refine_start, settings=settings)
    maps = _timed(runner, "refinement", stage, pairs, inputs, at_a_time)
    return _finished(tried, maps, runner, settings, at_a_time)


def _finished(
    tried: list[tuple[PairState, Start]], maps, runner, settings, at_a_time: int = 1
) -> list[Match]:
    """`jfsf.attempt.finish` of each refined map."""
    inputs = [
        (
            pair.spectra,
            tuple(side.search for side in pair.samples),
            C_yx,
            start,
            pair.inputs.sign,
            pair.inputs.landmarks,
        )
        for (pair, start), C_yx in zip(tried, maps, strict=True)
    ]
    stage = partial(finish, settings=settings)
    pairs = [pair for pair, _ in tried]
    return _timed(runner, "bending and conversion", stage, pairs, inputs, at_a_time)


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
