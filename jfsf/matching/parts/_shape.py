"""Mesh -> PartSamples: what survives a cut, read at samples. Host side (numpy).

A cut changes the spectrum everywhere. Geodesics inside the part, directions along the
surface and what is seen within a distance smaller than that of the cut stay.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.geometry import GeodesicSolver
from jfsf.matching.parts._settings import PartSettings
from jfsf.mesh import face_normals, farthest_vertices, vertex_areas, vertex_normals
from jfsf.mesh._geometry import boundary_edges
from jfsf.types import ArrayLike, Mesh


class PartSamples(NamedTuple):
    """A shape at samples, lengths in the unit that both shapes share.

    mesh: in that unit, wound outward.
    at: (s,) vertices, each far from those before it.
    distance: (s, n) geodesics from these.
    direction: (s, s) complex; entry (i, j) is the unit direction at sample i towards
        sample j, in a tangent frame of i whose third axis is the outward normal.
    normal: (n, 3) outward unit normals.
    mass: (n,) vertex areas.
    to_boundary: (n,) geodesic distance to the boundary; inf if there is none.
    around: (s, s) length of the shortest path between two samples by the boundary.
    landmarks: (l,) the samples at landmarks, which come last, in their order.
    descriptors: (s, d) those that were given, at the samples; None without any.
    """

    mesh: Mesh
    at: ArrayLike
    distance: ArrayLike
    direction: ArrayLike
    normal: ArrayLike
    mass: ArrayLike
    to_boundary: ArrayLike
    around: ArrayLike
    landmarks: ArrayLike = np.zeros(0, np.int64)
    descriptors: ArrayLike | None = None

    @property
    def between(self) -> np.ndarray:
        """(s, s) distances between samples, symmetric."""
        between = self.distance[:, self.at]
        return (between + between.T) / 2


def part_samples(
    mesh: Mesh,
    num: int,
    *,
    landmarks: ArrayLike = (),
    descriptors: ArrayLike | None = None,
    settings: PartSettings = PartSettings(),
) -> PartSamples:
    """`num` samples of a connected mesh, wound outward; fewer vertices, fewer samples.

    Args:
        mesh: in the common unit.
        num: samples, those at landmarks not counted.
        landmarks: (l,) vertices.
        descriptors: (n, d), a row a vertex.
        settings: how the distance to the boundary is measured.
    """
    n, solver = len(mesh.vertices), GeodesicSolver(mesh)
    edge = np.unique(boundary_edges(mesh.faces))
    to_boundary, from_edge = np.full(n, np.inf), np.zeros((0, n))
    if len(edge):
        step = -(-len(edge) // settings.boundary_samples)
        from_edge = solver.rows(edge[::step])
        to_boundary = from_edge.min(0)
        to_boundary[edge] = 0
    extremity = int(farthest_vertices(mesh, 2)[1])
    at = farthest_vertices(mesh, min(num, n), start=extremity)
    known = len(at) + np.arange(len(landmarks))
    at = np.concatenate([at, np.asarray(landmarks, at.dtype)])
    distance = solver.rows(at)
    normal, mass = vertex_normals(*mesh), vertex_areas(*mesh)
    direction = _directions(mesh, at, distance, normal)
    around = np.full((len(at), len(at)), np.inf)
    for row in from_edge[:, at]:
        around = np.minimum(around, row[:, None] + row[None])
    given = None if descriptors is None else np.asarray(descriptors, float)[at]
    return PartSamples(
        *(mesh, at, distance, direction, normal, mass, to_boundary, around),
        *(known, given),
    )


def along_cut(around, between, settings: PartSettings) -> np.ndarray:
    """Whether shortest paths run along a cut: in the whole they may be shorter.

    Args:
        around, between: of `PartSamples`, or rows and columns of these.
        settings: how much longer the path by the boundary may be.
    """
    longer = settings.along_cut_factor * between + settings.along_cut_slack
    return around < longer


def _directions(mesh: Mesh, at, distance, normal) -> np.ndarray:
    """See `PartSamples.direction`."""
    vertices, faces = mesh
    n, place = len(vertices), np.full(len(vertices), -1)
    place[at] = np.arange(len(at))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = face_normals(vertices, faces)
    twice = np.linalg.norm(across, axis=1, keepdims=True)
    unit = across / np.where(twice > 0, twice, 1)
    # Gradient of a linear function, times twice the area: sum of value x turned edge.
    turned = [np.cross(unit, edge) for edge in (c - b, a - c, b - a)]
    rows, cols, values = [], [], []
    for corner in range(3):
        owner = place[faces[:, corner]]
        for source in range(3):
            kept = owner >= 0
            for axis in range(3):
                rows.append(3 * owner[kept] + axis)
                cols.append(faces[kept, source])
                values.append(turned[source][kept, axis])
    shape = 3 * len(at), n
    entries = np.concatenate(rows), np.concatenate(cols)
    gradient = sp.csr_matrix((np.concatenate(values), entries), shape=shape)
    slope = -(gradient @ distance.T).reshape(len(at), 3, len(at))  # i, axis, j
    third = normal[at]
    other = np.where(np.abs(third[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(third, other)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    second = np.cross(third, first)
    towards = np.einsum("iaj,ia->ij", slope, first) + 1j * np.einsum(
        "iaj,ia->ij", slope, second
    )
    # A vertex may be a sample twice, as a landmark too: only the last has faces above.
    towards = towards[place[at]]
    size = np.abs(towards)
    return towards / np.where(size > 0, size, 1)
