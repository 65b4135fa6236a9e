"""Mesh -> Mesh: wind it outward, keep its largest piece, weld its seams. Host side."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jfsf.mesh_check import (
    edge_links,
    face_areas,
    piece_volumes,
    repeats,
    vertex_components,
)
from jfsf.types import ArrayLike, Mesh


class Submesh(NamedTuple):
    """Part of a mesh, and where its vertices come from.

    mesh: the part, vertices and faces in their old order.
    index: (n_kept,) int32, the original vertex of each kept one.
    """

    mesh: Mesh
    index: ArrayLike


def orient(mesh: Mesh) -> Mesh:
    """Wind the faces consistently and outward; vertices and face order stay.

    Each piece connected through edges with two faces is wound like its first face, then
    flipped as a whole if its signed volume is negative. An open piece is closed by a
    cone to its centroid for that purpose; a flat one keeps the winding of its first
    face. A cavity inside a body counts as a piece of its own, so it faces away from
    its own inside.

    Args:
        mesh: n vertices, m faces, values as `jfsf.mesh.validate` wants them.

    Returns:
        The mesh, wound. A one-sided piece (a Moebius strip) keeps its own winding, and
        pieces that meet in an edge with three faces or more are wound one by one;
        `check(...).consistent` is False after either.
    """
    vertices, faces = np.asarray(mesh.vertices), np.array(mesh.faces)
    solid = np.flatnonzero(~repeats(faces))
    m = len(solid)
    if m == 0:
        return Mesh(vertices, faces)
    links = edge_links(faces[solid], len(vertices))
    left, right = links.left[links.manifold] // 3, links.right[links.manifold] // 3
    clash = links.clash[links.manifold]
    # The two-fold cover: node f is face f as it is, node m + f is face f flipped, and
    # edges join what fits together. A piece with two sides lifts to two components.
    twin = right + m * clash, right + m * ~clash
    graph = coo_array(
        (
            np.ones(2 * len(left), bool),
            (np.concatenate([left, left + m]), np.concatenate(twin)),
        ),
        shape=(2 * m, 2 * m),
    )
    label = connected_components(graph, directed=False)[1]
    kept, flipped = label[:m], label[m:]
    _, first, piece = np.unique(
        np.minimum(kept, flipped), return_index=True, return_inverse=True
    )
    # Of the two, take the component that leaves the piece's first face as it is.
    wound = _flip(faces[solid], kept != kept[first][piece])
    volume, area = piece_volumes(vertices, wound, piece)
    one_sided = (kept == flipped)[first]
    inward = (volume < -1e-9 * area**1.5) & ~one_sided
    faces[solid] = _flip(wound, inward[piece])
    return Mesh(vertices, faces)


def largest_component(mesh: Mesh) -> Submesh:
    """Keep the connected piece with the largest area; drop unreferenced vertices.

    Args:
        mesh: n vertices, m faces. A point cloud comes back whole.

    Returns:
        The piece and its vertices' numbers in `mesh`; ties go to the lowest vertex.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(faces) == 0:
        return Submesh(mesh, np.arange(len(vertices), dtype=np.int32))
    piece = vertex_components(mesh)
    owner = piece[faces[:, 0]]
    area = np.bincount(owner, face_areas(vertices, faces))
    # A lone vertex must not win from pieces whose area is 0 too.
    keep = piece == np.argmax(np.where(np.bincount(owner) > 0, area, -1))
    index = np.flatnonzero(keep).astype(np.int32)
    renumber = np.cumsum(keep, dtype=np.int32) - np.int32(1)
    part = Mesh(vertices[keep], renumber[faces[keep[faces[:, 0]]]])
    return Submesh(part, index)


def weld(mesh: Mesh) -> Submesh:
    """Merge vertices with exactly equal coordinates, as seams and STL files need.

    Args:
        mesh: n vertices, m faces.

    Returns:
        The mesh, each vertex at the place of its first copy, and those copies' numbers.
        Faces whose corners merge stay; `check` counts them as degenerate.
    """
    vertices = np.asarray(mesh.vertices)
    n = len(vertices)
    order = np.lexsort(vertices.T)
    fresh = np.ones(n, bool)
    fresh[1:] = (vertices[order[1:]] != vertices[order[:-1]]).any(axis=1)
    # lexsort is stable: the first of each run has the lowest number.
    first = np.empty(n, np.int64)
    first[order] = order[fresh][np.cumsum(fresh) - 1]
    keep = first == np.arange(n)
    renumber = np.cumsum(keep, dtype=np.int32) - np.int32(1)
    index = np.flatnonzero(keep).astype(np.int32)
    return Submesh(Mesh(vertices[keep], renumber[first][np.asarray(mesh.faces)]), index)


def _flip(faces, which):
    return np.where(which[:, None], faces[:, [0, 2, 1]], faces)
