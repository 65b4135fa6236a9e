"""Which pieces of two shapes belong together: the best assignment.

Costs c_ij come from the maps of pairs of pieces. The best assignment minimises their
sum (the Hungarian method, by scipy). Where other assignments are as good, the places of
the pieces decide.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from jfsf.types import ArrayLike

# Sums of costs that differ by less are a tie. Exchanging two of three embedded bodies,
# each in two poses, costs 0.26.
TIE = 0.1
# More than any pair costs: two pieces that were not matched are no pair.
_NEVER = 1e3
# What places count beside signatures. Those of one body in two poses differ by 0.007 to
# 0.012, of two bodies by 0.011 to 0.020.
_PLACES = 0.002


class Assignment(NamedTuple):
    """Pairs of pieces, p of them, in the order of the pieces of X.

    of_x, of_y: numbers of the pieces.
    margin: by how much the sum of the costs grows if the pair is forbidden; inf if
        there is no other assignment of as many pieces. Below `TIE` another one is as
        good, and places have decided.
    """

    of_x: np.ndarray
    of_y: np.ndarray
    margin: Float[np.ndarray, " p"]


def candidates(
    unlike: Float[ArrayLike, "s t"],
    apart: Float[ArrayLike, "s t"],
    *,
    nearest: int = 3,
) -> Bool[np.ndarray, "s t"]:
    """Which pairs are worth a match.

    Each piece of the shape that has fewer with the `nearest` ones that it is most like,
    and the pairs of the assignment that is best by the signatures alone. All pairs, if
    there are no more than `nearest` squared.

    Args:
        unlike: of s pieces of X and t of Y (`jfsf.apps.collections.unlikeness`).
        apart: how far apart their places are, see `places_apart`.
        nearest: 1 or more.
    """
    score = np.asarray(unlike, float) + _PLACES * np.asarray(apart)
    if score.size <= nearest**2:
        return np.ones(score.shape, bool)
    axis = 1 if score.shape[0] <= score.shape[1] else 0
    order = np.argsort(score, axis=axis, kind="stable")
    chosen = np.zeros(score.shape, bool)
    np.put_along_axis(chosen, order.take(range(nearest), axis), True, axis)
    chosen[linear_sum_assignment(score)] = True
    return chosen


def places_apart(
    places_x: Float[ArrayLike, "s 3"], places_y: Float[ArrayLike, "t 3"]
) -> Float[np.ndarray, "s t"]:
    """How far apart the places of pieces are, in [0, 1].

    Each shape's are centred, and divided by their spread. They are not turned: the axes
    of both shapes have to agree for this to mean anything.
    """
    one, two = (_centred(np.asarray(places, float)) for places in (places_x, places_y))
    apart = cdist(one, two)
    return apart / (apart.max() or 1)


def assign(cost: Float[ArrayLike, "s t"], apart: Float[ArrayLike, "s t"]) -> Assignment:
    """The best assignment of pieces; places decide between those that are as good.

    Args:
        cost: of s pieces of X and t of Y; inf for a pair that was not matched.
        apart: in [0, 1], see `places_apart`. It counts `TIE` / 2 a pair at most.

    Returns:
        As many pairs as the smaller number of pieces, fewer if too few were matched.
    """
    cost = np.asarray(cost, float)
    known = np.isfinite(cost)
    cost = np.where(known, cost, _NEVER)
    of_x, of_y = linear_sum_assignment(cost + TIE / 2 * np.asarray(apart))
    total = cost[of_x, of_y].sum()
    real = known[of_x, of_y]
    of_x, of_y = of_x[real], of_y[real]
    margins = []
    for pair in zip(of_x, of_y, strict=True):
        without = cost.copy()
        without[pair] = _NEVER
        more = without[linear_sum_assignment(without)].sum() - total
        margins.append(more if more < _NEVER / 2 else np.inf)
    return Assignment(of_x, of_y, np.array(margins, float))


def _centred(places):
    places = places - places.mean(axis=0)
    spread = np.sqrt((places**2).sum(axis=1).mean())
    return places / (spread or 1)
