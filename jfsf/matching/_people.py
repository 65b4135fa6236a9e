"""What a network that knows people says of pairs in doubt, and parts (`jfsf.learned`).

Where it takes both shapes for people, the map between the likeliest places is one more
start on the coarse copies, and each map there has a figure of how well it agrees with
the places. The start is refined, and judged, as all others are.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from jfsf.initial import Start
from jfsf.initial._proportions import DESCRIPTOR_WEIGHT
from jfsf.learned import (
    agreement,
    best_agreement,
    place_chances,
    places_on_person,
)
from jfsf.learned._inputs import EIGENPAIRS
from jfsf.learned._places import Places
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._others import plain_start, pulled_back
from jfsf.matching._pairs import PairState
from jfsf.matching._settings import Settings
from jfsf.runtime._runners import Runner
from jfsf.runtime._sizes import padded_pair
from jfsf.types import Match, Spectrum


def places_of(
    pairs: Sequence[PairState],
    copies: Sequence[PairState],
    runner: Runner,
    settings: Settings,
) -> list[Places | None]:
    """Where on a person the vertices of each pair lie; None unless they are people.

    Args:
        pairs: whole shapes. The network is asked about those in doubt, and not about
            self maps and maps that mirror.
        copies: of these, at few vertices.
        runner: of `place_chances`.
        settings: `people` and `retry_below` are read.
    """
    asked = [
        i
        for i, (pair, copy) in enumerate(zip(pairs, copies, strict=True))
        if pair.in_doubt(settings) and may_be_asked(copy, settings)
    ]
    found: list[Places | None] = [None] * len(copies)
    if asked:
        both = chances_of([copies[i] for i in asked], runner)
        for i, chances in zip(asked, both, strict=True):
            found[i] = places_on_person(chances, copies[i].spectra)
    return found


def places_of_parts(
    spectra: tuple[Spectrum, Spectrum],
    inputs: MatchInputs,
    runner: Runner,
    settings: Settings,
) -> Places | None:
    """Where on a person the vertices of two parts lie; None unless they are people.

    Args:
        spectra: of both shapes, without padding.
        inputs: the network is not asked about maps that mirror.
        runner, settings: as `places_of`; both are asked about, in doubt or not.
    """
    pair = PairState(padded_pair(*spectra), inputs)
    if not may_be_asked(pair, settings):
        return None
    (chances,) = chances_of([pair], runner)
    return places_on_person(chances, pair.spectra)


def may_be_asked(copy: PairState, settings: Settings) -> bool:
    """Whether the network may be asked about a pair that is in doubt."""
    preserved = int(copy.inputs.sign) > 0 and not copy.inputs.self_map
    return settings.people and preserved and len(copy.spectra[0].evals) >= EIGENPAIRS


def chances_of(copies: Sequence[PairState], runner: Runner) -> list[tuple[Any, Any]]:
    """`place_chances` of both shapes of each pair."""
    inputs = [(spec,) for copy in copies for spec in copy.spectra]
    found = runner.map("people", partial(place_chances), inputs, at_a_time=2)
    return list(zip(found[::2], found[1::2], strict=True))


def people_start(copy: PairState, places: Places, settings: Settings) -> Start:
    """The map from each vertex of X to that of Y whose chances agree best."""
    C_yx = pulled_back(
        best_agreement(*places), copy.spectra, settings.search.final_ks[-1]
    )
    return plain_start(C_yx, 1, DESCRIPTOR_WEIGHT)


def with_agreement(match: Match, places: Places, copy: PairState) -> Match:
    """With the mean of `jfsf.learned.agreement` in its certificate, both ways."""
    (x, y), (spec_x, spec_y) = places, copy.spectra
    there = agreement(match.T_xy[: len(x)], x, y), spec_x
    back = agreement(match.T_yx[: len(y)], y, x), spec_y
    each = (np.average(own, weights=s.mass[: len(own)]) for own, s in (there, back))
    mean = np.mean([*each])
    known = match.certificate
    figure = mean.astype(known.log_odds.dtype)
    return match._replace(certificate=known._replace(person_agreement=figure))
