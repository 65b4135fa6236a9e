"""Assignments of a few samples of X to samples of Y, by a beam search.

What counts is what a cut leaves: how points look near by, how far apart they are, and
in which directions they see each other. The last tells left from right. The scale
between the shapes is part of the assignment.

Landmarks are samples whose partner is given. An assignment may leave one without a
partner, as any other sample: one that is wrong is not obeyed.
"""

from typing import NamedTuple

import numpy as np

from jfsf.matching.parts._samples import (
    PartSamples,
    along_cut,
    ball_descriptors,
    ball_difference,
    descriptor_difference,
)
from jfsf.matching.parts._settings import ANY_UNIT_BANDS, PartSettings

STATES_AT_A_TIME = 128  # so that their tables stay in the processor's cache
# Anchors, which are far apart. One nearer to the boundary than this margin, in
# sqrt(area of the whole), counts less, down to this share of one away from it.
BOUNDARY_MARGIN, BOUNDARY_SHARE = 0.15, 0.3
# Two distances that differ by this length, and this share of the distance in the part,
# cost half of what they can cost at most.
DISTANCE_SLACK, DISTANCE_SHARE = 0.03, 0.12
SHORTER_WEIGHT = 0.4  # of one that is shorter where the other path runs along its cut
DIRECTION_WEIGHT = 1.0  # of directions to other anchors, beside the distances
BALL_WEIGHT = 1.2  # of the difference of the balls, beside the distances
DESCRIPTOR_WEIGHT = 1.0  # of descriptors that are given, beside the balls
SCALE_WEIGHT = 0.15  # of a scale e times as large or small, where both have one unit
# Cost of an anchor without a partner: beside a closed whole, and beside an open one.
UNASSIGNED_COST, UNASSIGNED_COST_OPEN = 1.1, 0.75
PARTNERS = 6  # of the next anchor, that an assignment is followed with
BEAM_CANDIDATES = 8  # assignments for each place in the beam that are put into groups
# Assignments whose first partners, this many, are in the same cells are a group. A cell
# is what is nearest to one of the first `CELLS` samples of the whole.
CELLS, GROUPED_ANCHORS = 24, 3
MIN_GROUPS = 120  # that have room in the beam, so that no group crowds out others
# Mean distance of partners, in sqrt(area of the whole), between assignments returned.
MIN_PARTNER_DISTANCE = 0.1


class Assigned(NamedTuple):
    """Assignments, the best first.

    partner: (c, a) sample of Y for each of the a samples `which` of X; -1 for none.
    which: (a,) samples of X.
    scale: (c,) factor of X's lengths.
    cost: (c,) mean cost of a sample.
    """

    partner: np.ndarray
    which: np.ndarray
    scale: np.ndarray
    cost: np.ndarray


