"""Assignments of a few samples of X to samples of Y, by a beam search.

What counts is what a cut leaves: how points look near by, how far apart they are, and
in which directions they see each other. The last tells left from right. The scale
between the shapes is part of the assignment.

Landmarks are samples whose partner is given. An assignment may leave one without a
partner, as any other sample: one that is wrong is not obeyed.
"""

from typing import NamedTuple

import numpy as np

from jfsf.matching.parts._ball_descriptors import (
    ball_descriptors,
    descriptor_unlikeness,
    unlikeness,
)
from jfsf.matching.parts._settings import PartSettings
from jfsf.matching.parts._shape import PartSamples, along_cut

STATES_AT_A_TIME = 128


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
    settings: PartSettings = PartSettings(),
) -> Assigned:
    """The best assignments that differ.

    Args:
        x, y: the part and the whole, or two that overlap.
        orientation: 1 keeps left and right, -1 swaps them, 0 either.
        settings: how many are followed, and what counts in them.
    """
    which = anchors_of(x, settings)
    signs = (1, -1) if orientation == 0 else (orientation,)
    pair = _Pair(x, y, which, settings)
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
    ball_weight, scale_weight = settings.ball_weight, settings.scale_weight
    first = ball_weight * unlike[:, 0] + scale_weight * np.abs(np.log(scale))[:, None]
    every, lonely = np.arange(num), settings.unassigned_cost
    if not np.isinf(y.to_boundary).all():
        # An open whole may lack the first partner as well as any other.
        every, lonely = np.append(every, -1), settings.unassigned_cost_open
        first = np.concatenate([first, np.full((len(scale), 1), lonely)], 1)
    partner: np.ndarray = np.tile(every, len(scale))[:, None]
    of_scale: np.ndarray = np.repeat(np.arange(len(scale)), len(every))
    cost: np.ndarray = first.ravel()
    sign = np.repeat(np.asarray(signs), len(cost))
    partner, of_scale, cost = (
        np.concatenate([v] * len(signs)) for v in (partner, of_scale, cost)
    )
    # Near partners of the first that have one make a group; the last cell is of none.
    cell = np.append(np.argmin(pair.between_y[: settings.cells], 0), -1)
    band = np.arange(len(scale)) * settings.scale_bands // len(scale)
    partners, beam = settings.partners, settings.beam
    for m in range(1, len(which)):
        new = cost[:, None] + ball_weight * unlike[of_scale, m] + ruled_out[m]
        new += scale_weight * np.abs(np.log(scale))[of_scale, None]
        new += pair.cost(m, partner, scale[of_scale], sign)
        alone = cost + lonely
        new = np.concatenate([new, alone[:, None]], 1)
        if partners < num:
            # Where there is no partner yet, no distance tells the next one.
            begun = np.flatnonzero((partner >= 0).any(1))
            worse = np.argpartition(new[begun], partners, axis=1)[:, partners:]
            new[begun[:, None], worse] = np.inf
        best = np.flatnonzero(np.isfinite(new))
        best = best[np.argsort(new.ravel()[best])]
        own = band[of_scale[best // (num + 1)]][:, None]
        best = best[_first_of_groups(own, settings.beam_candidates * beam)]
        row, column = np.divmod(best, num + 1)
        added = np.where(column == num, -1, column)
        both = np.concatenate([partner[row], added[:, None]], 1)
        group = _first_partners(both, settings.grouped_anchors, cell)
        own = band[of_scale[row]][:, None]
        group = np.concatenate([group, own], 1)
        kept = _first_of_groups(group, beam // settings.min_groups)
        kept = kept[_first_of_groups(own[kept], beam // settings.scale_bands)]
        best, row, column, added = best[kept], row[kept], column[kept], added[kept]
        partner = np.concatenate([partner[row], added[:, None]], 1)
        of_scale, sign, cost = of_scale[row], sign[row], new.ravel()[best]
    order = np.argsort(cost)
    # Partners of landmarks are the same in all that obey them.
    free = ~np.isin(which, x.landmarks)
    most = -(-settings.assignments // settings.scale_bands)
    chosen = []
    for own in range(settings.scale_bands):
        these = order[band[of_scale[order]] == own]
        some = _different(
            partner[these][:, free],
            pair.between_y,
            most,
            settings.min_partner_distance,
        )
        chosen.append(these[some])
    at = np.concatenate(chosen)
    at = at[np.argsort(cost[at], kind="stable")]
    return Assigned(partner[at], which, scale[of_scale[at]], cost[at] / len(which))


def anchors_of(x: PartSamples, settings: PartSettings) -> np.ndarray:
    """Samples far apart, those away from the boundary rather than those on it.

    Landmarks come after the first of them, which may go anywhere, since they may be
    wrong. Of more than `settings.anchors` those far apart are taken.
    """
    between = x.between
    worth = settings.boundary_worth
    inner = np.clip(x.to_boundary[x.at] / settings.boundary_margin, 0, 1)
    inner = inner * (1 - worth) + worth
    known = np.isin(np.arange(len(x.at)), x.landmarks)
    mean = x.distance @ x.mass / x.mass.sum()
    chosen = [int(np.argmax(np.where(known, 0, mean * inner)))]
    far = between[chosen[0]].copy()
    num_free = min(settings.anchors, int((~known).sum())) - 1
    for free, num in (
        (known, min(settings.anchors, int(known.sum()))),
        (~known, num_free),
    ):
        for _ in range(num):
            free = free & ~np.isin(np.arange(len(free)), chosen)
            new = int(np.argmax(np.where(free, far * inner, -1)))
            chosen.append(new)
            far = np.minimum(far, between[new])
    return np.array(chosen)


class _Pair:
    """Costs of two samples and their partners."""

    def __init__(self, x: PartSamples, y: PartSamples, which, settings: PartSettings):
        self.x, self.y, self.which, self.settings = x, y, which, settings
        anchors = np.ix_(which, which)
        between_x = x.between[anchors]
        self.touches = along_cut(x.around[anchors], between_x, settings)
        self.touches_y = along_cut(y.around, y.between, settings)
        self.cut_y = self.touches_y.any()
        # A large table for each two anchors: half the precision is half the time.
        self.between_x = between_x.astype(np.float32)
        self.between_y = y.between.astype(np.float32)
        self.turn_x = x.direction[anchors].astype(np.complex64)
        self.turn_y = y.direction.astype(np.complex64)
        self.turn_to = np.ascontiguousarray(self.turn_y.T)
        self.balls_y = ball_descriptors(y, np.arange(len(y.at)), settings=settings)
        self.described = 0.0
        if x.descriptors is not None and y.descriptors is not None:
            given = x.descriptors[which], y.descriptors
            unlike = descriptor_unlikeness(*given, settings=settings)
            self.described = settings.descriptor_weight * unlike

    def unlike(self, scale) -> np.ndarray:
        settings = self.settings
        balls_x = ball_descriptors(self.x, self.which, scale, settings=settings)
        unlike = unlikeness(balls_x, self.balls_y, settings=settings)
        return unlike + self.described

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
        before, settings = None, self.settings
        slack, share = settings.distance_slack, settings.distance_share
        for j in range(m):
            b = partner[:, j]
            there = b >= 0
            far_x = (scale * self.between_x[m, j])[:, None]
            far_y = self.between_y[b]
            off = (far_x - far_y) / (slack + share * far_x)
            if self.touches[m, j]:
                off = np.where(off > 0, off * settings.shorter_weight, off)
            if self.cut_y:
                longer = (off < 0) & self.touches_y[b]
                off = np.where(longer, off * settings.shorter_weight, off)
            part = off**2 / (1 + off**2) * 2
            if before is not None:
                i = before
                both = (partner[:, i] >= 0)[:, None]
                turned = both * self.turned(m, i, j, partner, sign)
                part = part + settings.direction_weight * turned
            total += np.where(there[:, None], part, 0)
            count += there
            before = j
        return total / np.maximum(count, 1)[:, None]

    def turned(self, m, i, j, partner, sign):
        """How differently m sees i and j, and j sees i and m, as their partners do."""
        a, b = partner[:, i], partner[:, j]
        at_x, at_y = self.turn_x, self.turn_y
        turned = 0
        if not (self.touches[m, i] or self.touches[m, j]):
            seen = np.conj(at_x[m, i]) * at_x[m, j]
            seen = np.where(sign < 0, np.conj(seen), seen)[:, None]
            there = np.conj(self.turn_to[a]) * self.turn_to[b]
            turned = _square(there - seen) / 2
        if not (self.touches[j, i] or self.touches[j, m]):
            seen = np.conj(at_x[j, i]) * at_x[j, m]
            seen = np.where(sign < 0, np.conj(seen), seen)[:, None]
            there = np.conj(at_y[b, a])[:, None] * at_y[b]
            turned = turned + _square(there - seen) / 2
        return turned / 2


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
