"""Mesh -> Mesh: its components, its mirror image, seams welded, small holes closed."""

from typing import NamedTuple

import numpy as np

from jfsf.mesh._geometry import (
    boundary_edges,
    face_areas,
    vertex_components,
)
from jfsf.mesh._values import mesh_arrays
from jfsf.types import ArrayLike, Mesh

# Length of a rim that is closed, at most, in sqrt(area) of its component: the rim of a
# separate triangle or flake is no hole. The 20 holes of a body in
# experiments/accuracy/damage.py have 0.35; where an arm was cut it is about as much.
LONGEST = 0.4


class Submesh(NamedTuple):
    """Part of a mesh, and the original numbers of its vertices.

    mesh: the part, vertices and faces in their old order.
    index: (n_kept,) int32, the original vertex of each kept one.
    """

    mesh: Mesh
    index: ArrayLike


def mirror_image(mesh: Mesh) -> Mesh:
    """The mirror image in x, with faces wound as before: outward stays outward.

    Vertex i and face i keep their numbers.
    """
    vertices, faces = mesh_arrays(mesh)
    return Mesh(vertices * [-1, 1, 1], faces[:, ::-1])


def largest_component(mesh: Mesh) -> Submesh:
    """Keep the connected component with the largest area, without stray vertices.

    Args:
        mesh: n vertices, m faces. A point cloud comes back whole.

    Returns:
        The component and its vertices' numbers in `mesh`. Of components with equal
        area, the one with the lowest vertex.
    """
    vertices, faces = mesh_arrays(mesh)
    if len(faces) == 0:
        return Submesh(mesh, np.arange(len(vertices), dtype=np.int32))
    component = vertex_components(faces, len(vertices))
    owner = component[faces[:, 0]]
    area = np.bincount(owner, face_areas(vertices, faces))
    # A vertex without a face must not win if all areas are 0.
    keep = component == np.argmax(np.where(np.bincount(owner) > 0, area, -1))
    index = np.flatnonzero(keep).astype(np.int32)
    renumber = np.cumsum(keep, dtype=np.int32) - np.int32(1)
    part = Mesh(vertices[keep], renumber[faces[keep[faces[:, 0]]]])
    return Submesh(part, index)


def split_components(mesh: Mesh) -> list[Submesh]:
    """All connected components of a mesh, without stray vertices.

    Args:
        mesh: n vertices, m faces.

    Returns:
        The components and their vertices' numbers in `mesh`, in the order of their
        lowest vertices. A point cloud has none.
    """
    vertices, faces = mesh_arrays(mesh)
    if len(faces) == 0:
        return []
    component = vertex_components(faces, len(vertices))
    # Sorted by component, once: a scan may have thousands of crumbs.
    order = np.argsort(component, kind="stable").astype(np.int32)
    sizes = np.bincount(component)
    ends = np.cumsum(sizes)
    local = np.empty(len(vertices), np.int32)
    local[order] = np.arange(len(vertices)) - (ends - sizes)[component[order]]
    owner = component[faces[:, 0]]
    rows = np.argsort(owner, kind="stable")
    face_ends = np.cumsum(np.bincount(owner, minlength=len(ends)))
    indices = np.split(order, ends[:-1])
    corners = np.split(local[faces[rows]], face_ends[:-1])
    return [
        Submesh(Mesh(vertices[index], own), index)
        for index, own in zip(indices, corners, strict=True)
        if len(own)
    ]


def weld(mesh: Mesh) -> Submesh:
    """Merge vertices with exactly equal coordinates, such as those along seams.

    Args:
        mesh: n vertices, m faces.

    Returns:
        The mesh and, for each vertex, the lowest number in `mesh` of those merged into
        it; vertices stay in that order. Faces whose corners merge stay; `check` counts
        them as degenerate.
    """
    vertices, faces = mesh_arrays(mesh)
    first = first_equal(vertices)
    keep = first == np.arange(len(vertices))
    renumber = np.cumsum(keep, dtype=np.int32) - np.int32(1)
    index = np.flatnonzero(keep).astype(np.int32)
    return Submesh(Mesh(vertices[keep], renumber[first][faces]), index)


def first_equal(vertices: ArrayLike) -> ArrayLike:
    """The lowest vertex (n,) with exactly equal coordinates."""
    n = len(vertices)
    order = np.lexsort(vertices.T)
    starts = np.ones(n, bool)
    starts[1:] = (vertices[order[1:]] != vertices[order[:-1]]).any(axis=1)
    # lexsort is stable: the first of equal vertices has the lowest number.
    first = np.empty(n, np.int64)
    first[order] = order[starts][np.cumsum(starts) - 1]
    return first


def without_holes(mesh: Mesh) -> Mesh:
    """The mesh with faces across its small holes.

    Distances and eigenfunctions then hardly notice them.

    Args:
        mesh: n vertices, m faces, wound consistently.

    Returns:
        The same vertices, and the faces followed by new ones, wound as their
        neighbours. The same mesh if it has no small hole, if more than 2 n faces would
        come of it (a surface with many handles), and for a point cloud. A rim that
        touches another or itself is left.
    """
    vertices, faces = mesh_arrays(mesh)
    vertices = vertices.astype(np.float64)
    if len(faces) == 0:
        return mesh
    component = vertex_components(faces, len(vertices))
    area = np.bincount(component[faces[:, 0]], face_areas(vertices, faces))
    limit = LONGEST * np.sqrt(area)
    new: list = []
    for rim in rims(faces):
        points = vertices[rim]
        sides = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
        if sides.sum() <= limit[component[rim[0]]]:
            new += _triangles(rim)
    if not new or len(faces) + len(new) > 2 * len(vertices):
        return mesh
    return Mesh(mesh.vertices, np.concatenate([faces, np.array(new, faces.dtype)]))


def rims(faces: ArrayLike) -> list[list[int]]:
    """The closed rims of a mesh: chains of vertices along its boundary.

    Args:
        faces: (m, 3), wound consistently.

    Returns:
        The vertices of each rim in their order, against the winding of the faces beside
        it. Rims that touch another or themselves are left out.
    """
    ends = boundary_edges(faces).T[::-1].astype(np.int64)
    n = int(ends.max(initial=-1)) + 1
    starts, stops = (np.bincount(one, minlength=n) for one in ends)
    simple = (starts == 1) & (stops == 1)
    after = {a: b for a, b in ends.T.tolist() if simple[a] and simple[b]}
    found = []
    while after:
        first, vertex = after.popitem()
        rim = [first]
        while vertex in after:
            rim.append(vertex)
            vertex = after.pop(vertex)
        if vertex == first and len(rim) > 2:
            found.append(rim)
    return found


def _triangles(rim: list[int]) -> list[tuple[int, int, int]]:
    """A strip to and fro across the rim, whose triangles are less thin than a fan's."""
    triangles, low, high = [], 0, len(rim) - 1
    while high - low > 1:
        if len(triangles) % 2:
            triangles.append((rim[low], rim[high - 1], rim[high]))
            high -= 1
        else:
            triangles.append((rim[low], rim[low + 1], rim[high]))
            low += 1
    return triangles