def assign(
    x: PartSamples,
    y: PartSamples,
    *,
    orientation: int = 1,
    same_unit: bool = True,
    settings: PartSettings = PartSettings(),
) -> Assigned:
    """The best assignments that differ.

    Args:
        x, y: the part and the whole, or two that overlap.
        orientation: 1 keeps left and right, -1 swaps them, 0 either.
        same_unit: whether both are in one unit: then a scale far from 1 costs. Else
            scales fall into `ANY_UNIT_BANDS`, in their order, and each band keeps its
            share of the beam and of the result. A small part fits in many places, and
            would crowd out others.
        settings: `scales`, `anchors`, `beam` and `assignments`.
    """
    which = anchors_of(x, settings.anchors)
    bands = 1 if same_unit else ANY_UNIT_BANDS
    scale_weight = SCALE_WEIGHT if same_unit else 0.0
    signs = (1, -1) if orientation == 0 else (orientation,)
    pair = _Pair(x, y, which)
    scale: np.ndarray = np.array(settings.scales, float)
    unlike = np.stack([pair.unlike(s) for s in scale])  # (scales, a, s_y)
    num = len(y.at)
    # Of a landmark all partners are ruled out but the given one.
    ruled_out = np.zeros((len(which), num))
    for sample, given in zip(x.landmarks, y.landmarks, strict=True):
        m = which == sample
        unlike[:, m] = 0
        ruled_out[m] = np.where(np.arange(num) == given, 0, np.inf)
    # A state: partners, the number of its scale, its sign, its cost.
    first = BALL_WEIGHT * unlike[:, 0] + scale_weight * np.abs(np.log(scale))[:, None]
    every, lonely = np.arange(num), UNASSIGNED_COST
    if not np.isinf(y.to_boundary).all():
        # An open whole may lack the first partner as well as any other.
        every, lonely = np.append(every, -1), UNASSIGNED_COST_OPEN
        first = np.concatenate([first, np.full((len(scale), 1), lonely)], 1)
    partner: np.ndarray = np.tile(every, len(scale))[:, None]
    of_scale: np.ndarray = np.repeat(np.arange(len(scale)), len(every))
    cost: np.ndarray = first.ravel()
    sign = np.repeat(np.asarray(signs), len(cost))
    partner, of_scale, cost = (
        np.concatenate([v] * len(signs)) for v in (partner, of_scale, cost)
    )
    # Near partners of the first that have one make a group; the last cell is of none.
    cell = np.append(np.argmin(pair.between_y[:CELLS], 0), -1)
    band = np.arange(len(scale)) * bands // len(scale)
    beam = settings.beam
    for m in range(1, len(which)):
        new = cost[:, None] + BALL_WEIGHT * unlike[of_scale, m] + ruled_out[m]
        new += scale_weight * np.abs(np.log(scale))[of_scale, None]
        new += pair.cost(m, partner, scale[of_scale], sign)
        alone = cost + lonely
        new = np.concatenate([new, alone[:, None]], 1)
        if PARTNERS < num:
            # Where there is no partner yet, no distance tells the next one.
            begun = np.flatnonzero((partner >= 0).any(1))
            worse = np.argpartition(new[begun], PARTNERS, axis=1)[:, PARTNERS:]
            new[begun[:, None], worse] = np.inf
        best = np.flatnonzero(np.isfinite(new))
        best = best[np.argsort(new.ravel()[best])]
        own = band[of_scale[best // (num + 1)]][:, None]
        best = best[_first_of_groups(own, BEAM_CANDIDATES * beam)]
        row, column = np.divmod(best, num + 1)
        added = np.where(column == num, -1, column)
        both = np.concatenate([partner[row], added[:, None]], 1)
        group = _first_partners(both, GROUPED_ANCHORS, cell)
        own = band[of_scale[row]][:, None]
        group = np.concatenate([group, own], 1)
        kept = _first_of_groups(group, max(beam // MIN_GROUPS, 1))
        kept = kept[_first_of_groups(own[kept], max(beam // bands, 1))]
        best, row, column, added = best[kept], row[kept], column[kept], added[kept]
        partner = np.concatenate([partner[row], added[:, None]], 1)
        of_scale, sign, cost = of_scale[row], sign[row], new.ravel()[best]
    order = np.argsort(cost)
    # Partners of landmarks are the same in all that obey them.
    free = ~np.isin(which, x.landmarks)
    most = -(-settings.assignments // bands)
    chosen = []
    for own in range(bands):
        these = order[band[of_scale[order]] == own]
        some = _different(
            partner[these][:, free],
            pair.between_y,
            most,
            MIN_PARTNER_DISTANCE,
        )
        chosen.append(these[some])
    at = np.concatenate(chosen)
    at = at[np.argsort(cost[at], kind="stable")]
    return Assigned(partner[at], which, scale[of_scale[at]], cost[at] / len(which))


def anchors_of(x: PartSamples, num: int) -> np.ndarray:
    """Samples far apart, those away from the boundary rather than those on it.

    Landmarks come after the first of them, which may go anywhere, since they may be
    wrong. Of more than `num` those far apart are taken.
    """
    between = x.between
    inner = np.clip(x.to_boundary[x.at] / BOUNDARY_MARGIN, 0, 1)
    inner = inner * (1 - BOUNDARY_SHARE) + BOUNDARY_SHARE
    landmark = np.isin(np.arange(len(x.at)), x.landmarks)
    mean = x.distance @ x.mass / x.mass.sum()
    chosen = [int(np.argmax(np.where(landmark, 0, mean * inner)))]
    far = between[chosen[0]].copy()
    num_free = min(num, int((~landmark).sum())) - 1
    for free, count in (
        (landmark, min(num, int(landmark.sum()))),
        (~landmark, num_free),
    ):
        for _ in range(count):
            free = free & ~np.isin(np.arange(len(free)), chosen)
            new = int(np.argmax(np.where(free, far * inner, -1)))
            chosen.append(new)
            far = np.minimum(far, between[new])
    return np.array(chosen)


class _Pair:
    """Costs of two samples and their partners."""

    def __init__(self, x: PartSamples, y: PartSamples, which):
        self.x, self.y, self.which = x, y, which
        anchors = np.ix_(which, which)
        between_x = x.between[anchors]
        self.touches = along_cut(x.around[anchors], between_x)
        self.touches_y = along_cut(y.around, y.between)
        self.cut_y = self.touches_y.any()
        # A large table for each two anchors: half the precision is half the time.
        self.between_x = between_x.astype(np.float32)
        self.between_y = y.between.astype(np.float32)
        self.direction_x = x.direction[anchors].astype(np.complex64)
        self.direction_y = y.direction.astype(np.complex64)
        self.direction_to = np.ascontiguousarray(self.direction_y.T)
        self.balls_y = ball_descriptors(y, np.arange(len(y.at)))
        self.described = 0.0
        if x.descriptors is not None and y.descriptors is not None:
            unlike = descriptor_difference(x.descriptors[which], y.descriptors)
            self.described = DESCRIPTOR_WEIGHT * unlike

    def unlike(self, scale) -> np.ndarray:
        """(a, s_y) difference of the anchors and the samples of Y at a scale."""
        balls_x = ball_descriptors(self.x, self.which, scale)
        return ball_difference(balls_x, self.balls_y) + self.described

    def cost(self, m, partner, scale, sign):
        """(states, s_y) mean cost of sample m with each partner, to those before it."""
        # Few states at a time stay in the processor's cache.
        num = -(-len(partner) // STATES_AT_A_TIME)
        states = partner, scale.astype(np.float32), sign
        some = zip(*(np.array_split(v, num) for v in states), strict=True)
        return np.concatenate([self._cost(m, *own) for own in some])

    def _cost(self, m, partner, scale, sign):
        total = np.zeros((len(partner), len(self.y.at)), np.float32)
        count = np.zeros(len(partner), np.float32)
        before = None
        for j in range(m):
            b = partner[:, j]
            there = b >= 0
            far_x = (scale * self.between_x[m, j])[:, None]
            far_y = self.between_y[b]
            off = (far_x - far_y) / (DISTANCE_SLACK + DISTANCE_SHARE * far_x)
            if self.touches[m, j]:
                off = np.where(off > 0, off * SHORTER_WEIGHT, off)
            if self.cut_y:
                longer = (off < 0) & self.touches_y[b]
                off = np.where(longer, off * SHORTER_WEIGHT, off)
            part = off**2 / (1 + off**2) * 2
            if before is not None:
                i = before
                both = (partner[:, i] >= 0)[:, None]
                apart = both * self.direction_difference(m, i, j, partner, sign)
                part = part + DIRECTION_WEIGHT * apart
            total += np.where(there[:, None], part, 0)
            count += there
            before = j
        return total / np.maximum(count, 1)[:, None]

    def direction_difference(self, m, i, j, partner, sign):
        """How differently m sees i and j, and j sees i and m, as their partners do."""
        a, b = partner[:, i], partner[:, j]
        at_x, at_y = self.direction_x, self.direction_y
        apart = 0
        if not (self.touches[m, i] or self.touches[m, j]):
            seen = np.conj(at_x[m, i]) * at_x[m, j]
            seen = np.where(sign < 0, np.conj(seen), seen)[:, None]
            there = np.conj(self.direction_to[a]) * self.direction_to[b]
            apart = _square(there - seen) / 2
        if not (self.touches[j, i] or self.touches[j, m]):
            seen = np.conj(at_x[j, i]) * at_x[j, m]
            seen = np.where(sign < 0, np.conj(seen), seen)[:, None]
            there = np.conj(at_y[b, a])[:, None] * at_y[b]
            apart = apart + _square(there - seen) / 2
        return apart / 2


def _square(value: np.ndarray) -> np.ndarray:
    """Of the absolute values of complex numbers."""
    return np.real(value) ** 2 + np.imag(value) ** 2


def _first_partners(partner: np.ndarray, most: int, cell: np.ndarray) -> np.ndarray:
    """(states, most + 1) cells of the first `most` partners, and whose the first is."""
    order = np.argsort(partner < 0, axis=1, kind="stable")[:, :most]
    cells = cell[np.take_along_axis(partner, order, 1)]
    return np.concatenate([cells, order[:, :1]], 1)


def _first_of_groups(group: np.ndarray, most: int) -> np.ndarray:
    """Indices of rows (of small integers) that are among the first `most` of a kind."""
    # One number a row: `np.unique` of rows is slow.
    group = group - group.min(0)
    base = np.cumprod([1, *(group.max(0)[:-1] + 1)])
    kind = np.unique(group @ base, return_inverse=True)[1]
    order = np.argsort(kind, kind="stable")
    starts = np.flatnonzero(np.diff(kind[order], prepend=-1))
    sizes = np.diff(np.append(starts, len(kind)))
    rank = np.arange(len(kind)) - np.repeat(starts, sizes)
    return np.sort(order[rank < most])


def _different(partner, between, keep: int, apart: float) -> list[int]:
    """The first assignments that differ from those before."""
    chosen: list[int] = []
    free = np.ones(len(partner), bool)
    while free.any() and len(chosen) < keep:
        own = int(free.argmax())
        chosen.append(own)
        both = (partner >= 0) & (partner[own] >= 0)
        far = np.sum(both * between[partner, partner[own]], 1)
        free &= far / np.maximum(both.sum(1), 1) > apart
        free[own] = False
    return chosen
