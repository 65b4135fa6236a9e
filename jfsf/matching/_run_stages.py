"""The stages of an attempt, run for many pairs; each pair notes the seconds."""

from collections.abc import Sequence
from functools import partial
from time import perf_counter

from jfsf.initial import Start
from jfsf.matching._attempt import finish, refine_start, shape_samples
from jfsf.matching._bent_copies import bent_as_copies
from jfsf.matching._kept_landmarks import kept_landmarks
from jfsf.matching._pairs import PairState
from jfsf.types import Match


def describe(pairs: Sequence[PairState], runner, settings) -> None:
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
        sides = run_stage(runner, "features", stage, twice, inputs, at_a_time=2)
        return zip(sides[::2], sides[1::2], strict=True)

    for pair, samples in zip(pairs, both(False), strict=True):
        pair.samples = pair.landmark_samples = samples
    if pairs[0].inputs.landmarks is not None:
        for pair, samples in zip(pairs, both(True), strict=True):
            pair.landmark_samples = samples


def match_starts(
    tried: list[tuple[PairState, Start]], runner, settings, at_a_time: int = 1
) -> list[Match]:
    """Refine and finish each start; `jfsf.matching.attempt` in programs of its own.

    That of the refinement serves shapes of all sizes.
    """
    maps = refined_starts(tried, runner, settings, at_a_time)
    return finish_maps(tried, maps, runner, settings, at_a_time)


def refined_starts(
    tried: list[tuple[PairState, Start]], runner, settings, at_a_time: int = 1
) -> list:
    """C_yx of each start, refined, with the landmarks that it keeps."""
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
        features = run_stage(runner, "kept landmarks", stage, pairs, inputs, at_a_time)
    inputs = [(own, start) for (_, start), own in zip(tried, features, strict=True)]
    stage = partial(refine_start, settings=settings)
    return run_stage(runner, "refinement", stage, pairs, inputs, at_a_time)


def finish_maps(
    tried: list[tuple[PairState, Start]], maps, runner, settings, at_a_time: int = 1
) -> list[Match]:
    """`finish_each` of each refined map, large shapes bent as coarse copies before."""
    maps = bent_as_copies(tried, maps, runner, settings)
    return finish_each(tried, maps, runner, settings, at_a_time)


def finish_each(
    tried: list[tuple[PairState, Start]], maps, runner, settings, at_a_time: int = 1
) -> list[Match]:
    """`jfsf.matching.finish` of each map."""
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
    return run_stage(runner, "bending and conversion", stage, pairs, inputs, at_a_time)


def search_inputs(pairs, sides) -> list[tuple]:
    """What `search_starts` and `nonisometric_starts` take, for each pair."""
    both = zip((pair.inputs for pair in pairs), sides, strict=True)
    return [(x.search, y.search, own.sign, own.self_map) for own, (x, y) in both]


def run_stage(runner, name: str, stage: partial, pairs, inputs, at_a_time: int = 1):
    """The results of a stage; each pair notes its share of the seconds."""
    started = perf_counter()
    results = runner.map(name, stage, inputs, at_a_time)
    share = (perf_counter() - started) / max(len(pairs), 1)
    for pair in pairs:
        pair.seconds[name] = pair.seconds.get(name, 0.0) + share
    return results
