"""Which maps of a collection are right, by what the maps round triangles say.

A wrong map disagrees with the way round over a third shape. Two wrong ones may agree:
if both turn one shape round, or exchange the same parts. The probability of each map is
found by belief propagation on the graph whose factors are the triangles (Zach,
Klopschitz and Pollefeys 2010, "Disambiguating visual relations using loop
constraints").
"""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.apps.collections._pairs import Edge, Sketch
from jfsf.types import ArrayLike, Maps

# The probability that the maps round a triangle agree, by how many of them are wrong:
# `experiments/fit/fit_cycles.py`.
AGREE = np.array([0.98, 0.2, 0.53, 0.07])
# The maps round a triangle agree if they are less than this apart, relative to two
# random vertices. By hand: so 98 % of the triangles of three right maps agree
# (experiments/results/fit_cycles.json).
AGREE_BELOW = 0.2
SWEEPS, DAMPING = 50, 0.5
LEAST = 0.02  # no confidence counts for more than 1 - LEAST, nor for less than this


class Triangle(NamedTuple):
    """Three shapes of which all pairs were matched.

    corners: numbers of the shapes, ascending.
    apart: mean distance between the image of the first shape in the third, and that
        over the second, relative to two random vertices.
    """

    corners: tuple[int, int, int]
    apart: float

    @property
    def edges(self) -> tuple[Edge, Edge, Edge]:
        """Its sides."""
        a, b, c = self.corners
        return (a, b), (b, c), (a, c)


def triangles(maps: Mapping[Edge, Maps], sketches: Sequence[Sketch]) -> list[Triangle]:
    """All triangles of matched pairs, and how far the maps round them disagree.

    Args:
        maps: of each matched pair (x, y), x < y.
        sketches: of each shape.
    """
    found, edges = [], sorted(maps)
    after: dict[int, list[int]] = {}
    for a, b in edges:
        after.setdefault(a, []).append(b)
    for a, b in edges:
        for c in after.get(b, []):
            if (a, c) in maps:
                over = np.asarray(maps[b, c].T_xy)[np.asarray(maps[a, b].T_xy)]
                straight = np.asarray(maps[a, c].T_xy)
                apart = distance(over, straight, sketches[a], sketches[c])
                found.append(Triangle((a, b, c), apart))
    return found


def distance(
    T: Int[ArrayLike, " n_x"], other: Int[ArrayLike, " n_x"], x: Sketch, y: Sketch
) -> float:
    """Mean distance on Y between the images of X under two maps.

    Relative to that of two random vertices.
    """
    points = np.asarray(y.points)
    apart = np.linalg.norm(points[np.asarray(T)] - points[np.asarray(other)], axis=1)
    return float(np.asarray(x.mass) @ apart)


def trust(
    confidence: Mapping[Edge, float],
    found: Sequence[Triangle],
    *,
    limit: float = AGREE_BELOW,
    agree: Float[ArrayLike, " 4"] = AGREE,
) -> dict[Edge, float]:
    """The probability that each map is right, given all triangles.

    Args:
        confidence: confidence of each map alone; nan, where there is none, counts as
            0.5.
        found: the triangles (`triangles`).
        limit: distance below which the maps round a triangle agree.
        agree: probabilities that they agree if 0, 1, 2 or 3 of them are wrong.

    Returns:
        Sum-product belief propagation, damped; exact where no two triangles share more
        than one chain of sides.
    """
    edges = sorted(confidence)
    number = {edge: i for i, edge in enumerate(edges)}
    prior = np.array([confidence[edge] for edge in edges], float)
    prior = np.clip(np.nan_to_num(prior, nan=0.5), LEAST, 1 - LEAST)
    own = np.log(prior / (1 - prior))
    if not found:
        return dict(zip(edges, prior.tolist(), strict=True))
    sides = np.array([[number[edge] for edge in one.edges] for one in found])
    agrees = np.array([one.apart < limit for one in found])
    # (2, 2, 2): the chance to agree where each side is wrong (0) or right (1).
    states = np.array(list(product((0, 1), repeat=3)))
    chance = np.asarray(agree)[3 - states.sum(1)].reshape(2, 2, 2)
    factor = np.where(agrees[:, None, None, None], chance, 1 - chance)
    to_edge = np.zeros(sides.shape)  # log odds that a triangle gives each of its sides
    for _ in range(SWEEPS):
        total = own + np.bincount(sides.ravel(), to_edge.ravel(), len(edges))
        right = 1 / (1 + np.exp(-np.clip(total[sides] - to_edge, -30, 30)))
        belief = np.stack([1 - right, right], -1)  # (t, 3, 2)
        new = np.stack(
            [
                _log_odds(
                    np.einsum("tabc,tb,tc->ta", factor, belief[:, 1], belief[:, 2])
                ),
                _log_odds(
                    np.einsum("tabc,ta,tc->tb", factor, belief[:, 0], belief[:, 2])
                ),
                _log_odds(
                    np.einsum("tabc,ta,tb->tc", factor, belief[:, 0], belief[:, 1])
                ),
            ],
            1,
        )
        to_edge = DAMPING * to_edge + (1 - DAMPING) * new
    total = own + np.bincount(sides.ravel(), to_edge.ravel(), len(edges))
    right = 1 / (1 + np.exp(-np.clip(total, -30, 30)))
    return dict(zip(edges, right.tolist(), strict=True))


def _log_odds(wrong_right: np.ndarray) -> np.ndarray:
    return np.log(wrong_right[:, 1]) - np.log(wrong_right[:, 0])
