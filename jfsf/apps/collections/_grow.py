"""Match pairs of a collection until sure maps reach every shape.

The template is the shape to which the most probable ways lead.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from jfsf.apps.collections._cycles import (
    Edge,
    Sketch,
    Triangle,
    first_pairs,
    more_pairs,
    triangles,
    trust,
    unlikeness,
)
from jfsf.matching._confidence import MIRRORED, mirror_probability
from jfsf.types import ArrayLike, Maps, Match


class Paths(NamedTuple):
    """The most probable way from the template to each shape.

    template: the number of the shape.
    before: (s,) the shape before each on its way; -1 for the template, and for shapes
        that no way reaches.
    trust: (s,) product of the probabilities on the way; 1 for the template, 0 for
        shapes that no way reaches.
    """

    template: int
    before: Int[np.ndarray, " s"]
    trust: np.ndarray

    def way(self, shape: int) -> list[int]:
        """Shapes from the template to this one, both included."""
        found = [shape]
        while (previous := int(self.before[found[-1]])) >= 0:
            found.append(previous)
        return found[::-1]


def best_paths(
    right: Mapping[Edge, float], num_shapes: int, *, template: int | None = None
) -> Paths:
    """Ways of the greatest product of probabilities, from the template.

    Args:
        right: the probability of each map, in (0, 1) (`trust`).
        num_shapes: shapes, numbered from 0.
        template: None for the shape whose product over all ways is the greatest: the
            most central one.
    """
    length, before = _shortest(right, num_shapes)
    if template is None:
        template = _by_centrality(length)[0]
    before = np.where(before[template] < 0, -1, before[template])
    return Paths(template, before, np.exp(-length[template]))


def _shortest(right: Mapping[Edge, float], num_shapes: int):
    """Of all shapes to all: the least cost of a way, and the last shape before."""
    edges = np.array(sorted(right), int).reshape(-1, 2)
    cost = -np.log([max(right[a, b], 1e-12) for a, b in edges.tolist()])
    # A zero would be no edge to scipy.
    lengths = coo_matrix((cost + 1e-9, edges.T), (num_shapes, num_shapes)).tocsr()
    return dijkstra(lengths, directed=False, return_predecessors=True)


def _by_centrality(length: np.ndarray) -> list[int]:
    """Shapes in order: first those that reach the most, then of the least cost."""
    reached = np.isfinite(length)
    alone = np.where(reached, length, 0).sum(1)
    return np.lexsort((alone, -reached.sum(1))).tolist()


def map_along(maps: Mapping[Edge, Maps], way: list[int]) -> Int[np.ndarray, " n"]:
    """The vertex of the last shape of a way for each vertex of its first."""
    T = None
    for a, b in zip(way, way[1:], strict=False):
        step = maps[a, b].T_xy if a < b else maps[b, a].T_yx
        T = np.asarray(step) if T is None else np.asarray(step)[T]
    if T is None:
        raise ValueError("map_along: the way has one shape; give two or more")
    return T


# By hand: 80 bodies of FAUST take 1.8 (experiments/results/collection_faust_r.json).
PAIRS_A_SHAPE = 3.0
# A shape that has so many pairs gets no more: it may fit none. By hand.
MOST_OF_ONE = 10
# A shape gets more pairs as long as the maps on its way are less probable than this. At
# 0.7 a wrong map cut the birds of SHREC'07 in two: its one triangle disagreed, and a
# right map of the triangle was blamed (experiments/accuracy/collection.py).
SURE = 0.95
# Shapes with a less probable way do not belong to the collection. By hand: none of the
# pairs of FAUST is wrong then (experiments/results/collection_faust_r.json).
TRUSTED = 0.7


class Matched(NamedTuple):
    """A pair that was matched.

    maps: of X, which has the smaller number, and Y.
    confidence: of the pair alone; nan where there is none.
    energy: of its functional map (`Certificate`); nan where it is not known.
    mirrored: how likely its mirror image is right instead (`Certificate`); nan where
        that was not tried.
    """

    maps: Maps
    confidence: float
    energy: float = math.nan
    mirrored: float = math.nan


def matched(match: Match) -> Matched:
    """Of a match, without what a collection does not need."""
    T_xy: Any = np.asarray(match.T_xy)
    T_yx: Any = np.asarray(match.T_yx)
    known = match.certificate
    figures = known.confidence, known.energy, known.mirrored
    return Matched(Maps(T_xy, T_yx), *map(float, figures))


class MirrorTest(NamedTuple):
    """A shape matched with another one, and its mirror image too.

    shape, partner: their numbers.
    straight: confidence of the map between the shape and its partner.
    turned: of that between its mirror image and the partner.
    energy_gap: how much more energy the first has than the second; nan if it is not
        known.
    """

    shape: int
    partner: int
    straight: float
    turned: float
    energy_gap: float

    @property
    def mirrors(self) -> bool:
        """Whether the shape is the mirror image of its partner: see `mirror_images`."""
        return self.turned >= TRUSTED and mirror_probability(self.energy_gap) > MIRRORED


class Graph(NamedTuple):
    """The matched pairs of a collection.

    matched: each pair (x, y), x < y.
    found: the triangles of these.
    right: the probability of each pair's maps, given the triangles.
    paths: the template, and the way to each shape.
    joined: (s,) whether the way is trusted.
    tests: of shapes that may be mirror images (`grow_with_mirrors`).
    mirrored: numbers of those that are.
    """

    matched: dict[Edge, Matched]
    found: list[Triangle]
    right: dict[Edge, float]
    paths: Paths
    joined: np.ndarray
    tests: tuple[MirrorTest, ...] = ()
    mirrored: frozenset[int] = frozenset()

    @property
    def maps(self) -> dict[Edge, Maps]:
        """Of each pair."""
        return {edge: one.maps for edge, one in self.matched.items()}

    @property
    def mirrored_back(self) -> frozenset[int]:
        """Numbers of the mirror images that joined: their meshes are mirrored, in x."""
        return frozenset(i for i in self.mirrored if self.joined[i])

    @property
    def central(self) -> list[int]:
        """Numbers of the joined shapes, the most central first."""
        order = _by_centrality(_shortest(self.right, len(self.joined))[0])
        return [i for i in order if self.joined[i]]

    def with_template(self, shape: int) -> "Graph":
        """With another template; a shape that it does not reach is not joined."""
        paths = best_paths(self.right, len(self.joined), template=shape)
        joined = self.joined & (paths.trust >= TRUSTED)
        return self._replace(paths=paths, joined=joined)

    def trusted_maps(self, shape: int) -> list[tuple[int, Int[ArrayLike, " m"]]]:
        """Joined shapes whose maps to this one are trusted, and these maps."""
        found = []
        for a, b in sorted(edge for edge in self.right if shape in edge):
            other = a + b - shape
            if self.right[a, b] >= TRUSTED and self.joined[other]:
                maps = self.matched[a, b].maps
                found.append((other, maps.T_yx if a == shape else maps.T_xy))
        return found


def grow(
    sketches: Sequence[Sketch],
    match: Callable[[list[Edge]], Iterable[Matched | None]],
    *,
    template: int | None = None,
    pairs_a_shape: float = PAIRS_A_SHAPE,
    frozen: Sequence[Matched] | None = None,
) -> Graph:
    """Match a sparse graph of pairs, and more pairs for shapes that are in doubt.

    Args:
        sketches: what is kept of each shape.
        match: a function that matches pairs of shape numbers and returns the matches in
            the order of the pairs; None for a pair that cannot be matched.
        template: the number, from 0, of the template; the most central shape if None.
        pairs_a_shape: most pairs that are matched, for each shape on average.
        frozen: of a finished collection, the maps from its template, which is shape 0,
            to shapes 1, 2 and so on, and how far they are trusted. Only the shapes
            after these are matched, first with the template and the two most alike of
            the finished ones.

    Raises:
        ValueError: fewer than two shapes.
    """
    s = len(sketches)
    if s < 2:
        raise ValueError(f"collection: has {s} shapes; give two or more")
    unlike = unlikeness([one.signature for one in sketches])
    old = range(0 if frozen is None else len(frozen) + 1)
    done = {(0, i): one for i, one in enumerate(frozen or (), 1)}
    tried = set(done)
    if frozen is None:
        edges, most = first_pairs(unlike), round(pairs_a_shape * s)
    else:
        template, most = 0, len(tried) + MOST_OF_ONE * (s - len(old))
        limits = {"most": most, "most_of_one": MOST_OF_ONE}
        alike = more_pairs(unlike, tried, old, **limits)
        edges = sorted({*alike, *((0, i) for i in range(len(old), s))})
    while True:
        outcomes = zip(edges, match(edges), strict=True)
        done |= {edge: one for edge, one in outcomes if one is not None}
        tried |= set(edges)
        maps = {edge: one.maps for edge, one in done.items()}
        found = triangles(maps, sketches)
        confidence = {edge: one.confidence for edge, one in done.items()}
        right = trust(confidence, found)
        paths = best_paths(right, s, template=template)
        left = most - len(tried)
        sure = sorted({*old, *np.flatnonzero(paths.trust >= SURE).tolist()})
        limits = {"most": max(left, 0), "most_of_one": MOST_OF_ONE}
        edges = more_pairs(unlike, tried, sure, before=paths.before, **limits)
        if not edges:
            joined = paths.trust >= TRUSTED
            return Graph(done, found, right, paths, joined)
