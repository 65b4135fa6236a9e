"""The sources of starts in turn, for all pairs that are still in doubt."""

from collections.abc import Sequence
from functools import partial

import jax

from jfsf.initial._start import nonisometric_starts
from jfsf.matching._pairs import Attempt, PairState, seconds_of
from jfsf.matching._people import chances_of, may_be_asked
from jfsf.matching._run_stages import (
    attempt_starts,
    describe,
    search_inputs,
)
from jfsf.matching._settings import Settings
from jfsf.matching._sources import Comparison, Proposal, Source, sources_of
from jfsf.runtime._runners import Runner
from jfsf.types import Match

# Sources whose time is noted as a whole, beside that of the stages in it.
TIMED = ("coarse copies", "motion")


def match_pairs(
    pairs: Sequence[PairState], runner: Runner, *, settings: Settings
) -> list[Match]:
    """`attempt_pairs`, and the match of each pair."""
    attempt_pairs(pairs, runner, settings=settings)
    return [pair.result(settings) for pair in pairs]


def attempt_pairs(
    pairs: Sequence[PairState], runner: Runner, *, settings: Settings
) -> None:
    """Match pairs, and try those in doubt again; the pairs keep all attempts.

    Args:
        pairs: all with landmarks or all without, and all with an initial map or all
            without.
        runner: of the stages.
        settings: of all stages, and of further attempts.

    Raises:
        ValueError: arrays that do not fit each other, or settings that do not.
    """
    describe(pairs, runner, settings)
    for source in sources_of(pairs[0].inputs, settings):
        open_pairs = [pair for pair in pairs if source.asked(pair, settings)]
        if not open_pairs:
            continue
        with seconds_of(open_pairs if source.name in TIMED else [], source.name):
            comparisons = source.make(open_pairs, runner, settings)
        for pair, compared in zip(open_pairs, comparisons, strict=True):
            _note(pair, compared)
        starts = [compared.proposals for compared in comparisons]
        for turn in range(max(map(len, starts))):
            tried = [
                (pair, own[turn])
                for pair, own in zip(open_pairs, starts, strict=True)
                if turn < len(own) and _worth(source, pair, own[turn], settings)
            ]
            if tried:
                _attempt(source, tried, runner, settings)


def _note(pair: PairState, compared: Comparison) -> None:
    """Write what a source says of a pair into it."""
    if compared.others is not None:
        pair.others = compared.others
    if compared.copies is not None:
        pair.copies = compared.copies
    if compared.mirrored is not None:
        pair.mirrored = compared.mirrored
    if compared.standing is not None:
        pair.standings[pair.won] = compared.standing


def _worth(
    source: Source, pair: PairState, proposal: Proposal, settings: Settings
) -> bool:
    """In doubt, or where it ranks above the map so far."""
    if source.wins or pair.in_doubt(settings):
        return True
    return bool(proposal.standing.share > pair.standings[pair.won].share)


def compile_first_attempt(
    pair: PairState, runner: Runner, *, settings: Settings
) -> None:
    """Have the programs compiled that every pair needs; few pairs need others.

    Args:
        pair: of shapes and types in place of arrays.
        runner: `CompileOnly`.
        settings: of all stages.
    """
    describe([pair], runner, settings)
    (compared,) = sources_of(pair.inputs, settings)[0].make([pair], runner, settings)
    attempt_starts([(pair, compared.proposals[0].start)], runner, settings)


def compile_copies(copy: PairState, runner: Runner, *, settings: Settings) -> None:
    """Have the programs compiled that pairs in doubt need beside those of every pair.

    Args:
        copy: of shapes and types in place of the arrays of two coarse copies.
        runner: `CompileOnly`.
        settings: of all stages.
    """
    describe([copy], runner, settings)
    inputs = search_inputs([copy], [copy.samples])
    stage = partial(nonisometric_starts, settings=settings.search)
    (stacked,) = runner.map("further starts", stage, inputs)
    if may_be_asked(copy, settings):
        chances_of([copy], runner)
    one = jax.tree.map(lambda s: jax.ShapeDtypeStruct(s.shape[1:], s.dtype), stacked)
    attempt_starts([(copy, one)], runner, settings)


def _attempt(
    source: Source, tried: list[tuple[PairState, Proposal]], runner, settings
) -> None:
    """Attempt each start of a pair, and keep its match there."""
    starts, refined = [(pair, proposal.start) for pair, proposal in tried], None
    if source.refined:
        refined = [own.bent or own.start.C_yx for _, own in tried]
        # As large as any other start, so that one program finishes both.
        k = settings.search.final_ks[-1]
        starts = [(p, s._replace(C_yx=s.C_yx[:k, :k])) for p, s in starts]
    matches = attempt_starts(starts, runner, settings, refined=refined)
    for (pair, own), match in zip(tried, matches, strict=True):
        attempt = Attempt(source.name, own.start, match)
        pair.keep(attempt, own.standing, settings=settings, wins=source.wins)
