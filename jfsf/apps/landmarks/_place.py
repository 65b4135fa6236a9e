"""Landmarks on a mesh: the vertices or the points of the surface that they are at.

A file of 3D Slicer may be in RAS where the mesh was saved in LPS, or the other way. The
points are tried as they are, and with x and y reversed. What is chosen is a guess by
distance, and is said.
"""

from typing import NamedTuple

import numpy as np

from jfsf.apps.landmarks._nearest import at_vertices, nearest_points
from jfsf.apps.landmarks._record import Landmarks, checked, titled
from jfsf.mesh._values import check_values
from jfsf.types import ArrayLike, Mesh

# Distances from the surface, in diagonals of the bounding box of the mesh. Landmarks by
# hand, or of a copy with other vertices, are within 0.01; those in other units or axes
# seldom within 0.05.
FAR, NEAR = 0.05, 0.01
# So far outside of the box that no axes are tried.
HOPELESS = 1e6
# The other axes are taken if the farthest landmark is this much nearer to the surface.
CLEARLY = 4
_OTHER = {"LPS": "RAS", "RAS": "LPS"}


class OnSurface(NamedTuple):
    """Landmarks as points of a mesh.

    corners: (l, 3) int64, the vertices of the triangle that each lies on; three times
        the same where it is a vertex.
    weights: (l, 3) barycentric coordinates, of sum 1.
    points: (l, 3) float64, in the coordinates of the mesh.
    distances: (l,) from the landmark to that point, in units of the mesh.
    system: what the coordinates of the mesh are, as far as the file tells: "LPS", "RAS"
        or None.
    said: what was noticed, a sentence each.
    """

    corners: ArrayLike
    weights: ArrayLike
    points: ArrayLike
    distances: ArrayLike
    system: str | None
    said: list[str]


class AtVertices(NamedTuple):
    """Landmarks as vertices of a mesh.

    vertices: (l,) int64, from 0 on.
    distances: (l,) from the landmark to that vertex, in units of the mesh.
    said: what was noticed, a sentence each.
    """

    vertices: ArrayLike
    distances: ArrayLike
    said: list[str]


def to_vertices(landmarks: Landmarks, mesh: Mesh) -> AtVertices:
    """The vertex of a mesh for each landmark.

    It is the nearest corner of the triangle that is nearest to the landmark. On thin
    parts the nearest of all vertices may be on the other side; and a vertex without a
    face is none. Of a point cloud it is the nearest vertex.

    Args:
        landmarks: points in the coordinates of the mesh; or vertices, which are only
            checked.
        mesh: n vertices, m faces.

    Raises:
        ValueError: as `on_surface`.
    """
    found = on_surface(landmarks, mesh)
    landmarks = checked(landmarks, "to_vertices")
    if landmarks.vertices is not None:
        return AtVertices(landmarks.vertices, found.distances, found.said)
    # Where the landmarks are in the coordinates of the mesh.
    points = np.asarray(landmarks.points)
    if found.system != landmarks.system:
        points = _reversed(points)
    corners = np.asarray(mesh.vertices, np.float64)[found.corners]
    away = np.linalg.norm(corners - points[:, None], axis=2)
    best = away.argmin(1)[:, None]
    vertices = np.take_along_axis(found.corners, best, 1)[:, 0]
    said = found.said + _shared(landmarks.names, vertices)
    return AtVertices(vertices, np.take_along_axis(away, best, 1)[:, 0], said)


