"""Points of one of two meshes that lie on each other -> points of the other.

A point goes to the nearest one of the other surface that faces alike. On thin parts,
such as fingers and ears, the nearest of all may be on the other side: the faces of a
coarse mesh cut through them.

Most points lie so near to the other surface that a face below them is the one: it is
found by walking over edges from the face with the nearest centre. All pieces of faces
around are compared for the others only (`jfsf.mesh.closest`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.apps.transfer._overlay import Overlay
from jfsf.mesh import closest, orient
from jfsf.mesh._closest import (
    FacingTree,
    SurfaceTree,
    facing,
    facing_tree,
    surface_tree,
)
from jfsf.mesh._geometry import face_areas, pair_half_edges, vertex_normals
from jfsf.types import ArrayLike, Mesh

CANDIDATES = 24  # pieces of faces that are tried where the nearest faces away
NORMAL_WEIGHT = 0.2  # of a unit normal beside the position, in sqrt(area), for these
MIN_ALIKE = 0.0  # cosine between normals
ROWS = 100_000  # points at a time
STEPS = 4  # over edges
# A face is the one below a point if it is within this part of the size of faces.
NEAR = 0.2


class Points(NamedTuple):
    """Points of a mesh.

    face: (q,) the face of each; -1 of a point cloud.
    corners: (q, 3) the vertices of that face; three times the same of a point cloud.
    weights: (q, 3) barycentric coordinates.
    """

    face: ArrayLike
    corners: ArrayLike
    weights: ArrayLike


class PlacedMesh(NamedTuple):
    """A mesh as it lies on the other.

    vertices: (n, 3) in common coordinates; nan for one without a place.
    normals: (n, 3) unit normals, so that both meshes look the same way; None where no
        side is known to be the outer one.
    faces: (m, 3) of the mesh.
    """

    vertices: ArrayLike
    normals: ArrayLike | None
    faces: ArrayLike


class Finder(NamedTuple):
    """A mesh whose nearest points can be asked for.

    mesh: as it lies on the other.
    kept: (p,) its faces with an area; the vertices with a place, of a point cloud.
    surface: of these; None of a point cloud.
    cloud: of its vertices, of a point cloud; else None.
    facing: of the surface; None without normals.
    planes: of the surface; None of a point cloud.
    """

    mesh: PlacedMesh
    kept: ArrayLike
    surface: SurfaceTree | None
    cloud: KDTree | None
    facing: FacingTree | None = None
    planes: "Planes | None" = None


class Planes(NamedTuple):
    """Faces as coordinates.

    origin: (p, 3) corner 0 of each.
    axes: (p, 3, 3) whose products with what is seen from there are the barycentric
        coordinates of corners 1 and 2, and the height.
    beyond: (p, 3) the face across the edge opposite to each corner; -1 if there is no
        one face.
    """

    origin: ArrayLike
    axes: ArrayLike
    beyond: ArrayLike


def placed(overlay: Overlay) -> tuple[PlacedMesh, PlacedMesh]:
    """X and Y as they lie on each other."""
    both = []
    for mesh, at, sign in (
        (overlay.mesh_x, overlay.at_x, overlay.orientation_sign),
        (overlay.mesh_y, overlay.at_y, abs(overlay.orientation_sign)),
    ):
        faces, normals = np.asarray(mesh.faces), None
        if sign and len(faces):
            there = np.isfinite(at[faces]).all((1, 2))
            wound = orient(Mesh(mesh.vertices, faces[there])).faces
            normals = sign * vertex_normals(at, wound)
        both.append(PlacedMesh(at, normals, faces))
    return both[0], both[1]


def finder(mesh: PlacedMesh) -> Finder:
    """Prepare a mesh for `nearest`."""
    vertices, normals, faces = mesh
    areas = face_areas(vertices, faces)
    kept = np.flatnonzero(areas > 0)  # nan is not
    there = np.isfinite(vertices).all(1)
    if len(kept) == 0:
        kept = np.flatnonzero(there)
        return Finder(mesh, kept, None, KDTree(vertices[kept]))
    surface = surface_tree(Mesh(np.where(there[:, None], vertices, 0), faces[kept]))
    planes = _planes(surface)
    if normals is None:
        return Finder(mesh, kept, surface, None, planes=planes)
    weight = NORMAL_WEIGHT * float(np.sqrt(areas[kept].sum()))
    return Finder(
        mesh, kept, surface, None, facing_tree(surface, normals, weight), planes
    )


def weighted(rows: ArrayLike, points: Points) -> ArrayLike:
    """Values (q, ...) at points: the weighted sum of the rows (n, ...) of the corners.

    A corner of weight 0 does not matter, even if its row is nan.
    """
    corners = np.asarray(rows)[points.corners]
    weights = np.asarray(points.weights).reshape(-1, 3, *[1] * (corners.ndim - 2))
    return (weights * np.where(weights > 0, corners, 0)).sum(1)


def place(mesh: PlacedMesh, points: Points) -> tuple[ArrayLike, ArrayLike | None]:
    """Positions (q, 3) of points of a mesh, and their unit normals.

    nan where a corner that counts has no place.
    """
    normals = mesh.normals
    unit = None if normals is None else _unit(weighted(normals, points))
    return weighted(mesh.vertices, points), unit


def from_x_to_y(overlay: Overlay) -> Callable[[Points], Points]:
    """The nearest points of Y for points of X: a function, prepared once."""
    x, y = placed(overlay)
    of_y = finder(y)
    return lambda points: nearest(of_y, *place(x, points))


def nearest(finder: Finder, positions: ArrayLike, normals: ArrayLike | None) -> Points:
    """The nearest points of a mesh that face alike.

    Args:
        finder: of the mesh.
        positions: (q, 3) in common coordinates.
        normals: (q, 3) unit normals, or None.

    Returns:
        Where none near faces alike, the nearest of all. Any for a position of nan.
    """
    positions = np.nan_to_num(positions)
    if finder.surface is None:
        assert finder.cloud is not None
        near = np.asarray(finder.cloud.query(positions)[1])
        return vertices_as_points(finder.kept[near])
    face = np.zeros(len(positions), int)
    weights = np.zeros((len(positions), 3))
    for start in range(0, len(positions), ROWS):
        rows = slice(start, start + ROWS)
        own = None if normals is None else normals[rows]
        face[rows], weights[rows] = _on_surface(finder, positions[rows], own)
    face = finder.kept[face]
    return Points(face, finder.mesh.faces[face], weights)


def _on_surface(finder: Finder, positions, normals):
    face, weights = _below(finder, positions, normals)
    rest = np.flatnonzero(face < 0)
    if len(rest):
        own = None if normals is None else normals[rest]
        face[rest], weights[rest] = _nearest_of_all(finder, positions[rest], own)
    return face, weights


def _below(finder: Finder, positions, normals):
    """The face each point lies above or below, near; -1 where the walk finds none."""
    surface, planes = finder.surface, finder.planes
    assert surface is not None and planes is not None
    face = surface.owner[surface.tree.query(positions)[1]]
    weights, found = np.zeros((len(face), 3)), np.zeros(len(face), bool)
    left = np.arange(len(face))
    for _ in range(STEPS):
        at = face[left]
        to = positions[left] - planes.origin[at]
        s, t, height = np.einsum("qij,qj->iq", planes.axes[at], to)
        bary = np.stack([1 - s - t, s, t], 1)
        least = bary.argmin(1)
        inside = np.take_along_axis(bary, least[:, None], 1)[:, 0] >= 0
        near = inside & (np.abs(height) <= NEAR * surface.radius)
        if normals is not None and finder.facing is not None:
            near &= (finder.facing.normal[at] * normals[left]).sum(1) > MIN_ALIKE
        weights[left[near]], found[left[near]] = bary[near], True
        beyond = planes.beyond[at, least]
        on = ~inside & (beyond >= 0)
        face[left[on]] = beyond[on]
        left = left[on]
    return np.where(found, face, -1), weights


def _nearest_of_all(finder: Finder, positions, normals):
    surface = finder.surface
    assert surface is not None
    found = closest(surface, positions)
    face, weights = found.face, found.barycentric
    if normals is None or finder.facing is None:
        return face, weights
    alike = (finder.facing.normal[face] * normals).sum(1) > MIN_ALIKE
    away = np.flatnonzero(~alike)
    how = {"candidates": CANDIDATES, "min_alike": MIN_ALIKE}
    if len(away):
        better = facing(finder.facing, positions[away], normals[away], **how)
        there = better.face >= 0
        face[away[there]] = better.face[there]
        weights[away[there]] = better.barycentric[there]
    return face, weights


def _planes(surface: SurfaceTree) -> Planes:
    vertices, faces = surface.mesh
    origin = vertices[faces[:, 0]]
    one, two = vertices[faces[:, 1]] - origin, vertices[faces[:, 2]] - origin
    cross = np.cross(one, two)
    square = (cross**2).sum(1, keepdims=True)
    axes = [np.cross(two, cross) / square, np.cross(cross, one) / square]
    axes = np.stack([*axes, surface.normal], 1)
    # Half-edge 3 f + i runs from corner i to the next, opposite to the one after it.
    pairs = pair_half_edges(faces, len(vertices))
    left, right = pairs.left[pairs.manifold], pairs.right[pairs.manifold]
    beyond = np.full(faces.size, -1)
    beyond[left], beyond[right] = right // 3, left // 3
    return Planes(origin, axes, np.roll(beyond.reshape(-1, 3), -1, 1))


def vertices_as_points(vertices: ArrayLike) -> Points:
    """Vertices (q,) of a mesh as points."""
    weights = np.zeros((len(vertices), 3))
    weights[:, 0] = 1
    corners = np.repeat(np.asarray(vertices)[:, None], 3, axis=1)
    return Points(np.full(len(weights), -1), corners, weights)


def in_faces(faces: ArrayLike, weights: ArrayLike) -> Points:
    """Points with the same barycentric coordinates (s, 3) in each face: (m s) rows."""
    face = np.repeat(np.arange(len(faces)), len(weights))
    return Points(face, faces[face], np.tile(weights, (len(faces), 1)))


def _unit(rows):
    size = np.linalg.norm(rows, axis=-1, keepdims=True)
    return rows / np.where(size > 0, size, 1)
