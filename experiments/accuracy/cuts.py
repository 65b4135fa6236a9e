"""Parts of embedded shapes, cut by a plane or a geodesic ball; regions and overlaps.

A cut keeps the largest piece on one side, and as much of the area as is asked for.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.data import Sample
from jfsf.geometry import geodesics
from jfsf.matching.parts import cut
from jfsf.mesh import surface_area
from jfsf.mesh._edit import Submesh
from jfsf.mesh._geometry import vertex_areas
from jfsf.types import Mesh


class Truth(NamedTuple):
    """at_x, at_y: vertices of the part and their partners; inside_y: (n_y,) bool."""

    at_x: np.ndarray
    at_y: np.ndarray
    inside_y: np.ndarray


def plane(sample: Sample, keep: float, rng: np.random.Generator) -> Submesh:
    """One side of a plane of random direction."""
    return _below(sample, sample.mesh.vertices @ rng.normal(size=3), keep)


def ball(sample: Sample, keep: float, rng: np.random.Generator) -> Submesh:
    """A geodesic ball around a random vertex."""
    centre = rng.choice(len(sample.mesh.vertices), 1)
    return _below(sample, geodesics(sample.mesh, centre)[0], keep)


def rest_of_ball(sample: Sample, point: int, keep: float) -> Submesh:
    """What lies far from a template point, so much of the area."""
    centre = sample.template_to_vertex[[point]]
    return _below(sample, -geodesics(sample.mesh, centre)[0], keep)


def ball_around(sample: Sample, point: int, keep: float) -> Submesh:
    """A geodesic ball around a template point."""
    centre = sample.template_to_vertex[[point]]
    return _below(sample, geodesics(sample.mesh, centre)[0], keep)


def _below(sample: Sample, height: np.ndarray, keep: float) -> Submesh:
    """The largest piece of lowest vertices with a share of the area, by bisection."""
    order, wanted = np.argsort(height), keep * surface_area(sample.mesh)
    low, high = 0, len(order)
    while high - low > 1:
        middle = (low + high) // 2
        part = cut(sample.mesh, _first(order, middle))
        smaller = len(part.mesh.faces) == 0 or surface_area(part.mesh) < wanted
        low, high = (middle, high) if smaller else (low, middle)
    return cut(sample.mesh, _first(order, high))


def _first(order, count):
    kept = np.zeros(len(order), bool)
    kept[order[:count]] = True
    return kept


def truth(x: Sample, part: Submesh, y: Sample) -> Truth:
    """Of a part of X, and all of Y."""
    place = np.full(len(x.mesh.vertices), -1)
    place[part.index] = np.arange(len(part.index))
    at_x = place[x.template_to_vertex]
    there = at_x >= 0
    # Three vertices in ten have no template point: that of the nearest with one.
    points = KDTree(y.mesh.vertices[y.template_to_vertex])
    nearest = points.query(y.mesh.vertices)[1]
    return Truth(at_x[there], y.template_to_vertex[there], there[nearest])


def truth_of_parts(x: Sample, part_x: Submesh, y: Sample, part_y: Submesh) -> Truth:
    """Of a part of X, and a part of Y; the partners and the region are of that."""
    found = truth(x, part_x, y)
    place = np.full(len(y.mesh.vertices), -1)
    place[part_y.index] = np.arange(len(part_y.index))
    at_y = place[found.at_y]
    there = at_y >= 0
    inside = found.inside_y[part_y.index]
    return Truth(found.at_x[there], at_y[there], inside)


def near_truth(mesh: Mesh, at: np.ndarray, reach: float) -> np.ndarray:
    """(n,) the vertices that lie within `reach` of one of the ground truth."""
    return KDTree(mesh.vertices[at]).query(mesh.vertices)[0] <= reach


def median_edge(mesh: Mesh) -> float:
    """Of the first edges of the faces."""
    ends = mesh.vertices[mesh.faces[:, :2]]
    return float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)))


def overlap(mesh: Mesh, found: np.ndarray, true: np.ndarray) -> float:
    """Intersection over union of two sets of vertices, by area."""
    mass = vertex_areas(*mesh)
    return float(mass[found & true].sum() / mass[found | true].sum())
