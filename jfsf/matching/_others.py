"""Other maps that may fit as well as one that is not in doubt.

Near ties of the search, the mirror image where the search says that it fits better, and
of two disks those that turn the rim. They are tried on coarse copies only.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from scipy.special import expit

from jfsf.initial import Start
from jfsf.matching._disks import as_disk, is_disk, turned_maps
from jfsf.matching._pairs import PairState
from jfsf.matching._rivals import DISTINCT, map_distances, ranks
from jfsf.matching._settings import Settings

# Another candidate of the search may be a rival if its energy is no more than this
# above that of the first. Then both are compared on coarse copies.
NEAR_ENERGY = 0.015
# The mirror image is tried on coarse copies if `Certificate.mirror_gap` is below this
# (`experiments/fit/fit_mirror.py`).
MIRROR_GAP = -0.1
# `normal_gap` below which shapes are round: 0.0005 for two spheres, 0.005 for molars,
# 0.008 for bodies.
ROUND = 0.004
# Eigenvalues repeat if the next is larger by no more than this share; of the first 12
# of bodies at most 2 do, of shapes that turn about an axis 4 to 6.
REPEATED, REPEATED_AMONG, LEAST_REPEATED = 0.02, 12, 4


def has_others(pair: PairState, settings: Settings) -> bool:
    """Whether a pair without doubt has any of these."""
    if np.isnan(pair.best.certificate.log_odds):  # no surface: nothing is compared
        return False
    return bool(
        near_ties(pair, settings)
        or mirrored_pairs([pair], settings)
        or all(map(is_disk, pair.spectra))
    )


def near_ties(pair: PairState, settings: Settings) -> list[Start]:
    """The other candidates of the search that are about as good as the first.

    On round shapes the energy of equally good maps differs as much as that of a right
    map and a wrong one of bodies: all of them are taken.

    Args:
        pair: `others` are read; without a search there are none.
    """
    if pair.others is None:
        return []
    sign, limit = int(pair.inputs.sign), NEAR_ENERGY
    if _are_round(pair):
        limit = np.finfo(float).max
    some = []
    for start in unstacked(pair.others):
        near = float(start.gap) <= limit
        if near and sign * float(np.nan_to_num(start.orientation)) >= 0:
            some.append(start._replace(gap=np.full_like(start.gap, np.nan)))
    return some


def _are_round(pair: PairState) -> bool:
    """Whether both shapes have nothing to hold on to, or turn about an axis.

    Normals then agree under any map that keeps distances; or eigenvalues repeat.
    """
    if float(pair.attempts[0].match.certificate.normal_gap) < ROUND:
        return True
    counts = []
    for spec in pair.spectra:
        evals = np.asarray(spec.evals)[1 : 2 + REPEATED_AMONG]
        counts.append(np.sum(np.diff(evals) < REPEATED * evals[:-1]))
    return min(counts) >= LEAST_REPEATED


def mirrored_pairs(pairs: Sequence[PairState], settings: Settings) -> list[int]:
    """Numbers of the pairs whose mirror image may fit better.

    They are in doubt, or the search says so. Not where any orientation will do, or a
    map was given, which keeps its own; and of a self map the other is the identity.

    Args:
        pairs: with a map each.
        settings: `retry_below` is read. A gap of nan says nothing.
    """
    limit, chosen = MIRROR_GAP, []
    for i, pair in enumerate(pairs):
        inputs = pair.inputs
        asked = int(inputs.sign) != 0 and inputs.initial is None and not inputs.self_map
        gap = float(pair.attempts[0].start.mirror_gap)
        if asked and (pair.in_doubt(settings) or gap < limit):
            chosen.append(i)
    return chosen


def mirror_of(copy: PairState) -> PairState:
    """The same pair of copies, asked for the other orientation. Without attempts."""
    asked = copy.inputs._replace(sign=-copy.inputs.sign)
    fresh = {"attempts": [], "standings": [], "seconds": {}}
    return replace(copy, inputs=asked, **fresh)


def energy_beyond_mirror(
    copy: PairState, mirror: PairState, settings: Settings
) -> float | None:
    """The energy of the best map beyond that of the best one of the other orientation.

    None if that of `mirror` is in doubt itself, or if both are one map: then the search
    found none of the other orientation.
    """
    odds = float(mirror.best.certificate.log_odds)
    if not expit(odds) >= settings.retry_below:
        return None
    own = [attempt.match for attempt in copy.attempts]
    both = own[int(np.argmax(ranks(own)))], mirror.best
    if map_distances(both, copy.spectra)[0, 1] <= DISTINCT:
        return None
    energy, least = (float(match.certificate.energy) for match in both)
    return energy - least


def disk_starts(pair: PairState, copy: PairState, settings: Settings) -> list[Start]:
    """Where both shapes are disks, the best maps that turn the rim.

    Args:
        pair: whole shapes.
        copy: the same pair at few vertices.
        settings: `search`.
    """
    if not all(map(is_disk, [*pair.spectra, *copy.spectra])):
        return []
    disks = [as_disk(spec) for spec in copy.spectra]
    sign, starts = int(pair.inputs.sign), []
    size = settings.search.final_ks[-1]
    for mirrors in (False, True):
        if sign * (1 - 2 * mirrors) < 0:
            continue
        for T_xy in turned_maps(*disks, mirrors=mirrors):
            C_yx = pulled_back(T_xy, copy.spectra, size)
            weight = settings.search.descriptor_weight
            starts.append(plain_start(C_yx, 1 - 2 * mirrors, weight))
    return starts


def plain_start(C_yx: np.ndarray, side: int, weight: float) -> Start:
    """A start that no search found, of this orientation and descriptor weight."""
    side, weight, unknown = np.array([side, weight, np.nan], C_yx.dtype)
    fields: Any = (C_yx, side, unknown, weight, unknown)
    return Start(*fields)


def pulled_back(T_xy: np.ndarray, spectra, size: int) -> np.ndarray:
    """C_yx of a map of points, (size, size) if there are as many eigenpairs.

    T_xy has no padding.
    """
    x, y = spectra
    evecs_x, evecs_y, mass = (np.asarray(a) for a in (x.evecs, y.evecs, x.mass))
    n = len(T_xy)
    back = evecs_x[:n, :size].T * mass[:n]
    return (back @ evecs_y[T_xy, :size]).astype(evecs_x.dtype)


def unstacked(starts: Start) -> list[Start]:
    """The records along the leading axis."""
    # By numpy: operations on jax arrays would compile for each size.
    host = jax.device_get(starts)
    one = lambda i: jax.tree.map(lambda values: np.asarray(values[i]), host)
    return [one(i) for i in range(len(host.gap))]
