"""The stages of an attempt, run for many pairs; each pair notes the seconds."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

from jfsf.initial import Start
from jfsf.matching._bent_copies import bent_as_copies
from jfsf.matching._pairs import PairState, seconds_of
from jfsf.matching._settings import Settings
from jfsf.matching._steps import FINISH, shape_samples, steps_of
from jfsf.runtime._runners import Runner
from jfsf.types import Bent, Match


def describe(pairs: Sequence[PairState], runner: Runner, settings: Settings) -> None:
    """Both shapes of each pair at samples, without landmarks and with them."""

    def both(with_landmarks: bool):
        inputs = []
        for pair in pairs:
            _, descriptors, _, _, self_map = pair.inputs
            at = pair.inputs.landmarks if with_landmarks else None
            sides = pair.spectra, descriptors or (None, None), at or (None, None)
            inputs += [(*side, self_map) for side in zip(*sides, strict=True)]
        stage = partial(shape_samples, settings=settings.of_stages())
        with seconds_of(pairs, "features"):
            sides = runner.map("features", stage, inputs, at_a_time=2)
        return zip(sides[::2], sides[1::2], strict=True)

    for pair, samples in zip(pairs, both(False), strict=True):
        pair.samples = pair.landmark_samples = samples
    if pairs[0].inputs.landmarks is not None:
        for pair, samples in zip(pairs, both(True), strict=True):
            pair.landmark_samples = samples


def attempt_starts(
    tried: Sequence[tuple[PairState, Start]],
    runner: Runner,
    settings: Settings,
    *,
    refined: Sequence[Any] | None = None,
    at_a_time: int = 1,
) -> list[Match]:
    """`jfsf.matching.attempt` of each start, each step in a program of its own.

    The program of the refinement serves shapes of all sizes. Large shapes are bent as
    coarse copies before the last step.

    Args:
        tried: pairs, all with landmarks or all without, and a start for each.
        runner: of the steps; `CompileOnly` has their programs compiled.
        settings: of all stages.
        refined: the map C_yx of each start, where it needs no refinement; or for all
            the shapes as they are compared, where nothing deforms them further.
        at_a_time: as `Runner.map`.
    """
    pairs = [pair for pair, _ in tried]
    works = [pair.begin(start) for pair, start in tried]
    steps = steps_of(pairs[0].inputs.landmarks)
    if refined is not None:
        works = [w._replace(C_yx=C) for w, C in zip(works, refined, strict=True)]
        steps = (FINISH,)
        if any(isinstance(one, Bent) for one in refined):
            settings = replace(settings, last_rounds=0)
    for step in steps:
        if step is FINISH:
            works = bent_as_copies(pairs, works, runner, settings)
        inputs = [step.reads(work) for work in works]
        stage = partial(step.run, settings=settings.of_stages())
        with seconds_of(pairs, step.name):
            made = runner.map(step.name, stage, inputs, at_a_time)
        works = [step.done(*both) for both in zip(works, made, strict=True)]
    return [cast(Match, work.match) for work in works]


def search_inputs(pairs, sides) -> list[tuple]:
    """What `search_starts` and `nonisometric_starts` take, for each pair."""
    both = zip((pair.inputs for pair in pairs), sides, strict=True)
    return [(x.search, y.search, own.sign, own.self_map) for own, (x, y) in both]
