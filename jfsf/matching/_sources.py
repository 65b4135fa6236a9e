"""Where starts come from: a given map, the search, landmarks, coarse copies."""

from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter
from typing import NamedTuple

import numpy as np

from jfsf.initial import Start
from jfsf.initial._start import nonisometric_starts, search_starts
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._attempt import given_start
from jfsf.matching._coarse import padded_copies
from jfsf.matching._confidence import COMPARED, mirror_probability
from jfsf.matching._disks import is_disk
from jfsf.matching._others import (
    disk_starts,
    has_others,
    mirror_figures,
    mirror_of,
    mirrored_pairs,
    near_ties,
    pulled_back,
    unstacked,
)
from jfsf.matching._pairs import Attempt, PairState
from jfsf.matching._rigid import moved_by_map
from jfsf.matching._rivals import rivals_among, share_among
from jfsf.matching._run_stages import describe, match_starts, run_stage, search_inputs
from jfsf.matching._settings import Settings
from jfsf.runtime._runners import Runner

# Eigenfunctions of disks depend on where they were cut, so there a motion is better
# from farther on (`experiments/fit/fit_rigid.py`).
DISKS = 2.0


class Proposal(NamedTuple):
    """A start to attempt.

    start: the map to begin with.
    share, rivals: see `PairState`.
    """

    start: Start
    share: float = np.nan
    rivals: float = np.nan


class Source(NamedTuple):
    """A source of starts.

    name: one of `jfsf.types.SOURCES`.
    make: a list of starts for each of the pairs, the best first.
    asked: whether it is asked for a pair.
    refined: its maps are refined already: they are bent at once.
    wins: what it finds is the map so far, made better: it is the match in any case.
    """

    name: str
    make: Callable[[Sequence[PairState], Runner, Settings], list[list[Proposal]]]
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


def _moved(pairs, runner, settings) -> list[list[Proposal]]:
    """Where shapes nearly coincide after a similarity, nearest points as a start."""
    del runner
    started, found = perf_counter(), []
    for pair in pairs:
        found.append([])
        known, match, (x, y) = pair.attempts[pair.won].start, pair.best, pair.spectra
        mirrors = bool(np.asarray(match.certificate.orientation) < 0)
        moved = moved_by_map(x, y, np.asarray(match.T_xy), mirrors=mirrors)
        if moved is None:
            continue
        disks = is_disk(x) and is_disk(y)
        if moved.apart < settings.rigid_below * (DISKS if disks else 1):
            # As large as any other map, so that one program finishes all.
            C_yx = pulled_back(moved.T_xy, pair.spectra, settings.ks[-1])
            standing = pair.shares[pair.won], pair.rivals[pair.won]
            found[-1].append(Proposal(known._replace(C_yx=C_yx), *standing))
    share = (perf_counter() - started) / max(len(pairs), 1)
    for pair in pairs:
        pair.seconds["motion"] = share
    return found


def _given(pairs, runner, settings) -> list[list[Proposal]]:
    inputs = [(*pair.spectra, pair.inputs.initial) for pair in pairs]
    stage = partial(given_start, settings=settings)
    return [[Proposal(s)] for s in run_stage(runner, "search", stage, pairs, inputs)]


def _search(pairs, runner, settings, *, landmarks: bool) -> list[list[Proposal]]:
    sides = [pair.landmark_samples if landmarks else pair.samples for pair in pairs]
    found = _searched(pairs, sides, runner, settings)
    for pair, (_, others) in zip(pairs, found, strict=True):
        pair.others = others
    return [[Proposal(first)] for first, _ in found]


def _searched(pairs, sides, runner, settings) -> list[tuple[Start, Start]]:
    stage = partial(search_starts, settings=settings.search)
    inputs = search_inputs(pairs, sides)
    return run_stage(runner, "search", stage, pairs, inputs)


def _rivals_of_given(pairs, runner, settings) -> list[list[Proposal]]:
    """No starts: the given map is kept. But its share is known."""
    # Of shapes without a surface there are no copies, and no evidence to compare.
    known = [p for p in pairs if not np.isnan(p.best.certificate.log_odds)]
    if known:
        _from_copies(known, runner, settings)
    return [[] for _ in pairs]


