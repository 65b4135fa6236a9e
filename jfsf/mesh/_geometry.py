"""Areas, normals, edges, components and paths along edges of triangle meshes (numpy).

Half-edge 3 f + i runs from corner i of face f to the next corner.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from jfsf.mesh._values import mesh_arrays
from jfsf.types import ArrayLike, Mesh


class Edges(NamedTuple):
    """The undirected edges of a mesh, each once.

    ends: (e, 2) vertices, the lower first; rows in lexicographic order.
    counts: (e,) faces of each edge. A face that repeats a vertex counts twice for the
        only edge it has.
    """

    ends: ArrayLike
    counts: ArrayLike


class HalfEdgePairs(NamedTuple):
    """Pairs of half-edges that lie on one edge.

    counts: (e,) faces of each undirected edge.
    left, right: (p,) the half-edges of each pair; an edge with c faces gives a chain of
        c - 1 pairs.
    manifold: (p,) whether the pair's edge has two faces only.
    clash: (p,) whether both run in the same direction.
    """

    counts: ArrayLike
    left: ArrayLike
    right: ArrayLike
    manifold: ArrayLike
    clash: ArrayLike


def face_normals(vertices: ArrayLike, faces: ArrayLike) -> Any:
    """Normals (m, 3) of the faces, each as long as twice the area of its face."""
    # Differences of whole numbers, which files may hold, would wrap round.
    vertices = np.asarray(vertices, np.float64)
    a, b, c = (vertices[corner] for corner in np.asarray(faces).T)
    return np.cross(b - a, c - a)


def face_areas(vertices: ArrayLike, faces: ArrayLike) -> Any:
    """Areas of the faces, (m,) float64."""
    return np.linalg.norm(face_normals(vertices, faces), axis=1) / 2


def in_unit_box(points: ArrayLike) -> Any:
    """Points (n, 3) moved and scaled so that the longest side of their box is 1.

    Neither very large nor very small units overflow. Points that coincide stay 0.
    """
    low, high = points.min(0) / 2, points.max(0) / 2
    size = (high - low).max()
    return (points / 2 - low) / (size if size > 0 else 1)


def surface_area(mesh: Mesh) -> float:
    """Area of a mesh; 0 for a point cloud."""
    return float(face_areas(*mesh_arrays(mesh)).sum())


def rms_size(mesh: Mesh) -> float:
    """Root mean square distance of a surface from its centroid, in its unit.

    The centroid size of landmarks that are spread evenly over it is this times the
    square root of their number.
    """
    vertices, faces = mesh_arrays(mesh)
    weight = vertex_areas(vertices, faces)
    weight = weight / weight.sum()
    away = np.asarray(vertices, float) - weight @ vertices
    return float(np.sqrt(weight @ (away**2).sum(1)))


def vertex_normals(vertices: ArrayLike, faces: ArrayLike) -> Any:
    """Unit normals (n, 3), faces weighted by their area; 0 where there is none."""
    total = [_at_vertices(vertices, faces, c) for c in face_normals(vertices, faces).T]
    normal = np.stack(total, axis=1)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.where(size > 0, size, 1)


def vertex_areas(vertices: ArrayLike, faces: ArrayLike) -> Any:
    """A third (n,) of the area of each vertex's faces."""
    return _at_vertices(vertices, faces, face_areas(vertices, faces)) / 3


