"""Semilandmarks: points along curves of a surface, and spread over parts of it.

A curve runs from point to point by geodesics: shortest paths along edges, straightened
by edge flips (Sharp and Crane 2020, "You can find geodesic paths in triangle meshes by
just flipping edges"; potpourri3d). They are exact on the triangles, but for their ends,
which may lie up to 2 % of an edge away.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import potpourri3d as pp3d
from jaxtyping import Float, Int
from scipy.sparse.csgraph import dijkstra
from trimesh.remesh import subdivide
from trimesh.triangles import points_to_barycentric

from jfsf.apps.landmarks._outlines import Outline
from jfsf.apps.landmarks._place import _nearest, on_surface
from jfsf.apps.landmarks._record import Landmarks
from jfsf.mesh import closest, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import (
    components,
    edge_graph,
    face_areas,
    pair_half_edges,
)
from jfsf.types import ArrayLike, Mesh

# A path ends in a vertex, so one is put at each point, but no nearer to an edge than
# this share of a triangle's height, and none nearer to a corner than twice this.
_CLEAR = 0.01
# An end of a curve of Slicer is a landmark that is so near, in sqrt(area): by hand, the
# distance between two clicks on one place. Two points in one place cannot be slid.
_SAME = 0.01
# Vertices within a rim among which each point is chosen: then the grid they lie on
# moves a point by a tenth of the distance to the next. By hand.
_CHOICE = 100
_MOST_HALVINGS = 6  # of edges, to have so many
# Halvings of the step along a line between two faces that are not neighbours. Where it
# runs through a vertex they never are, and the faces there part the sides all the same.
_BETWEEN = 16


class Semilandmarks(NamedTuple):
    """Points of the template, which follow on its landmarks.

    names: of each point.
    points: on the surface.
    slide: for each point of a curve that slides, the point before it, its own, and the
        one after it; numbers of landmarks and semilandmarks together, from 1.
    surface: numbers of the points of patches, counted likewise.
    """

    names: tuple[str, ...]
    points: Float[np.ndarray, "p 3"]
    slide: Int[np.ndarray, "c 3"]
    surface: Int[np.ndarray, " q"]


def semilandmarks(
    mesh: Mesh, landmarks: Float[ArrayLike, "l 3"], outlines: Sequence[Outline]
) -> Semilandmarks:
    """Points on the curves and patches of a template.

    The points of a curve are spread over the paths between its landmarks so that the
    largest gap is least, and equally along each. Those of a closed curve are equally
    spaced from its first control point on. Those of a patch lie on the smaller of the
    two parts that its rim makes, each the farthest from the rim and those before it.

    Args:
        mesh: the template, of one piece.
        landmarks: on its surface.
        outlines: of `read_outlines`.

    Raises:
        ValueError: the mesh is no manifold, a curve is far from it, an end of a curve
            is its other end, or no surface is within a rim.
    """
    landmarks = np.asarray(landmarks, float).reshape(-1, 3)
    same = _SAME * float(np.sqrt(surface_area(mesh)))
    anchors = [_anchors(one, mesh, landmarks, same) for one in outlines]
    paths = _Paths(mesh, np.concatenate([landmarks, *(own for own, _ in anchors)]))
    first, next_number = len(landmarks), len(landmarks) + 1
    names, points, slide, surface = [], [], [], []
    for one, (own, known) in zip(outlines, anchors, strict=True):
        at = np.where(known < 0, first + np.arange(len(own)), known)
        first += len(own)
        closed = one.kind != "curve"
        legs = zip(at, np.append(at[1:], at[:1]) if closed else at[1:], strict=False)
        lines = [paths.between(a, b) for a, b in legs]
        if one.kind == "patch":
            new = _spread(mesh, np.concatenate(lines), one)
            surface += range(next_number, next_number + len(new))
        elif one.landmarks:
            new, order = _along(lines, at, one.number, next_number)
            slide += order
        else:
            ends = None if closed else known[[0, -1]]
            new, order = _along_controls(lines, ends, one.number, next_number)
            slide += order
        names += [f"{one.name}_{i}" for i in range(1, len(new) + 1)]
        points.append(new)
        next_number += len(new)
    together = np.concatenate([np.zeros((0, 3)), *points])
    return Semilandmarks(
        tuple(names),
        _nearest(mesh, together).points if len(together) else together,
        np.array(slide, int).reshape(-1, 3),
        np.array(surface, int),
    )


def _anchors(one: Outline, mesh: Mesh, landmarks, same: float):
    """Points that an outline passes beside landmarks; of all, the landmark or -1."""
    if one.controls is None:
        known = np.array(one.landmarks, int)
        return landmarks[known], known
    controls = np.asarray(one.controls, float)
    called = tuple(f"{one.name}, point {i}" for i in range(1, len(controls) + 1))
    own = np.array(on_surface(Landmarks(called, controls), mesh).points)
    known = np.full(len(own), -1)
    if one.kind == "curve" and len(landmarks):
        for end in (0, -1):
            away = np.linalg.norm(landmarks - own[end], axis=1)
            if away.min() < same:
                known[end] = away.argmin()
                own[end] = landmarks[known[end]]
        if known[0] == known[-1] >= 0:
            raise ValueError(
                f"{one.name}: both ends are at one landmark; save it as a closed curve"
            )
    return own, known


def _along(lines, at, number: int, first: int):
    """Points on the paths between landmarks, and their neighbours.

    Args:
        lines: the path from each landmark to the next.
        at: the landmarks, from 0.
        number: of points on all paths.
        first: the number of the first of them.
    """
    length = np.array([_length(line) for line in lines])
    counts = np.zeros(len(lines), int)
    for _ in range(number):
        counts[np.argmax(length / (counts + 1))] += 1
    points, slide = [], []
    for line, count, a, b in zip(lines, counts, at, at[1:], strict=False):
        points.append(_at_shares(line, np.arange(1, count + 1) / (count + 1)))
        slide += _neighbours([a + 1, *range(first, first + count), b + 1])
        first += count
    return np.concatenate(points), slide


def _along_controls(lines, ends, number: int, first: int):
    """Points on a curve of Slicer, and their neighbours.

    Args:
        lines: the path from each control point to the next.
        ends: the landmarks, from 0, that an open curve ends in, -1 where it has an end
            of its own; None for a closed curve.
        number: of points that slide.
        first: the number of the first point.
    """
    line = np.concatenate(lines)
    if ends is None:
        order = list(range(first, first + number))
        points = _at_shares(line, np.arange(number) / number)
        return points, _neighbours([order[-1], *order, order[0]])
    shares = np.arange(number + 2) / (number + 1)
    own = np.ones(len(shares), bool)
    own[[0, -1]] = ends < 0
    order = np.zeros(len(shares), int)
    order[own] = first + np.arange(own.sum())
    order[[0, -1]] = np.where(ends < 0, order[[0, -1]], ends + 1)
    return _at_shares(line, shares[own]), _neighbours(order.tolist())


def _neighbours(order: list[int]) -> list[list[int]]:
    """The point before each but the ends, itself, and the one after it."""
    return [list(three) for three in zip(order, order[1:], order[2:], strict=False)]


def _length(line) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _at_shares(line, shares) -> np.ndarray:
    """Points of a polygonal line at these shares of its length."""
    along = np.append(0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum())
    return np.stack(
        [np.interp(shares * along[-1], along, line[:, i]) for i in range(3)], 1
    )


class _Paths:
    """Geodesics between points of a mesh.

    Each point becomes a vertex of the mesh.
    """

    def __init__(self, mesh: Mesh, points: np.ndarray):
        """Points lie on the mesh."""
        vertices, faces, self._at = _with_vertices(mesh, points)
        used, corners = np.unique(faces, return_inverse=True)
        self._at = np.searchsorted(used, self._at)
        self._points = points
        try:
            self._solver = pp3d.EdgeFlipGeodesicSolver(
                vertices[used], corners.reshape(-1, 3)
            )
        except RuntimeError:
            raise ValueError(
                "semilandmarks need a template that is a manifold, wound one way: "
                "add --repair"
            ) from None

    def between(self, a: int, b: int) -> np.ndarray:
        """The points of the path from one point to another."""
        ends = self._points[[a, b]]
        if self._at[a] == self._at[b]:
            return ends
        line = self._solver.find_geodesic_path(int(self._at[a]), int(self._at[b]))
        return np.concatenate([ends[:1], np.asarray(line)[1:-1], ends[1:]])


def _with_vertices(mesh: Mesh, points: np.ndarray):
    """Vertices and faces with a vertex near each point, and the number of it."""
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
    kept = np.flatnonzero(face_areas(vertices, faces) > 0)
    surface = surface_tree(Mesh(vertices, faces[kept]))
    places, corners = list(vertices), list(faces)
    parts: dict[int, list[int]] = {}  # of a face that was split
    at = []
    found = kept[closest(surface, points).face] if len(points) else []
    for face, point in zip(found, points, strict=True):
        own = parts.setdefault(int(face), [int(face)])
        triangles = np.array([[places[v] for v in corners[part]] for part in own])
        weights = points_to_barycentric(triangles, np.repeat(point[None], len(own), 0))
        best = int(weights.min(1).argmax())
        weight, (a, b, c) = weights[best], corners[own[best]]
        if weight.max() > 1 - 2 * _CLEAR:
            at.append(int((a, b, c)[weight.argmax()]))
            continue
        weight = np.maximum(weight, _CLEAR)
        new = len(places)
        places.append(weight / weight.sum() @ triangles[best])
        corners[own[best]] = np.array([a, b, new])
        own += [len(corners), len(corners) + 1]
        corners += [np.array([b, c, new]), np.array([c, a, new])]
        at.append(new)
    return np.array(places), np.array(corners), np.array(at, int)


def _spread(mesh: Mesh, rim: np.ndarray, one: Outline) -> np.ndarray:
    """Points spread over the part of a mesh within a rim.

    Distances are those along edges that were halved until there is choice enough.

    Args:
        mesh: a surface.
        rim: points of a closed line on it.
        one: the patch.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    outside = None
    for _ in range(_MOST_HALVINGS + 1):
        crossed = _crossed(vertices, faces, rim)
        outside = _beyond(vertices, faces, crossed, outside)
        inner = np.setdiff1d(faces[~crossed & ~outside], faces[crossed])
        if len(inner) >= _CHOICE * one.number:
            break
        # The rest is far from the rim.
        near = ~outside | np.isin(faces, faces[crossed]).any(1)
        faces, outside = faces[near], outside[near]
        halves: Any = subdivide(vertices, faces, return_index=True)
        vertices, faces, of = halves
        halved = np.zeros(len(faces), bool)
        for old, new in of.items():
            halved[new] = outside[old]
        outside = halved
    else:
        raise ValueError(
            f"{one.name}: its rim surrounds no part of the surface with room for "
            f"{one.number} points; give its landmarks in their order along the rim"
        )
    faces = faces[~outside]
    far = np.full(len(vertices), -1.0)
    graph = edge_graph(Mesh(vertices, faces))
    graph = graph + graph.T
    reach = dijkstra(graph, indices=np.unique(faces[crossed[~outside]]), min_only=True)
    far[inner] = reach[inner]
    chosen = []
    for _ in range(one.number):
        chosen.append(int(far.argmax()))
        nearer = dijkstra(graph, indices=chosen[-1], limit=far.max())
        far = np.minimum(far, nearer)
    return vertices[chosen]