def on_surface(landmarks: Landmarks, mesh: Mesh) -> OnSurface:
    """The point of the surface that is nearest to each landmark.

    If the file names a coordinate system, and the landmarks are clearly nearer to the
    mesh with x and y reversed, from LPS to RAS or back, they are reversed, and that is
    said.

    Args:
        landmarks: points in the coordinates of the mesh; or vertices.
        mesh: n vertices, m faces; of a point cloud the nearest vertices are found.
            Vertices that are not finite are passed over, with their faces.

    Raises:
        ValueError: a landmark is farther from the mesh than `FAR` of the diagonal of
            its bounding box, or is a vertex that it does not have; wrong shapes.
    """
    landmarks = checked(landmarks, "on_surface")
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    check_values(vertices, faces, "on_surface", finite=False)
    finite = np.asarray(np.isfinite(vertices).all(1))
    if not finite.any():
        check_values(vertices, faces, "on_surface")
    if not finite.all():
        faces = faces[finite[faces].all(1)]
        vertices = np.where(finite[:, None], vertices, vertices[finite][0])
        mesh = Mesh(vertices, faces)
    names = landmarks.names
    if landmarks.vertices is not None:
        wrong = (landmarks.vertices < 0) | (landmarks.vertices >= len(vertices))
        if len(lost := np.flatnonzero(wrong)):
            raise ValueError(
                f"{titled(names, lost[0])} is vertex {landmarks.vertices[lost[0]]}, "
                f"and the mesh has {len(vertices)} vertices, from 0 on; is the file of "
                "another mesh?"
            )
        if len(lost := np.flatnonzero(~finite[landmarks.vertices])):
            raise ValueError(
                f"{titled(names, lost[0])} is vertex {landmarks.vertices[lost[0]]}, "
                "which has no finite place; leave the landmark out"
            )
        found = at_vertices(mesh, landmarks.vertices)
        return OnSurface(*found, landmarks.system, [])
    if not names:
        return OnSurface(
            *at_vertices(mesh, np.zeros(0, np.int64)), landmarks.system, []
        )
    diagonal = float(np.linalg.norm(np.ptp(vertices.astype(np.float64), axis=0)))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    with np.errstate(over="ignore"):
        outside = np.maximum(low - landmarks.points, landmarks.points - high).max(1)
    # Squares of such distances may be infinite.
    _refuse_far(names, outside, diagonal, HOPELESS)
    found, system, said = _placed(landmarks, mesh, diagonal)
    _refuse_far(names, found.distances, diagonal, FAR)
    return OnSurface(*found, system, said)


def _refuse_far(names: tuple[str, ...], away: ArrayLike, diagonal: float, most: float):
    worst = int(away.argmax())
    if away[worst] > most * diagonal:
        raise ValueError(
            f"{titled(names, worst)} is {away[worst]:.4g} from the mesh, more than "
            f"{FAR:.0%} of the diagonal of its bounding box ({diagonal:.4g}); are both "
            "in the same units and axes, and is the file of another mesh, or of one "
            "that was moved?"
        )


def _placed(landmarks: Landmarks, mesh: Mesh, diagonal: float):
    """The nearest points, the system of the mesh, and what to say."""
    found = nearest_points(mesh, landmarks.points)
    system = landmarks.system
    away = found.distances.max()
    if system is None or away <= NEAR * diagonal:
        return found, system, []
    other = nearest_points(mesh, _reversed(landmarks.points))
    if other.distances.max() > min(FAR * diagonal, away / CLEARLY):
        return found, system, []
    said = (
        f"the landmarks are in {system}; with x and y reversed they are within "
        f"{other.distances.max():.4g} of the mesh, else {away:.4g} away: the mesh was "
        f"taken to be in {_OTHER[system]}"
    )
    return other, _OTHER[system], [said]


def _reversed(points: ArrayLike) -> ArrayLike:
    return np.asarray(points) * [-1.0, -1.0, 1.0]


def _shared(names: tuple[str, ...], vertices: ArrayLike) -> list[str]:
    """That two landmarks are at one vertex."""
    _, first, at = np.unique(vertices, return_index=True, return_inverse=True)
    first = first[at]
    return [
        f"{titled(names, first[i])} and {titled(names, i)} are both at vertex "
        f"{vertices[i]}: the mesh is coarse there"
        for i in map(int, np.flatnonzero(first != np.arange(len(names))))
    ]
