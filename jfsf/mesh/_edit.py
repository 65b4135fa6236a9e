"""Mesh -> Mesh: wind it outward, keep its largest component, weld its seams (numpy)."""

from typing import NamedTuple

import numpy as np

from jfsf.mesh._geometry import (
    component_volumes,
    components,
    face_areas,
    pair_half_edges,
    repeats_vertex,
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


def orient(mesh: Mesh) -> Mesh:
    """Wind the faces consistently and outward; vertices and face order stay.

    Each piece connected through edges with two faces is wound like its first face, then
    flipped as a whole if its signed volume is negative. For the volume, an open piece
    is closed by a cone to its centroid. A flat piece keeps the winding of its first
    face. The surface of a cavity is a piece of its own: it comes out wound like any
    closed surface, with its normals away from the cavity.

    Args:
        mesh: n vertices, m faces; indices in range, coordinates finite.

    Returns:
        The mesh, wound. A one-sided piece (a Moebius strip) keeps its own winding, and
        pieces that meet in an edge with three faces or more are wound separately;
        `check(...).consistent` is False for both.
    """
    vertices, faces = np.asarray(mesh.vertices), np.array(mesh.faces)
    solid = np.flatnonzero(~repeats_vertex(faces))
    m = len(solid)
    if m == 0:
        return Mesh(vertices, faces)
    pairs = pair_half_edges(faces[solid], len(vertices))
    left, right = pairs.left[pairs.manifold] // 3, pairs.right[pairs.manifold] // 3
    clash = pairs.clash[pairs.manifold]
    # A graph with two nodes a face: f as it is, and m + f flipped. It joins neighbours
    # that are wound consistently. A two-sided piece gives two components, each the
    # other flipped; a one-sided piece gives one.
    fits = right + m * clash, right + m * ~clash
    label = components(2 * m, np.concatenate([left, left + m]), np.concatenate(fits))
    kept, flipped = label[:m], label[m:]
    _, first, piece = np.unique(
        np.minimum(kept, flipped), return_index=True, return_inverse=True
    )
    # Take the component that leaves the piece's first face as it is.
    wound = _flip(faces[solid], kept != kept[first][piece])
    volume, area = component_volumes(vertices, wound, piece)
    one_sided = (kept == flipped)[first]
    inward = (volume < -1e-9 * area**1.5) & ~one_sided
    faces[solid] = _flip(wound, inward[piece])
    return Mesh(vertices, faces)


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


def _flip(faces, which):
    return np.where(which[:, None], faces[:, [0, 2, 1]], faces)
