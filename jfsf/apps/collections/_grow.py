"""Match pairs of a collection until sure maps reach every shape."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.apps.collections._cycles import Triangle, triangles, trust
from jfsf.apps.collections._pairs import (
    Edge,
    first_pairs,
    more_pairs,
    unlikeness,
)
from jfsf.apps.collections._paths import Paths, best_paths
from jfsf.apps.collections._sketch import Sketch
from jfsf.types import ArrayLike, Maps, Match


@dataclass(frozen=True)
class PairSettings:
    """Which pairs are matched, and which of their maps are trusted. Set by hand.

    pairs_a_shape: pairs that are matched, at most, for each shape in the mean.
    most_of_one: a shape that has so many pairs gets no more: it may fit none.
    agree: the maps round a triangle agree if they are less than this apart, relative to
        two random vertices.
    sure: probability of the maps on the way from the template, below which more pairs
        of a shape are matched, as long as there may be more.
    trusted: that probability in the end, for a shape to belong to the collection.
    mirror_shear: how many times as much triangles are sheared by a map as by that of
        the mirror image, for a shape to be a mirror image; and as in the median of the
        maps on all ways, for its mirror image to be tried (`grow_with_mirrors`).
    """

    pairs_a_shape: float = 3.0
    most_of_one: int = 10
    agree: float = 0.2
    sure: float = 0.95
    trusted: float = 0.7
    mirror_shear: float = 2.0


class Matched(NamedTuple):
    """A pair that was matched.

    maps: of X, which has the smaller number, and Y.
    confidence: of the pair alone; nan where there is none.
    shear: of the triangles of the pair, bent onto each other (`Certificate`).
    """

    maps: Maps
    confidence: float
    shear: float = math.nan


def matched(match: Match) -> Matched:
    """Of a match, without what a collection does not need."""
    T_xy: Any = np.asarray(match.T_xy)
    T_yx: Any = np.asarray(match.T_yx)
    figures = match.certificate
    return Matched(Maps(T_xy, T_yx), float(figures.confidence), float(figures.shear))


class MirrorTest(NamedTuple):
    """A shape matched with another one, and its mirror image too.

    shape, partner: their numbers.
    straight: confidence of the map between the shape and its partner.
    turned: of that between its mirror image and the partner.
    ratio: how many times as much triangles are sheared by the first as by the second;
        nan if it is not known.
    """

    shape: int
    partner: int
    straight: float
    turned: float
    ratio: float

    def mirrors(self, settings: PairSettings) -> bool:
        """Whether the shape is the mirror image of its partner: see `mirror_images`."""
        return self.turned >= settings.trusted and self.ratio >= settings.mirror_shear


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

    def trusted_maps(
        self, shape: int, *, least: float
    ) -> list[tuple[int, Int[ArrayLike, " m"]]]:
        """Joined shapes that were matched with this one, and their maps to it.

        Args:
            shape: its number.
            least: the least probability of a pair's maps.
        """
        found = []
        for (a, b), likely in sorted(self.right.items()):
            other = a + b - shape
            if shape in (a, b) and likely >= least and self.joined[other]:
                maps = self.matched[a, b].maps
                found.append((other, maps.T_yx if a == shape else maps.T_xy))
        return found


def grow(
    sketches: Sequence[Sketch],
    match: Callable[[list[Edge]], Iterable[Matched | None]],
    *,
    template: int | None = None,
    settings: PairSettings = PairSettings(),
) -> Graph:
    """Match a sparse graph of pairs, and more pairs for shapes that are not sure.

    Args:
        sketches: of each shape.
        match: matches pairs of the numbers of two shapes, in their order; None for one
            that cannot be matched.
        template: the number of a shape; None for the most central one.
        settings: how many pairs at most, and what is trusted.

    Raises:
        ValueError: fewer than two shapes.
    """
    s = len(sketches)
    if s < 2:
        raise ValueError(f"collection: has {s} shapes; give two or more")
    unlike = unlikeness([one.signature for one in sketches])
    tried: set[Edge] = set()
    done: dict[Edge, Matched] = {}
    edges, most = first_pairs(unlike), round(settings.pairs_a_shape * s)
    while True:
        outcomes = zip(edges, match(edges), strict=True)
        done |= {edge: one for edge, one in outcomes if one is not None}
        tried |= set(edges)
        maps = {edge: one.maps for edge, one in done.items()}
        found = triangles(maps, sketches)
        confidence = {edge: one.confidence for edge, one in done.items()}
        right = trust(confidence, found, limit=settings.agree)
        paths = best_paths(right, s, template=template)
        left = most - len(tried)
        sure = np.flatnonzero(paths.trust >= settings.sure).tolist()
        own = settings.most_of_one
        edges = more_pairs(unlike, tried, sure, most=max(left, 0), most_of_one=own)
        if not edges:
            joined = paths.trust >= settings.trusted
            return Graph(done, found, right, paths, joined)
