"""Large shapes are bent as coarse copies first, and whole in the last rounds only."""

from collections.abc import Sequence
from functools import partial
from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jfsf.initial import Start
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._attempt import bend
from jfsf.matching._coarse import carried, padded_copies
from jfsf.matching._pairs import PairState
from jfsf.matching._settings import Settings
from jfsf.matching._stages import deform_by_arap
from jfsf.runtime._runners import Runner
from jfsf.runtime._sizes import padded_shapes, spectrum_like
from jfsf.types import Bent, Spectrum

STAGE = "bending and conversion"  # one of `jfsf.types.STAGES`


def bends_copies(pair: PairState, settings: Settings) -> bool:
    """Whether copies of the shapes are bent first.

    A `Settings.deform` of one's own is handed functional maps of whole shapes only.
    """
    return (
        max(_sizes(pair)) > settings.copies_above
        and settings.bend_rounds > settings.last_rounds
        and settings.deform is deform_by_arap
        and all(map(_has_surface, pair.spectra))
    )


def bent_as_copies(
    tried: Sequence[tuple[PairState, Start]],
    maps: Sequence[Any],
    runner: Runner,
    settings: Settings,
) -> list[Any]:
    """The maps; of large shapes, these as the maps of their copies bend them."""
    started, found = perf_counter(), list(maps)
    large = [i for i, (pair, _) in enumerate(tried) if bends_copies(pair, settings)]
    if not large:
        return found
    copies = [tried[i][0].coarse_copies(settings) for i in large]
    inputs = [
        (padded_copies(few, MatchInputs())[0], maps[i], tried[i][1])
        for i, few in zip(large, copies, strict=True)
    ]
    bent = runner.map(STAGE, partial(bend, settings=settings), inputs)
    for i, few, moved in zip(large, copies, bent, strict=True):
        pair, start = tried[i]
        mirrored = bool(start.sign < 0)
        sides = zip(moved, few, pair.spectra, strict=True)
        whole = (carried(*side, mirrored=mirrored) for side in sides)
        dtype = pair.spectra[0].vertices.dtype
        found[i] = Bent(*(jnp.asarray(points, dtype) for points in whole))
    share = (perf_counter() - started) / len(large)
    for i in large:
        seconds = tried[i][0].seconds
        seconds[STAGE] = seconds.get(STAGE, 0.0) + share
    return found


def bent_like(
    pair: PairState, C_yx: Any, start: Start, runner: Runner, settings: Settings
) -> Any:
    """As `bent_as_copies`, of shapes and types in place of arrays; it compiles."""
    if not bends_copies(pair, settings):
        return C_yx
    few = [min(n, settings.coarse_vertices) for n in _sizes(pair)]
    sizes = padded_shapes(len(pair.spectra[0].evals), [(n, 2 * n) for n in few])
    sides = zip(sizes, pair.spectra, strict=True)
    x, y = (spectrum_like(size, spec.vertices.dtype) for size, spec in sides)
    runner.map(STAGE, partial(bend, settings=settings), [((x, y), C_yx, start)])
    return Bent(*(spec.vertices for spec in pair.spectra))


def _sizes(pair: PairState) -> list[int]:
    return [len(spec.mass) for spec in pair.spectra]


def _has_surface(spec: Spectrum) -> bool:
    faces = spec.faces
    if isinstance(faces, jax.ShapeDtypeStruct):  # a cloud beside a mesh is not told yet
        return len(faces) > 0
    faces = np.asarray(faces)  # by jax this would compile for each size
    return bool(np.any(faces[:, 0] != faces[:, 1]))  # those of padding are degenerate
