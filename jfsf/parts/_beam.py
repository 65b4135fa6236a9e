"""Assignments of a few samples of X to samples of Y, by a beam search.

What counts is what a cut leaves: how points look near by, how far apart they are, and
in which directions they see each other. The last tells left from right. The scale
between the shapes is part of the assignment.
"""

from typing import NamedTuple

import numpy as np

from jfsf.parts._ball_descriptors import ball_descriptors, unlikeness
from jfsf.parts._shape import PartSamples

# Factors of X's lengths that are tried.
SCALES = tuple(float(s) for s in np.exp(np.linspace(-0.45, 0.45, 10)))
# Distances may differ by this length and this share before they count half.
SLACK, SHARE = 0.03, 0.12
# Factor of that where the path in X runs along a cut: in the whole it may be shorter.
SHORTER = 0.4
# Of the directions, and of the balls, beside the distances.
TURN_WEIGHT, BALL_WEIGHT = 1.0, 1.2
# Cost of a scale e times as large or small, per sample.
SCALE_WEIGHT = 0.15
# Partners of the next sample that an assignment is followed with.
CHILDREN = 6
# So many samples of Y are cells. Assignments whose first samples go to the same cells
# are a group, and no group has more than a share of all: else one would crowd out the
# others before it is known to be wrong.
CELLS, GROUPED, GROUPS = 24, 3, 12
# A sample without a partner costs as much, beside a closed shape and an open one.
ALONE, ALONE_OPEN = 1.1, 0.75


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
    anchors: int = 16,
    width: int = 1500,
    scales: tuple[float, ...] = SCALES,
    orientation: int = 1,
    keep: int = 8,
    apart: float = 0.15,
) -> Assigned:
    """The best assignments that differ.

    Args:
        x, y: the part and the whole, or two that overlap.
        anchors: samples of X to assign.
        width: assignments that are followed.
        scales: factors of X's lengths to try.
        orientation: 1 keeps left and right, -1 swaps them, 0 either.
        keep: assignments to return.
        apart: mean distance of partners in which two of these differ.
    """
    which = anchors_of(x, anchors)
    signs = (1, -1) if orientation == 0 else (orientation,)
    pair = _Pair(x, y, which)
    scale: np.ndarray = np.array(scales, float)
    unlike = np.stack([pair.unlike(s) for s in scale])  # (scales, a, s_y)
    num = len(y.at)
    # A state: partners, the number of its scale, its sign, its cost.
    first = BALL_WEIGHT * unlike[:, 0] + SCALE_WEIGHT * np.abs(np.log(scale))[:, None]
    partner: np.ndarray = np.tile(np.arange(num), len(scale))[:, None]
    of_scale: np.ndarray = np.repeat(np.arange(len(scale)), num)
    cost: np.ndarray = first.ravel()
    sign = np.repeat(np.asarray(signs), len(cost))
    partner, of_scale, cost = (
        np.concatenate([v] * len(signs)) for v in (partner, of_scale, cost)
    )
    # Near partners of the first samples make one group; the last cell is no partner.
    cell = np.append(np.argmin(pair.between_y[: min(CELLS, num)], 0), -1)
    lonely = ALONE if np.isinf(y.to_boundary).all() else ALONE_OPEN
    for m in range(1, len(which)):
        new = cost[:, None] + BALL_WEIGHT * unlike[of_scale, m]
        new += SCALE_WEIGHT * np.abs(np.log(scale))[of_scale, None]
        new += pair.cost(m, partner, scale[of_scale], sign)
        alone = cost + lonely
        new = np.concatenate([new, alone[:, None]], 1)
        if CHILDREN < num:
            worse = np.argpartition(new, CHILDREN, axis=1)[:, CHILDREN:]
            np.put_along_axis(new, worse, np.inf, 1)
        best = np.argsort(new.ravel())[: 8 * width]
        best = best[np.isfinite(new.ravel()[best])]
        row, column = np.divmod(best, num + 1)
        added = np.where(column == num, -1, column)
        group = cell[np.concatenate([partner[row], added[:, None]], 1)[:, :GROUPED]]
        kept = _first_of_groups(group, width // GROUPS)[:width]
        best, row, column, added = best[kept], row[kept], column[kept], added[kept]
        partner = np.concatenate([partner[row], added[:, None]], 1)
        of_scale, sign, cost = of_scale[row], sign[row], new.ravel()[best]
    order = np.argsort(cost)
    chosen = _different(partner[order], pair.between_y, keep, apart)
    at = order[chosen]
    return Assigned(partner[at], which, scale[of_scale[at]], cost[at] / len(which))


def anchors_of(x: PartSamples, num: int) -> np.ndarray:
    """Samples far apart, those away from the boundary rather than those on it."""
    between = x.between
    inner = np.clip(x.to_boundary[x.at] / 0.15, 0, 1) * 0.7 + 0.3
    mean = x.distance @ x.mass / x.mass.sum()
    chosen = [int(np.argmax(mean * inner))]
    far = between[chosen[0]].copy()
    for _ in range(min(num, len(x.at)) - 1):
        new = int(np.argmax(far * inner))
        chosen.append(new)
        far = np.minimum(far, between[new])
    return np.array(chosen)


class _Pair:
    """Costs of two samples and their partners."""

    def __init__(self, x: PartSamples, y: PartSamples, which):
        self.x, self.y, self.which = x, y, which
        self.between_x = x.between[np.ix_(which, which)]
        self.between_y = y.between
        around = x.around[np.ix_(which, which)]
        # Shortest paths along the cut: in the whole they may be shorter.
        self.touches = around < 1.02 * self.between_x + 0.01
        self.turn_x = x.direction[np.ix_(which, which)]
        self.turn_y = y.direction
        self.balls_y = ball_descriptors(y, np.arange(len(y.at)))

    def unlike(self, scale) -> np.ndarray:
        return unlikeness(ball_descriptors(self.x, self.which, scale), self.balls_y)

    def cost(self, m, partner, scale, sign):
        """(states, s_y) mean cost of sample m with each partner, to those before it."""
        total = np.zeros((len(partner), len(self.y.at)), np.float32)
        count = np.zeros(len(partner), np.float32)
        before = None
        for j in range(m):
            b = partner[:, j]
            there = b >= 0
            far_x = (scale * self.between_x[m, j])[:, None]
            far_y = self.between_y[b]
            off = (far_x - far_y) / (SLACK + SHARE * far_x)
            if self.touches[m, j]:
                off = np.where(off > 0, off * SHORTER, off)
            part = off**2 / (1 + off**2) * 2
            if before is not None:
                i = before
                both = (partner[:, i] >= 0)[:, None]
                part = part + TURN_WEIGHT * both * self.turned(m, i, j, partner, sign)
            total += np.where(there[:, None], part, 0)
            count += there
            before = j
        return total / np.maximum(count, 1)[:, None]

    def turned(self, m, i, j, partner, sign):
        """How differently m sees i and j, and j sees i and m, as their partners do."""
        a, b = partner[:, i], partner[:, j]
        at_x, at_y = self.turn_x, self.turn_y
        found = 0
        if not (self.touches[m, i] or self.touches[m, j]):
            seen = np.conj(at_x[m, i]) * at_x[m, j]
            seen = np.where(sign < 0, np.conj(seen), seen)[:, None]
            found = np.abs((np.conj(at_y[:, a]) * at_y[:, b]).T - seen) ** 2 / 2
        if not (self.touches[j, i] or self.touches[j, m]):
            seen = np.conj(at_x[j, i]) * at_x[j, m]
            seen = np.where(sign < 0, np.conj(seen), seen)[:, None]
            there = np.conj(at_y[b, a])[:, None] * at_y[b]
            found = found + np.abs(there - seen) ** 2 / 2
        return found / 2


def _first_of_groups(group: np.ndarray, most: int) -> np.ndarray:
    """Indices of rows that are among the first `most` of their kind."""
    kind = np.unique(group, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(kind, kind="stable")
    starts = np.flatnonzero(np.diff(kind[order], prepend=-1))
    sizes = np.diff(np.append(starts, len(kind)))
    rank = np.arange(len(kind)) - np.repeat(starts, sizes)
    return np.sort(order[rank < most])


def _different(partner, between, keep: int, apart: float) -> list[int]:
    """The first assignments that differ from those before."""
    chosen: list[int] = []
    for i, row in enumerate(partner):
        known = [
            np.mean(between[row, partner[c]][(row >= 0) & (partner[c] >= 0)])
            for c in chosen
        ]
        if all(k > apart for k in known):
            chosen.append(i)
        if len(chosen) == keep:
            break
    return chosen