def _crossed(vertices, faces, rim) -> np.ndarray:
    """The faces that a line runs through, each next to the one before it."""
    kept = np.flatnonzero(face_areas(vertices, faces) > 0)
    corners = vertices[faces[kept]]
    step = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).mean()
    surface = surface_tree(Mesh(vertices, faces[kept]))
    of = lambda shares: kept[closest(surface, _at_shares(rim, shares)).face]
    shares = np.linspace(0, 1, int(2 * _length(rim) / step) + 2)
    face = of(shares)
    for _ in range(_BETWEEN):
        # Two corners in common are an edge, and a face has three with itself.
        one, two = faces[face[:-1], :, None], faces[face[1:], None]
        gap = np.flatnonzero((one == two).sum((1, 2)) < 2)
        if not len(gap):
            break
        middle = (shares[gap] + shares[gap + 1]) / 2
        shares = np.insert(shares, gap + 1, middle)
        face = np.insert(face, gap + 1, of(middle))
    crossed = np.zeros(len(faces), bool)
    crossed[face] = True
    return crossed


def _beyond(vertices, faces, crossed, outside) -> np.ndarray:
    """The faces beyond a wall of others.

    Args:
        vertices, faces: of the surface.
        crossed: the wall.
        outside: faces that are known to be so; None: those of the largest part.
    """
    pairs = pair_half_edges(faces, len(vertices))
    left, right = pairs.left // 3, pairs.right // 3
    free = ~(crossed[left] | crossed[right])
    part = components(len(faces), left[free], right[free])
    if outside is None:
        area = np.where(crossed, 0, face_areas(vertices, faces))
        return ~crossed & (part == np.bincount(part, area).argmax())
    return ~crossed & np.isin(part, part[outside & ~crossed])
