"""Mesh -> PartSamples: what survives a cut, read at samples. Host side (numpy).

A cut changes the spectrum everywhere. Geodesics inside the part, directions along the
surface and what is seen within a distance smaller than that of the cut stay.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from jfsf.evaluate import geodesics
from jfsf.mesh import edges, face_areas
from jfsf.types import ArrayLike, Mesh

# Sources on the boundary, at most, for the distance to it.
BOUNDARY_SOURCES = 80


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
    """

    mesh: Mesh
    at: ArrayLike
    distance: ArrayLike
    direction: ArrayLike
    normal: ArrayLike
    mass: ArrayLike
    to_boundary: ArrayLike
    around: ArrayLike

    @property
    def between(self) -> np.ndarray:
        """(s, s) distances between samples, symmetric."""
        between = self.distance[:, self.at]
        return (between + between.T) / 2


def part_samples(mesh: Mesh, num: int) -> PartSamples:
    """`num` samples of a connected mesh, wound outward; fewer vertices, fewer samples.

    Args:
        mesh: in the common unit.
        num: samples.
    """
    n = len(mesh.vertices)
    edge = boundary_vertices(mesh)
    to_boundary, from_edge = np.full(n, np.inf), np.zeros((0, n))
    if len(edge):
        step = -(-len(edge) // BOUNDARY_SOURCES)
        from_edge = geodesics(mesh, edge[::step])
        to_boundary = from_edge.min(0)
        to_boundary[edge] = 0
    at = _farthest(mesh, min(num, n))
    distance = geodesics(mesh, at)
    normal, mass = vertex_normals(mesh)
    direction = _directions(mesh, at, distance, normal)
    around = np.full((len(at), len(at)), np.inf)
    for row in from_edge[:, at]:
        around = np.minimum(around, row[:, None] + row[None])
    return PartSamples(mesh, at, distance, direction, normal, mass, to_boundary, around)


def boundary_vertices(mesh: Mesh) -> np.ndarray:
    """Vertices of edges with one face, ascending."""
    return np.unique(boundary_edges(mesh))


def boundary_edges(mesh: Mesh) -> np.ndarray:
    """(b, 2) edges with one face, wound as in that face."""
    faces = np.asarray(mesh.faces)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, first, count = np.unique(
        np.sort(ends, 1), axis=0, return_index=True, return_counts=True
    )
    return ends[first[count == 1]]


def vertex_normals(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) unit normals, and (n,) vertex areas."""
    vertices, faces = mesh
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across, n = np.cross(b - a, c - a), len(vertices)
    normal, mass = np.zeros((n, 3)), np.zeros(n)
    area = face_areas(vertices, faces) / 3
    for i in range(3):
        np.add.at(normal, faces[:, i], across)
        np.add.at(mass, faces[:, i], area)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.where(size > 0, size, 1), mass


def _farthest(mesh: Mesh, num: int) -> np.ndarray:
    """Vertices far from those before them, along edges; the first is an extremity."""
    graph, n = _edge_graph(mesh), len(mesh.vertices)
    far = dijkstra(graph, indices=0)
    chosen, far = [int(np.argmax(far))], np.full(n, np.inf)
    while len(chosen) < num:
        # Nothing beyond the present distance can come nearer.
        limit = far.max() if len(chosen) > 1 else np.inf
        far = np.minimum(far, dijkstra(graph, indices=chosen[-1], limit=limit))
        chosen.append(int(np.argmax(far)))
    return np.array(chosen)


def _edge_graph(mesh: Mesh) -> sp.csr_matrix:
    ends = edges(mesh.faces).ends
    length = np.linalg.norm(
        mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1
    )
    n = len(mesh.vertices)
    graph = sp.csr_matrix((length, (ends[:, 0], ends[:, 1])), shape=(n, n))
    return graph + graph.T


def _directions(mesh: Mesh, at, distance, normal) -> np.ndarray:
    """See `PartSamples.direction`."""
    vertices, faces = mesh
    n, place = len(vertices), np.full(len(vertices), -1)
    place[at] = np.arange(len(at))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
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
    found = np.einsum("iaj,ia->ij", slope, first) + 1j * np.einsum(
        "iaj,ia->ij", slope, second
    )
    size = np.abs(found)
    return found / np.where(size > 0, size, 1)
