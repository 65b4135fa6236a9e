"""Where starts come from: a given map, the search, landmarks, coarse copies."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from jfsf.initial import Start
from jfsf.initial._start import nonisometric_starts, search_starts
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._coarse import padded_copies
from jfsf.matching._confidence import COMPARED, mirror_probability
from jfsf.matching._disks import is_disk
from jfsf.matching._others import (
    disk_starts,
    energy_beyond_mirror,
    has_others,
    mirror_of,
    mirrored_pairs,
    near_ties,
    pulled_back,
    unstacked,
)
from jfsf.matching._pairs import Attempt, PairState, Standing, seconds_of
from jfsf.matching._people import people_start, places_of, with_agreement
from jfsf.matching._rigid import moved_by_map
from jfsf.matching._rivals import TIE, rivals_among, share_among
from jfsf.matching._run_stages import (
    attempt_starts,
    describe,
    search_inputs,
)
from jfsf.matching._settings import Settings
from jfsf.matching._stages import deform_by_arap
from jfsf.matching._steps import given_start
from jfsf.matching._stiff import nearest_alike
from jfsf.runtime._runners import Runner
from jfsf.runtime._sizes import surface_of
from jfsf.types import Bent

# Eigenfunctions of disks depend on where they were cut, so there a motion is better
# from farther on (`experiments/fit/fit_rigid.py`).
DISKS = 2.0


class Proposal(NamedTuple):
    """A start to attempt.

    start: the map to begin with.
    standing: of its map on coarse copies.
    bent: the shapes as they are to be compared, if nothing deforms them further.
    """

    start: Start
    standing: Standing = Standing()
    bent: Bent | None = None


class Comparison(NamedTuple):
    """What a source says of a pair.

    proposals: starts to attempt, the best first.
    standing: of the map so far; None if it was not compared with those of the copies.
    mirrored: probability that the mirror image is right; None if it was not tried.
    others: the other candidates of a search; None without one.
    copies: the coarse copies with the attempts that were made on them, or None.
    """

    proposals: Sequence[Proposal] = ()
    standing: Standing | None = None
    mirrored: float | None = None
    others: Start | None = None
    copies: PairState | None = None


class Source(NamedTuple):
    """A source of starts.

    name: one of `jfsf.types.SOURCES`.
    make: what it says of each of the pairs, which it leaves as they are.
    asked: whether it is asked for a pair.
    refined: its maps are refined already: they are bent at once.
    wins: what it finds is the map so far, made better: it is the match in any case.
    """

    name: str
    make: Callable[[Sequence[PairState], Runner, Settings], list[Comparison]]
    asked: Callable[[PairState, Settings], bool] = PairState.in_doubt
    refined: bool = False
    wins: bool = False


def sources_of(inputs: MatchInputs, settings: Settings) -> list[Source]:
    """In the order in which they are asked."""
    if inputs.initial is not None:
        # Another map may fit as well as the given one, however well that fits.
        others = [Source("coarse copies", _rivals_of_given, lambda *_: True)]
        return [Source("given", _given), *(others if settings.retry_below else [])]
    settings.check_search()
    # Without landmarks: these may say otherwise than nearest points.
    moved = []
    if settings.rigid_below and inputs.landmarks is None:
        moved = [Source("motion", _moved, lambda *_: True, refined=True, wins=True)]
    if not settings.retry_below:
        return [Source("search", partial(_search, landmarks=True)), *moved]
    # The first search does not know the landmarks, so it cannot be misled by them.
    sources = [Source("search", partial(_search, landmarks=False))]
    if inputs.landmarks is not None:
        sources.append(Source("landmarks", partial(_search, landmarks=True)))
    sources.append(Source("coarse copies", _from_copies, _needs_copies, True))
    return [*sources, *moved]


def _needs_copies(pair: PairState, settings: Settings) -> bool:
    return pair.in_doubt(settings) or has_others(pair, settings)


def _moved(pairs, runner, settings) -> list[Comparison]:
    """Where shapes nearly coincide after a similarity, a stiff deformation from it."""
    del runner
    comparisons = []
    for pair in pairs:
        known, match, (x, y) = pair.attempts[pair.won].start, pair.best, pair.spectra
        mirrors = bool(np.asarray(match.certificate.orientation) < 0)
        moved = moved_by_map(x, y, np.asarray(match.T_xy), mirrors=mirrors)
        disks = moved is not None and is_disk(x) and is_disk(y)
        limit = settings.rigid_below * (DISKS if disks else 1)
        if moved is None or moved.apart >= limit:
            comparisons.append(Comparison())
            continue
        standing = pair.standings[pair.won]
        start = Proposal(known, standing, moved.bent)
        if settings.deform is not deform_by_arap:
            # One of one's own deforms by functional maps only.
            mesh_x, mesh_y = surface_of(x), surface_of(y)
            there = mesh_x._replace(vertices=moved.bent.moved_x[: len(mesh_x.vertices)])
            T_xy = nearest_alike(there, mesh_y, mirrors=mirrors)
            C_yx = pulled_back(T_xy, pair.spectra, settings.ks[-1])
            start = Proposal(known._replace(C_yx=C_yx), standing)
        comparisons.append(Comparison([start]))
    return comparisons


def _given(pairs, runner, settings) -> list[Comparison]:
    inputs = [(*pair.spectra, pair.inputs.initial) for pair in pairs]
    stage = partial(given_start, settings=settings.of_stages())
    with seconds_of(pairs, "search"):
        starts = runner.map("search", stage, inputs)
    return [Comparison([Proposal(start)]) for start in starts]


def _search(pairs, runner, settings, *, landmarks: bool) -> list[Comparison]:
    sides = [pair.landmark_samples if landmarks else pair.samples for pair in pairs]
    return [
        Comparison([Proposal(first)], others=others)
        for first, others in _search_starts(pairs, sides, runner, settings)
    ]


def _search_starts(pairs, sides, runner, settings) -> list[tuple[Start, Start]]:
    stage = partial(search_starts, settings=settings.search)
    inputs = search_inputs(pairs, sides)
    with seconds_of(pairs, "search"):
        return runner.map("search", stage, inputs)


def _rivals_of_given(pairs, runner, settings) -> list[Comparison]:
    """No starts: the given map is kept. But its share is known."""
    # Of shapes without a surface there are no copies, and no evidence to compare.
    comparable = [not np.isnan(pair.best.certificate.log_odds) for pair in pairs]
    some = [pair for pair, there in zip(pairs, comparable, strict=True) if there]
    compared = iter(_from_copies(some, runner, settings) if some else [])
    return [
        next(compared)._replace(proposals=()) if there else Comparison()
        for there in comparable
    ]


def _from_copies(pairs, runner, settings) -> list[Comparison]:
    """The maps of coarse copies that are most likely there, as starts."""
    copies = [_copied(pair, settings) for pair in pairs]
    describe(copies, runner, settings)
    further = _further_starts(pairs, copies, runner, settings)
    tried, places = [], places_of(pairs, copies, runner, settings)
    for pair, copy, starts, seen in zip(pairs, copies, further, places, strict=True):
        # The best so far is a rival: of the copies, too.
        best = pair.attempts[pair.won]
        own = [best.start._replace(C_yx=best.match.C_yx), *starts]
        own += [*near_ties(pair, settings), *disk_starts(pair, copy, settings)]
        if seen is not None:
            own.append(people_start(copy, seen, settings))
        tried += [(copy, start) for start in own]
    mirrors = {i: mirror_of(copies[i]) for i in mirrored_pairs(pairs, settings)}
    if mirrors:
        asked = list(mirrors.values())
        found = _search_starts(asked, [one.samples for one in asked], runner, settings)
        tried += [(one, first) for one, (first, _) in zip(asked, found, strict=True)]
    size = min(len(start.C_yx) for _, start in tried)
    tried = [(copy, s._replace(C_yx=s.C_yx[:size, :size])) for copy, s in tried]
    matches = attempt_starts(tried, runner, settings, at_a_time=2)
    known = {id(copy): seen for copy, seen in zip(copies, places, strict=True)}
    for (copy, start), match in zip(tried, matches, strict=True):
        if (seen := known.get(id(copy))) is not None:
            match = with_agreement(match, seen, copy)
        copy.keep(Attempt("coarse copies", start, match), settings=settings)
    comparisons = []
    for i, copy in enumerate(copies):
        compared = _compared(copy, settings)._replace(copies=copy)
        gap = energy_beyond_mirror(copy, mirrors[i], settings) if i in mirrors else None
        if gap is not None:
            compared = compared._replace(mirrored=mirror_probability(gap))
        comparisons.append(compared)
    return comparisons


def _further_starts(pairs, copies, runner, settings) -> list[list[Start]]:
    """Of pairs in doubt those for other proportions; for a given map a search too.

    The whole shapes are searched: their samples are there, and a copy, which lacks
    fingers, may have other extremities.
    """
    given = pairs[0].inputs.initial is not None
    chosen = [i for i, p in enumerate(pairs) if given or p.in_doubt(settings)]
    further: list[list[Start]] = [[] for _ in pairs]
    some = [copies[i] for i in chosen]
    if not some:
        return further
    sides = [pairs[i].samples for i in chosen]
    stage = partial(nonisometric_starts, settings=settings.search)
    inputs = search_inputs(some, sides)
    with seconds_of(some, "further starts"):
        stacked = runner.map("further starts", stage, inputs)
    if given:
        firsts = _search_starts(some, sides, runner, settings)
        for i, (first, _) in zip(chosen, firsts, strict=True):
            further[i].append(first)
    for i, starts in zip(chosen, stacked, strict=True):
        further[i] += unstacked(starts)
    return further


def _compared(copy: PairState, settings: Settings) -> Comparison:
    """How the map so far stands, and what is attempted on the whole shapes.

    Args:
        copy: the first of its attempts is the map so far.
    """
    matches = [attempt.match for attempt in copy.attempts]
    if len(matches) == 1:  # the mirror image only is compared with it
        return Comparison()
    ranking = share_among(matches, copy.spectra)
    rivals = rivals_among(matches, ranking, settings=settings)
    rank, differ = ranking.rank, ranking.differ
    agree = [float(match.certificate.person_agreement) for match in matches]
    standings = [
        Standing(float(share), float(number), agreed)
        for share, number, agreed in zip(ranking.share, rivals, agree, strict=True)
    ]
    order = np.argsort(-rank, kind="stable")
    best = int(order[0])
    another = bool(differ[best, 0])
    # A near copy of the map so far ranks first: it is the same map, a little better.
    same = 0 if another else best
    so_far = Comparison((), standings[same])
    # Two maps that cannot be told apart: the first stays, with both counted.
    ahead = COMPARED["scale"] * float(rank[best] - rank[0])
    if rivals[same] > 0 and ahead <= TIE:
        return so_far
    number, chosen = settings.nonisometric_attempts - (not another), [0]
    for i in order:
        if all(differ[i, j] for j in chosen):
            chosen.append(int(i))
    return so_far._replace(
        proposals=[
            Proposal(_of_copies(copy.attempts[i]), standings[i])
            for i in chosen[1 : 1 + number]
        ]
    )


def _copied(pair: PairState, settings: Settings) -> PairState:
    return PairState(*padded_copies(pair.coarse_copies(settings), pair.inputs))


def _of_copies(attempt: Attempt) -> Start:
    """The map of an attempt on copies, as a start for the whole shapes."""
    match = attempt.match
    score = match.certificate.orientation
    return attempt.start._replace(C_yx=match.C_yx, orientation=score)
