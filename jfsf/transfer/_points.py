"""Points of one of two meshes that lie on each other -> points of the other.

A point goes to the nearest one of the other surface that faces alike. On thin parts,
such as fingers and ears, the nearest of all may be on the other side: the faces of a
coarse mesh cut through them.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh import (
    SurfaceTree,
    closest,
    face_areas,
    nearest_of,
    orient,
    surface_tree,
    vertex_normals,
)
from jfsf.transfer._laid import Laid
from jfsf.types import ArrayLike, Mesh

CANDIDATES = 24  # pieces of faces that are tried where the nearest faces away
NORMAL_WEIGHT = 0.2  # of a unit normal beside the position, in sqrt(area), for these
MIN_ALIKE = 0.0  # cosine between normals
ROWS = 100_000  # points at a time


class Points(NamedTuple):
    """Points of a mesh.

    face: (q,) the face of each; -1 of a point cloud.
    corners: (q, 3) the vertices of that face; three times the same of a point cloud.
    weights: (q, 3) barycentric coordinates.
    """

    face: ArrayLike
    corners: ArrayLike
    weights: ArrayLike


class Side(NamedTuple):
    """A mesh as it lies on the other.

    vertices: (n, 3) in common coordinates.
    normals: (n, 3) unit normals, so that both meshes look the same way; None where no
        side is known to be the outer one.
    faces: (m, 3) of the mesh.
    """

    vertices: ArrayLike
    normals: ArrayLike | None
    faces: ArrayLike


class Target(NamedTuple):
    """A side whose nearest points can be asked for.

    side: the mesh.
    kept: (p,) its faces with an area.
    surface: of these; None of a point cloud.
    tree: of its vertices, of a point cloud; of the centres and weighted normals of the
        surface's pieces, if there are normals; else None.
    normal: (p, 3) unit normals of the faces; None without normals.
    weight: of the normals in the tree.
    """

    side: Side
    kept: ArrayLike
    surface: SurfaceTree | None
    tree: KDTree | None
    normal: ArrayLike | None
    weight: float


def sides(laid: Laid) -> tuple[Side, Side]:
    """X and Y as they lie on each other."""
    found = []
    for mesh, at, sign in (
        (laid.mesh_x, laid.at_x, laid.orientation_sign),
        (laid.mesh_y, laid.at_y, abs(laid.orientation_sign)),
    ):
        faces, normals = np.asarray(mesh.faces), None
        if sign and len(faces):
            normals = sign * vertex_normals(at, orient(mesh).faces)
        found.append(Side(at, normals, faces))
    return found[0], found[1]


def target(side: Side) -> Target:
    """Prepare a side for `nearest`."""
    vertices, normals, faces = side
    areas = face_areas(vertices, faces)
    kept = np.flatnonzero(areas > 0)
    if len(kept) == 0:
        return Target(side, kept, None, KDTree(vertices), None, 0.0)
    surface = surface_tree(Mesh(vertices, faces[kept]))
    if normals is None:
        return Target(side, kept, surface, None, None, 0.0)
    normal = _unit(normals[faces[kept]].sum(1))
    weight = NORMAL_WEIGHT * float(np.sqrt(areas.sum()))
    tree = KDTree(np.hstack([surface.centre, weight * normal[surface.owner]]))
    return Target(side, kept, surface, tree, normal, weight)


def place(side: Side, points: Points) -> tuple[ArrayLike, ArrayLike | None]:
    """Positions (q, 3) of points of a side, and their unit normals."""
    mean = lambda rows: np.einsum("qc,qcd->qd", points.weights, rows[points.corners])
    normals = side.normals
    return mean(side.vertices), None if normals is None else _unit(mean(normals))


def nearest(target: Target, positions: ArrayLike, normals: ArrayLike | None) -> Points:
    """The nearest points of a side that face alike.

    Args:
        target: `target` of a side.
        positions: (q, 3) in common coordinates.
        normals: (q, 3) unit normals, or None.

    Returns:
        Where none near faces alike, the nearest of all.
    """
    if target.surface is None:
        assert target.tree is not None
        at = np.asarray(target.tree.query(positions)[1])
        weights = np.zeros((len(at), 3))
        weights[:, 0] = 1
        corners = np.repeat(at[:, None], 3, axis=1)
        return Points(np.full(len(at), -1), corners, weights)
    face = np.zeros(len(positions), int)
    weights = np.zeros((len(positions), 3))
    for start in range(0, len(positions), ROWS):
        rows = slice(start, start + ROWS)
        own = None if normals is None else normals[rows]
        face[rows], weights[rows] = _on_surface(target, positions[rows], own)
    face = target.kept[face]
    return Points(face, target.side.faces[face], weights)


def _on_surface(target: Target, positions, normals):
    surface = target.surface
    assert surface is not None
    found = closest(surface, positions)
    face, weights = found.face, found.barycentric
    if normals is None or target.normal is None or target.tree is None:
        return face, weights
    away = np.flatnonzero((target.normal[face] * normals).sum(1) <= MIN_ALIKE)
    if len(away) == 0:
        return face, weights
    k = min(CANDIDATES, len(surface.owner))
    queries = np.hstack([positions[away], target.weight * normals[away]])
    piece = np.asarray(target.tree.query(queries, np.arange(1, k + 1))[1]).ravel()
    row, others = np.repeat(np.arange(len(away)), k), surface.owner[piece]
    alike = (target.normal[others] * normals[away][row]).sum(1) > MIN_ALIKE
    better = nearest_of(surface, positions[away], row[alike], others[alike])
    there = better.face >= 0
    face[away[there]] = better.face[there]
    weights[away[there]] = better.barycentric[there]
    return face, weights


def at_vertices(side: Side) -> Points:
    """The vertices of a side as points."""
    at = np.arange(len(side.vertices))
    weights = np.zeros((len(at), 3))
    weights[:, 0] = 1
    return Points(np.full(len(at), -1), np.repeat(at[:, None], 3, axis=1), weights)


def in_faces(side: Side, weights: ArrayLike) -> Points:
    """Points with the same barycentric coordinates (s, 3) in each face: (m s) rows."""
    face = np.repeat(np.arange(len(side.faces)), len(weights))
    return Points(face, side.faces[face], np.tile(weights, (len(side.faces), 1)))


def _unit(rows):
    size = np.linalg.norm(rows, axis=-1, keepdims=True)
    return rows / np.where(size > 0, size, 1)