def edges(faces: ArrayLike) -> Edges:
    """The undirected edges of faces (m, 3); a vertex is never joined to itself."""
    faces = np.asarray(faces)
    n = int(faces.max(initial=0)) + 1
    key = edge_keys(faces, n)
    key, counts = np.unique(key[key // n != key % n], return_counts=True)
    return Edges(np.stack([key // n, key % n], axis=1), counts)


def boundary_edges(faces: ArrayLike) -> ArrayLike:
    """Edges (b, 2) with one face, from tail to head as that face is wound."""
    faces = np.asarray(faces)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    proper = np.flatnonzero(tail != head)
    key = edge_keys(faces, int(faces.max(initial=0)) + 1)[proper]
    _, first, counts = np.unique(key, return_index=True, return_counts=True)
    alone = proper[first[counts == 1]]
    return np.stack([tail[alone], head[alone]], axis=1)


def pair_half_edges(faces: ArrayLike, n: int) -> HalfEdgePairs:
    """Pair up the half-edges of `faces` (m, 3), none of which may repeat a vertex.

    Args:
        faces: vertices, 0-based.
        n: number of vertices.
    """
    key, tail = edge_keys(faces, n), faces.ravel()
    order = np.argsort(key, kind="stable")
    key = key[order]
    counts = np.diff(np.flatnonzero(np.diff(key, prepend=-1)), append=len(key))
    at = np.flatnonzero(key[1:] == key[:-1])
    left, right = order[at], order[at + 1]
    manifold = np.repeat(counts, counts)[at] == 2
    return HalfEdgePairs(counts, left, right, manifold, tail[left] == tail[right])


def repeats_vertex(faces: ArrayLike) -> Any:
    """Whether each face (m,) names a vertex twice."""
    return (faces == np.roll(faces, -1, axis=1)).any(axis=1)


def components(size: int, left: ArrayLike, right: ArrayLike) -> Any:
    """Connected components of an undirected graph.

    Args:
        size: number of nodes.
        left, right: nodes that are joined, arrays of one shape.

    Returns:
        (size,) the component of each node, counted from 0 in the order of their lowest
        nodes.
    """
    left, right = np.ravel(left), np.ravel(right)
    graph = coo_array((np.ones(len(left), bool), (left, right)), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def vertex_components(faces: ArrayLike, n: int) -> Any:
    """The connected component (n,) of each vertex; one without a face is alone.

    Args:
        faces: (m, 3), 0-based.
        n: number of vertices.
    """
    # Two edges of a face join its three vertices.
    return components(n, faces[:, :2], faces[:, 1:])


def component_volumes(
    vertices: ArrayLike, faces: ArrayLike, component: ArrayLike
) -> Any:
    """Signed volume and area of each component of a surface.

    An open component is closed by a cone to its centroid, so the volume of a scan with
    holes still has the right sign.

    Args:
        vertices: (n, 3).
        faces: (m, 3), each component wound consistently.
        component: (m,) the component of each face, counted from 0.

    Returns:
        (p,) volumes, positive if the winding faces outward, and (p,) areas.
    """
    corners = vertices[faces]
    weight = face_areas(vertices, faces)
    area = np.bincount(component, weight)
    centre = [
        np.bincount(component, weight * x) / np.where(area > 0, area, 1)
        for x in corners.mean(axis=1).T
    ]
    a, b, c = np.moveaxis(corners - np.stack(centre, 1)[component][:, None], 1, 0)
    return np.bincount(component, (a * np.cross(b, c)).sum(axis=1) / 6), area


def _at_vertices(vertices, faces, values):
    """The sum (n,) of the values of each vertex's faces."""
    return np.bincount(faces.ravel(), np.repeat(values, 3), minlength=len(vertices))


def edge_keys(faces, n):
    """A number (3 m,) for the undirected edge of each half-edge: low end n + high."""
    tail = faces.ravel().astype(np.int64)
    head = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    return np.minimum(tail, head) * n + np.maximum(tail, head)


def edge_graph(mesh: Mesh) -> sp.csr_matrix:
    """The lengths (n, n) of the edges, each in one direction."""
    vertices, n = np.asarray(mesh.vertices), len(mesh.vertices)
    one, two = edges(mesh.faces).ends.T
    length = np.linalg.norm(vertices[one] - vertices[two], axis=1)
    return sp.csr_matrix((length, (one, two)), (n, n))


def farthest_vertices(mesh: Mesh, num: int, *, start: int = 0) -> ArrayLike:
    """Vertices (num,), each the farthest along edges from those before it.

    Args:
        mesh: n vertices, one connected component.
        num: n or fewer.
        start: the first of them.
    """
    graph = edge_graph(mesh)
    far, chosen = np.full(len(mesh.vertices), np.inf), [start]
    while len(chosen) < num:
        # Vertices beyond the limit cannot come closer, so the search is local.
        reach = {"limit": far.max(), "indices": chosen[-1], "directed": False}
        far = np.minimum(far, dijkstra(graph, **reach))
        chosen.append(int(far.argmax()))
    return np.array(chosen)
