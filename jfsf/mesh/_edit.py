"""Mesh -> Mesh: its components, its mirror image, its seams welded (numpy)."""

from typing import NamedTuple

import numpy as np

from jfsf.mesh._geometry import (
    face_areas,
    vertex_components,
)
from jfsf.types import ArrayLike, Mesh


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
    vertices = np.asarray(mesh.vertices) * [-1, 1, 1]
    return Mesh(vertices, np.asarray(mesh.faces)[:, ::-1])


def largest_component(mesh: Mesh) -> Submesh:
    """Keep the connected component with the largest area, without stray vertices.

    Args:
        mesh: n vertices, m faces. A point cloud comes back whole.

    Returns:
        The component and its vertices' numbers in `mesh`. Of components with equal
        area, the one with the lowest vertex.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
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
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
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
    vertices = np.asarray(mesh.vertices)
    first = first_equal(vertices)
    keep = first == np.arange(len(vertices))
    renumber = np.cumsum(keep, dtype=np.int32) - np.int32(1)
    index = np.flatnonzero(keep).astype(np.int32)
    return Submesh(Mesh(vertices[keep], renumber[first][np.asarray(mesh.faces)]), index)


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
