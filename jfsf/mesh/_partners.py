"""Meshes with some vertices left out, and where those that are left come from."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh._values import check_values, mesh_arrays
from jfsf.types import ArrayLike, Mesh


class Repaired(NamedTuple):
    """A mended mesh, and where its vertices come from.

    mesh: the vertices and faces that are left, each in their old order.
    index: (n_left,) int32, the original number of each vertex that is left.
    partner: (n,) int32, the number that each original vertex has in `mesh`, -1 if it
        was removed. `partner[index]` counts from 0 on.
    done: what was done, a phrase with numbers for each step; empty if nothing was
        wrong.
    """

    mesh: Mesh
    index: ArrayLike
    partner: ArrayLike
    done: tuple[str, ...]


def without_strays(mesh: Mesh) -> Repaired:
    """Leave out vertices that belong to no face, and mend nothing else.

    Args:
        mesh: n vertices, m faces whose indices are in range. A point cloud stays whole.

    Returns:
        The mesh with both index maps; `done` is empty if every vertex has a face.
    """
    vertices, faces = mesh_arrays(mesh)
    n, done = len(vertices), []
    if len(faces) == 0:
        return kept(vertices, faces, np.arange(n), np.arange(n), done)
    index = np.unique(faces)
    text = "{vertices} without a face left out, to go where the nearest goes"
    note(done, n - len(index), text)
    return kept(vertices, faces, np.arange(n), index, done)


def without_nonfinite(mesh: Mesh, *, name: str = "mesh") -> Repaired:
    """Leave out vertices whose coordinates are not finite, and the faces they have.

    Args:
        mesh: n vertices, m faces, or a point cloud.
        name: opens the message of an error.

    Returns:
        The mesh with both index maps; `done` is empty if all coordinates are finite.

    Raises:
        MeshError: no vertex is finite, or as `check_values`.
    """
    vertices, faces = mesh_arrays(mesh, name)
    check_values(vertices, faces, name, finite=False)
    good, done = np.asarray(np.isfinite(vertices).all(axis=1)), []
    if not good.any():
        check_values(vertices, faces, name)
    lost = ~good[faces].all(axis=1)
    text = "{vertices} with coordinates that are not finite removed"
    if number := int(lost.sum()):
        text += f", with {number} {'faces' if number > 1 else 'face'}"
    note(done, int((~good).sum()), text)
    n = len(vertices)
    return kept(vertices, faces[~lost], np.arange(n), np.flatnonzero(good), done)


def after(first: Repaired, second: Repaired) -> Repaired:
    """Two repairs as one: the second is of the mesh of the first."""
    partner = np.full(len(first.partner), -1, np.int32)
    partner[first.index] = second.partner
    index = np.asarray(first.index)[second.index]
    return Repaired(second.mesh, index, partner, first.done + second.done)


def map_of_originals(
    T_xy: ArrayLike, mesh_x: Mesh, repaired_x: Repaired, repaired_y: Repaired
) -> ArrayLike:
    """The map between two meshes from the map between the repaired ones.

    Args:
        T_xy: the vertex of the repaired Y for each vertex of the repaired X.
        mesh_x: X before the repair, n_x vertices.
        repaired_x, repaired_y: of X and Y.

    Returns:
        (n_x,) int32, the vertex of Y before the repair for each vertex of X. One that
        was removed goes where the nearest goes that was not.
    """
    at = np.asarray(T_xy)[nearest_kept(mesh_x, repaired_x)]
    return np.asarray(repaired_y.index)[at]


def nearest_kept(mesh: Mesh, repaired: Repaired) -> ArrayLike:
    """The vertex of the repaired mesh for each vertex (n,) of the mesh before.

    For one that was removed it is the nearest. One without finite coordinates has none:
    it gets that of a vertex with which it has a face, else of the next number.
    """
    vertices, partner = np.asarray(mesh.vertices), np.array(repaired.partner)
    nowhere = (partner < 0) & ~np.isfinite(vertices).all(axis=1)
    lost = np.flatnonzero((partner < 0) & ~nowhere)
    if len(lost):
        left = KDTree(vertices[repaired.index])
        partner[lost] = left.query(vertices[lost])[1]
    if nowhere.any():
        _beside(np.asarray(mesh.faces), partner, nowhere)
    return partner


def _beside(faces, partner, nowhere) -> None:
    """Give these vertices (n,) the partner of a neighbour."""
    for corner, other in ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)):
        own, near = faces[:, corner], faces[:, other]
        at = nowhere[own] & ~nowhere[near]
        partner[own[at]] = partner[near[at]]
    known = np.flatnonzero(partner >= 0)
    rest = np.flatnonzero(partner < 0)
    place = np.minimum(np.searchsorted(known, rest), len(known) - 1)
    partner[rest] = partner[known[place]]


def kept(vertices, faces, partner, index, done) -> Repaired:
    """The part of a mesh with these vertices.

    Args:
        vertices, faces: all vertices, and the faces that are left.
        partner: (n,) the vertex that each became, in the old numbers.
        index: the vertices that are left, ascending.
        done: what was done.
    """
    renumber = np.full(len(vertices), -1, np.int32)
    renumber[index] = np.arange(len(index))
    mesh = Mesh(vertices[index], renumber[faces].astype(np.int32))
    return Repaired(mesh, index.astype(np.int32), renumber[partner], tuple(done))


def note(done: list[str], number: int, text: str) -> None:
    """Add what was done to `number` things; {vertices} becomes one or many."""
    if number:
        many = {"vertices": "vertex", "faces": "face", "components": "component"}
        words = {name: name if number > 1 else one for name, one in many.items()}
        done.append(f"{number} {text.format(**words)}")
