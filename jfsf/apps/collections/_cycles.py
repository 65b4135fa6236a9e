"""Which pairs of a collection are matched, and which of their maps are right.

Pairs make a sparse graph, chosen from the spectra alone: a tree reaches all shapes, and
further pairs close triangles, because a wrong map disagrees with the way round over a
third shape. Two wrong ones may agree: if both turn one shape round, or exchange the
same parts. The probability of each map is found by belief propagation on the graph
whose factors are the triangles (Zach, Klopschitz and Pollefeys 2010, "Disambiguating
visual relations using loop constraints").
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from jfsf.spectral._sampling import biharmonic, rms_distance
from jfsf.types import ArrayLike, Maps, Spectrum

SIGNATURE = 30  # eigenvalues: how a shape differs from others as a whole
_GROWTH = 4 * np.pi * SIGNATURE


class Sketch(NamedTuple):
    """What tells a shape from others, and how far apart its vertices are.

    signature: square roots of eigenvalues, in units of their mean growth (Weyl's law).
        The shape has area 1, so size plays no part; nor does the pose (Reuter et al.
        2006, "Laplace-Beltrami spectra as Shape-DNA").
    points: their Euclidean distance is the biharmonic one; that of two random vertices
        has root mean square 1.
    mass: of the vertices, sums to 1.
    """

    signature: Float[ArrayLike, " f"]
    points: Float[ArrayLike, "n d"]
    mass: Float[ArrayLike, " n"]


def sketch(spec: Spectrum) -> Sketch:
    """Of a spectrum without padding, from `jfsf.basis`. In float32."""
    points = biharmonic(spec)
    unit = float(rms_distance(points, spec.mass))
    evals = np.maximum(np.asarray(spec.evals)[1 : SIGNATURE + 1], 0)
    numbers = (
        np.sqrt(evals / _GROWTH),
        np.asarray(points) / unit,
        np.asarray(spec.mass),
    )
    return Sketch(*(np.asarray(values, np.float32) for values in numbers))


def evals_of(
    signature: Float[ArrayLike, " f"],
) -> Float[np.ndarray, " f"]:
    """The eigenvalues of a signature, from the first that is not 0 on, at area 1."""
    return _GROWTH * np.asarray(signature, float) ** 2


Edge = tuple[int, int]  # numbers of two shapes, the smaller one first


def unlikeness(
    signatures: Sequence[Float[ArrayLike, " f"]],
) -> Float[np.ndarray, "s s"]:
    """Unlikeness of each two shapes: root mean square difference of signatures."""
    rows = np.stack([np.asarray(row) for row in signatures])
    return cdist(rows, rows) / np.sqrt(rows.shape[1])


def first_pairs(unlike: Float[ArrayLike, "s s"]) -> list[Edge]:
    """A tree of the most alike pairs, and a triangle on each of its branches.

    Args:
        unlike: symmetric, see `unlikeness`.

    Returns:
        Sorted; s - 1 pairs of the tree, and at most as many again.
    """
    unlike = np.asarray(unlike, float)
    # A zero would be no edge to scipy.
    tree = minimum_spanning_tree(unlike + 1e-12).tocoo()
    branches = [edge_of(a, b) for a, b in zip(tree.row, tree.col, strict=True)]
    found: set[Edge] = set()
    near: dict[int, set[int]] = {i: set() for i in range(len(unlike))}

    def add(edge: Edge):
        a, b = edge
        found.add(edge)
        near[a].add(b)
        near[b].add(a)

    for branch in branches:
        add(branch)
    for a, b in sorted(branches):
        # Pairs that make a triangle of the branch and a pair next to it.
        closing = {edge_of(c, b) for c in near[a] - {b}}
        closing |= {edge_of(c, a) for c in near[b] - {a}}
        if closing and not found & closing:
            add(min(closing, key=lambda edge: (unlike[edge], edge)))
    return sorted(found)


def more_pairs(
    unlike: Float[ArrayLike, "s s"],
    tried: Collection[Edge],
    sure: Collection[int],
    *,
    before: Int[ArrayLike, " s"] | None = None,
    most: int,
    most_of_one: int,
    each: int = 2,
) -> list[Edge]:
    """Pairs for the shapes that no sure map has reached yet.

    Of a way only the first such shape that may get more: what it gains all gain that
    come after it.

    Args:
        unlike: symmetric, see `unlikeness`.
        tried: pairs that were matched.
        sure: shapes that sure maps reach.
        before: as `Paths.before`; None if no shape has a way.
        most: pairs in all.
        most_of_one: a shape of so many tried pairs gets no more: it may fit none.
        each: pairs for each of the other shapes: with those of the sure ones that close
            the most triangles with pairs that were tried, and of these the most alike.

    Returns:
        Sorted; empty when no shape is left that may get more.
    """
    unlike, may = np.asarray(unlike, float), {}
    near: dict[int, set[int]] = {i: {i} for i in range(len(unlike))}
    for a, b in tried:
        near[a].add(b)
        near[b].add(a)
    for a in sorted(set(range(len(unlike))) - set(sure)):
        left = [b for b in sure if b not in near[a]]
        left.sort(key=lambda b: (-len(near[a] & near[b]), unlike[a, b], b))
        number = min(each, most_of_one + 1 - len(near[a]))  # it is near to itself
        if left and number > 0:
            may[a] = left[:number]
    first = [a for a in may if before is None or int(before[a]) not in may]
    found = {edge_of(a, b): unlike[a, b] for a in first for b in may[a]}
    return sorted(sorted(found, key=lambda edge: (found[edge], edge))[:most])


def edge_of(a, b) -> Edge:
    """The edge between two shapes."""
    return (int(min(a, b)), int(max(a, b)))


# The probability that the maps round a triangle agree, by how many of them are wrong:
# `experiments/fit/fit_cycles.py`.
AGREE = np.array([0.98, 0.2, 0.53, 0.07])
# The maps round a triangle agree if they are less than this apart, relative to two
# random vertices. By hand: so 98 % of the triangles of three right maps agree
# (experiments/results/fit_cycles.json).
AGREE_BELOW = 0.2
SWEEPS, DAMPING = 50, 0.5
# No confidence counts for more than 1 - LEAST, nor for less than this. Of 320 maps with
# 0.9 or more none is wrong, so with a probability of 0.95 fewer than one in a hundred
# are (`wrong_at_most` in jfsf/matching/confidence.json). At 0.02 no way of a dozen
# right maps was sure, and of 1000 shapes 700 got more pairs.
LEAST = 0.01


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
