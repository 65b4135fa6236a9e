"""The template of a collection, and the maps between it and every shape."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from jfsf.apps.collections._pairs import Edge
from jfsf.types import Maps


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
    edges = np.array(sorted(right), int).reshape(-1, 2)
    cost = -np.log([max(right[a, b], 1e-12) for a, b in edges.tolist()])
    # A zero would be no edge to scipy.
    lengths = coo_matrix((cost + 1e-9, edges.T), (num_shapes, num_shapes)).tocsr()
    length, before = dijkstra(lengths, directed=False, return_predecessors=True)
    if template is None:
        reached = np.isfinite(length)
        alone = np.where(reached, length, 0).sum(1)
        # First the most shapes, then the least cost.
        template = int(np.lexsort((alone, -reached.sum(1)))[0])
    before = np.where(before[template] < 0, -1, before[template])
    return Paths(template, before, np.exp(-length[template]))


def map_along(maps: Mapping[Edge, Maps], way: list[int]) -> Int[np.ndarray, " n"]:
    """The vertex of the last shape of a way for each vertex of its first."""
    T = None
    for a, b in zip(way, way[1:], strict=False):
        step = maps[a, b].T_xy if a < b else maps[b, a].T_yx
        T = np.asarray(step) if T is None else np.asarray(step)[T]
    if T is None:
        raise ValueError("map_along: the way has one shape; give two or more")
    return T
