"""Large shapes are bent as coarse copies first, and whole in the last rounds only."""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jfsf.initial import Start
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._coarse import carried, padded_copies
from jfsf.matching._pairs import PairState, seconds_of
from jfsf.matching._settings import Settings
from jfsf.matching._stages import deform_by_arap
from jfsf.matching._steps import Work, bend
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
    pairs: Sequence[PairState],
    works: Sequence[Work],
    runner: Runner,
    settings: Settings,
) -> list[Work]:
    """The works before their last step; large shapes bent as their copies are."""
    bent_works = list(works)
    large = [
        i
        for i, (pair, work) in enumerate(zip(pairs, works, strict=True))
        if bends_copies(pair, settings) and not isinstance(work.C_yx, Bent)
    ]
    if not large:
        return bent_works
    with seconds_of([pairs[i] for i in large], STAGE):
        inputs = [
            (_spectra_of_copies(pairs[i], settings), works[i].C_yx, works[i].start)
            for i in large
        ]
        bent = runner.map(STAGE, partial(bend, settings=settings.of_stages()), inputs)
        for i, moved in zip(large, bent, strict=True):
            whole = _whole_as(moved, pairs[i], works[i].start, settings)
            bent_works[i] = works[i]._replace(C_yx=whole)
    return bent_works


def _spectra_of_copies(
    pair: PairState, settings: Settings
) -> tuple[Spectrum, Spectrum]:
    """Those of the coarse copies, or the shapes and types that they will have."""
    if not _only_shapes(pair):
        return padded_copies(pair.coarse_copies(settings), MatchInputs())[0]
    few = [min(n, settings.coarse_vertices) for n in _sizes(pair)]
    sizes = padded_shapes(len(pair.spectra[0].evals), [(n, 2 * n) for n in few])
    sides = zip(sizes, pair.spectra, strict=True)
    x, y = (spectrum_like(size, spec.vertices.dtype) for size, spec in sides)
    return x, y


def _whole_as(moved: Bent, pair: PairState, start: Start, settings: Settings) -> Bent:
    """The whole shapes, bent as their copies."""
    if _only_shapes(pair):
        return Bent(*(spec.vertices for spec in pair.spectra))
    copies, mirrored = pair.coarse_copies(settings), bool(start.sign < 0)
    sides = zip(moved, copies, pair.spectra, strict=True)
    whole = (carried(*side, mirrored=mirrored) for side in sides)
    dtype = pair.spectra[0].vertices.dtype
    return Bent(*(jnp.asarray(points, dtype) for points in whole))


def _only_shapes(pair: PairState) -> bool:
    """Whether programs are only compiled: there are shapes and types, no arrays."""
    return isinstance(pair.spectra[0].vertices, jax.ShapeDtypeStruct)


def _sizes(pair: PairState) -> list[int]:
    return [len(spec.mass) for spec in pair.spectra]


def _has_surface(spec: Spectrum) -> bool:
    faces = spec.faces
    if isinstance(faces, jax.ShapeDtypeStruct):  # a cloud beside a mesh is not told yet
        return len(faces) > 0
    faces = np.asarray(faces)  # by jax this would compile for each size
    return bool(np.any(faces[:, 0] != faces[:, 1]))  # those of padding are degenerate