def _from_copies(pairs, runner, settings) -> list[list[Proposal]]:
    """The maps of coarse copies that are most likely there, as starts."""
    started = perf_counter()
    copies = [_copied(pair, settings) for pair in pairs]
    for pair, copy in zip(pairs, copies, strict=True):
        pair.copies = copy
    describe(copies, runner, settings)
    further = _further_starts(pairs, copies, runner, settings)
    tried = []
    for pair, copy, starts in zip(pairs, copies, further, strict=True):
        # The best so far is a rival: of the copies, too.
        known = pair.attempts[pair.won]
        own = [known.start._replace(C_yx=known.match.C_yx), *starts]
        own += [*near_ties(pair, settings), *disk_starts(pair, copy, settings)]
        tried += [(copy, start) for start in own]
    mirrors = {i: mirror_of(copies[i]) for i in mirrored_pairs(pairs, settings)}
    if mirrors:
        asked = list(mirrors.values())
        found = _searched(asked, [one.samples for one in asked], runner, settings)
        tried += [(one, first) for one, (first, _) in zip(asked, found, strict=True)]
    size = min(len(start.C_yx) for _, start in tried)
    tried = [(copy, s._replace(C_yx=s.C_yx[:size, :size])) for copy, s in tried]
    matches = match_starts(tried, runner, settings, at_a_time=2)
    for (copy, start), match in zip(tried, matches, strict=True):
        copy.keep(Attempt("coarse copies", start, match), settings=settings)
    proposed = [
        _proposals(pair, copy, settings)
        for pair, copy in zip(pairs, copies, strict=True)
    ]
    for i, mirror in mirrors.items():
        if figures := mirror_figures(copies[i], mirror, settings):
            pairs[i].mirrored = mirror_probability(*figures)
    share = (perf_counter() - started) / max(len(pairs), 1)
    for pair in pairs:
        pair.seconds["coarse copies"] = share
    return proposed


def _further_starts(pairs, copies, runner, settings) -> list[list[Start]]:
    """Of pairs in doubt those for other proportions; for a given map a search too."""
    given = pairs[0].inputs.initial is not None
    chosen = [i for i, p in enumerate(pairs) if given or p.in_doubt(settings)]
    further: list[list[Start]] = [[] for _ in pairs]
    some = [copies[i] for i in chosen]
    if not some:
        return further
    sides = [copy.samples for copy in some]
    stage = partial(nonisometric_starts, settings=settings.search)
    inputs = search_inputs(some, sides)
    stacked = run_stage(runner, "further starts", stage, some, inputs)
    if given:
        for i, (first, _) in zip(
            chosen, _searched(some, sides, runner, settings), strict=True
        ):
            further[i].append(first)
    for i, starts in zip(chosen, stacked, strict=True):
        further[i] += unstacked(starts)
    return further


def _proposals(pair: PairState, copy: PairState, settings: Settings) -> list[Proposal]:
    """What is attempted on the whole shapes, the map so far counted.

    The first attempt of the copy is the map so far, which gets its share.
    """
    own = [attempt.match for attempt in copy.attempts]
    if len(own) == 1:  # the mirror image only is compared with it
        return []
    standing = share_among(own, copy.spectra, settings=settings)
    rivals = rivals_among(own, standing, settings=settings)
    share, rank, differ, _ = standing
    order = np.argsort(-rank, kind="stable")
    best = int(order[0])
    another = bool(differ[best, 0])
    # A near copy of the map so far ranks first: it is the same map, a little better.
    same = 0 if another else best
    pair.shares[pair.won], pair.rivals[pair.won] = float(share[same]), rivals[same]
    # Two maps that cannot be told apart: the first stays, with both counted.
    ahead = COMPARED["scale"] * float(rank[best] - rank[0])
    if rivals[same] > 0 and ahead <= settings.evidence.tie:
        return []
    number, chosen = settings.nonisometric_attempts - (not another), [0]
    for i in order:
        if all(differ[i, j] for j in chosen):
            chosen.append(int(i))
    return [
        Proposal(_of_copies(copy.attempts[i]), float(share[i]), float(rivals[i]))
        for i in chosen[1 : 1 + number]
    ]


def _copied(pair: PairState, settings: Settings) -> PairState:
    return PairState(*padded_copies(pair.coarse_copies(settings), pair.inputs))


def _of_copies(attempt: Attempt) -> Start:
    """The map of an attempt on copies, as a start for the whole shapes."""
    match = attempt.match
    score = match.certificate.orientation
    return attempt.start._replace(C_yx=match.C_yx, orientation=score)
