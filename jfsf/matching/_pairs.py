"""A pair on the way: what was attempted, and which match is the best so far."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jfsf.initial import Start
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._coarse import CoarseCopy, coarse_copy
from jfsf.matching._confidence import confidence_of
from jfsf.matching._kept_landmarks import MISSED
from jfsf.matching._settings import Settings
from jfsf.matching._steps import SamplesPair, ShapeSamples, Work, begin
from jfsf.matching._vertices import vertex_confidence
from jfsf.types import SOURCES, STAGES, Match, MatchInfo, Spectrum


class Standing(NamedTuple):
    """What the comparison on coarse copies says of a map; nan without one.

    share: of the odds of all that differ from it (`share_among`).
    rivals: how many other maps are as likely (`rivals_among`).
    person_agreement: see `Certificate`.
    """

    share: float = np.nan
    rivals: float = np.nan
    person_agreement: float = np.nan


class Attempt(NamedTuple):
    """A match and where it comes from.

    source: of its start, one of `jfsf.types.SOURCES`.
    start: the map it began with.
    match: as `finish` returns it.
    """

    source: str
    start: Start
    match: Match


@dataclass(eq=False)
class PairState:
    """A pair on the way.

    spectra: of X and Y, padded.
    inputs: what was given beside the shapes, padded.
    samples: of both shapes, made without landmarks.
    landmark_samples: made with them; the same where there are none.
    attempts: those that were made, in their order.
    standings: of each of them.
    mirrored: see `Certificate`; nan if the mirror image was not tried.
    others: the candidates of the search beside the first (`search_starts`).
    won: the number of the attempt that is the match.
    coarse: the coarse copies of both shapes, once they are made.
    copies: the pair of the coarse copies, with its attempts, where starts were tried on
        them.
    seconds: by stage; its share where a stage ran for several pairs.
    unpadded: vertices of X and Y without padding; None leaves it to the caller.
    """

    spectra: tuple[Spectrum, Spectrum]
    inputs: MatchInputs
    samples: SamplesPair | Any = None
    landmark_samples: SamplesPair | Any = None
    attempts: list[Attempt] = field(default_factory=list)
    standings: list[Standing] = field(default_factory=list)
    mirrored: float = np.nan
    others: Start | None = None
    won: int = 0
    coarse: tuple[CoarseCopy, CoarseCopy] | None = None
    copies: "PairState | None" = None
    seconds: dict[str, float] = field(default_factory=dict)
    unpadded: tuple[int, int] | None = None

    @property
    def best(self) -> Match:
        """The match so far."""
        return self.attempts[self.won].match

    def coarse_copies(self, settings: Settings) -> tuple[CoarseCopy, CoarseCopy]:
        """Of X and Y; made at the first call."""
        if self.coarse is None:
            x, y = (coarse_copy(spec, settings=settings) for spec in self.spectra)
            self.coarse = x, y
        return self.coarse

    def begin(self, start: Start) -> Work:
        """The work of an attempt: the evidence does not know the landmarks."""
        both = zip(self.samples, self.landmark_samples, strict=True)
        x, y = (ShapeSamples(plain.search, known.refinement) for plain, known in both)
        sign, landmarks = self.inputs.sign, self.inputs.landmarks
        return begin(self.spectra, (x, y), start, sign, landmarks)

    def in_doubt(self, settings: Settings) -> bool:
        """Whether another start is to be attempted."""
        if not self.attempts:
            return True
        evidence = self.best.certificate
        # The landmark is wrong, or the map: another is made to see.
        missed = np.any(np.asarray(evidence.landmarks) > MISSED)
        # Half of it where left and right cannot be told, of every map: no other start
        # would help. Not so with nan: there is nothing to compare.
        told = self.inputs.sign != 0 or self.inputs.landmarks is not None
        most = 1.0 if told else 0.5
        doubtful = bool(evidence.confidence < most * settings.retry_below)
        return doubtful or (len(self.attempts) == 1 and bool(missed))

    def keep(
        self,
        attempt: Attempt,
        standing: Standing = Standing(),
        *,
        settings: Settings,
        wins: bool = False,
    ) -> None:
        """Note an attempt; it is the match if it is likelier than that so far.

        wins: it is the match in any case.
        """
        self.attempts.append(attempt)
        self.standings.append(standing)
        last = len(self.attempts) - 1
        merit, so_far = (self._merit(i, settings) for i in (last, self.won))
        if wins or merit > so_far:
            self.won = last

    def _merit(self, number: int, settings: Settings) -> tuple[float, float]:
        """How likely an attempt is, its rivals counted, and its share: rivals may tie.

        -1 if one is unknown.
        """
        evidence = self._result(number, settings).certificate
        told = bool(self.inputs.sign != 0)
        likely = confidence_of(evidence, told, limited=False)
        return float(np.nan_to_num(likely, nan=-1.0)), float(
            np.nan_to_num(evidence.share, nan=-1.0)
        )

    def results(self, settings: Settings) -> list[Match]:
        """The match of each attempt, its rivals counted, with `Match.info`."""
        matches = [self._result(i, settings) for i in range(len(self.attempts))]
        confidence = [match.certificate.confidence for match in matches]
        info = MatchInfo(
            np.array([SOURCES.index(a.source) for a in self.attempts], np.int32),
            np.array(confidence, dtype=np.asarray(confidence[0]).dtype),
            np.array(self.won, np.int32),
            np.array([self.seconds.get(stage, np.nan) for stage in STAGES]),
        )
        numbers = np.arange(len(matches), dtype=np.int32)
        return [
            match._replace(info=info._replace(won=number))
            for match, number in zip(matches, numbers, strict=True)
        ]

    def _result(self, number: int, settings: Settings) -> Match:
        """With how it stands, if it was compared, and the confidence that follows."""
        match = self.attempts[number].match
        known = self.standings[number]._asdict() | {"mirrored": self.mirrored}
        if np.isnan([*known.values()]).all():
            return match
        before = match.certificate
        dtype = before.confidence.dtype
        evidence = before._replace(
            **{name: jnp.asarray(value, dtype) for name, value in known.items()}
        )
        told = bool(self.inputs.sign != 0)
        likely = confidence_of(evidence, told)
        evidence = evidence._replace(confidence=likely)
        x, y = (
            side if side is None else vertex_confidence(side, likely)
            for side in (match.radius_x, match.radius_y)
        )
        return match._replace(certificate=evidence, confidence_x=x, confidence_y=y)

    def result(self, settings: Settings) -> Match:
        """The best match, without padding where `unpadded` is known."""
        best = self.results(settings)[self.won]
        return best if self.unpadded is None else best.without_padding(*self.unpadded)


@contextmanager
def seconds_of(pairs: Sequence[PairState], name: str) -> Iterator[None]:
    """What is done inside counts as a stage of each pair, which notes its share."""
    started = perf_counter()
    yield
    share = (perf_counter() - started) / max(len(pairs), 1)
    for pair in pairs:
        pair.seconds[name] = pair.seconds.get(name, 0.0) + share
