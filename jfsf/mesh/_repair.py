"""Mend a mesh on request, and say what was done; vertices keep track of their numbers.

Holes are left, and edges with three faces or more that are no fault of doubled faces:
there is more than one way to mend them.
"""

import numpy as np

from jfsf.mesh._check import degenerate_faces, pinched_vertices
from jfsf.mesh._denoise import without_spikes
from jfsf.mesh._edit import first_equal
from jfsf.mesh._faces import doubled_faces
from jfsf.mesh._geometry import (
    boundary_edges,
    edges,
    face_areas,
    pair_half_edges,
    repeats_vertex,
    vertex_components,
)
from jfsf.mesh._partners import Repaired, after, kept, note, without_nonfinite
from jfsf.mesh._values import MeshError
from jfsf.mesh._winding import orient
from jfsf.types import Mesh

# Of the area of the largest component: eyes and teeth of a body have 0.02 at most.
SMALL = 0.1
# Flat faces beside each other are mended one after the other.
FLAT_ROUNDS = 5


def repair(mesh: Mesh, *, small: float = SMALL, name: str = "mesh") -> Repaired:
    """Mend what can be mended in one way only; the mesh itself is left as it is.

    In this order: vertices whose coordinates are not finite are removed with their
    faces; vertices with equal coordinates are merged, but not those of surfaces
    that only touch: inside a surface (all around with faces) a vertex stays apart if
    an edge would get three faces or more, or the vertex a second fan of faces. Faces
    that repeat a vertex are removed, and of faces with the same vertices all but one.
    Both of two faces back to back are removed if one alone would be a fin, as on a flap
    at an edge of a closed surface: what is left then has fewer edges with one face, or
    three and more (flaps of more than 1 % of the area keep one). Spikes go to the
    median of their neighbours; faces without area are turned into their neighbours, or
    removed at a boundary; small components and vertices without a face are removed; the
    rest is wound outward, as `orient` does.

    Args:
        mesh: n vertices, m faces. Of a point cloud equal points are merged.
        small: components with less area than this share of the largest go; inf leaves
            the largest alone.
        name: opens the message of an error.

    Returns:
        The mesh with both index maps. A second repair finds nothing to do, but for
        rare spikes behind others.

    Raises:
        MeshError: wrong shapes or types, no finite coordinates, indices out of range,
            or no face that has an area.
    """
    known = without_nonfinite(mesh, name=name)
    vertices, faces = known.mesh
    if len(faces) == 0 and len(np.asarray(mesh.faces)):
        raise MeshError(
            "all its faces have a vertex that is not finite",
            "export the mesh again",
            name,
        )
    return after(known, _mended(vertices, faces, small, name))


def _mended(vertices, faces, small: float, name: str) -> Repaired:
    first, done = _merged(vertices, faces), []
    index = np.unique(first)
    note(done, len(vertices) - len(index), "duplicate {vertices} merged")
    if len(faces) == 0:
        return kept(vertices, faces, first, index, done)
    # Vertices keep their old numbers until the end.
    faces = first[faces].astype(np.int32)
    faces = _without(faces, repeats_vertex(faces), "{faces} with a vertex twice", done)
    copies = doubled_faces(vertices, faces)
    flap = ~copies.keep[copies.first]
    copy = ~copies.keep & ~flap
    faces = _without(faces, copy, "duplicate {faces}", done)
    faces = _without(faces, flap[~copy], "{faces} back to back", done)
    vertices = _flattened(vertices, faces, done)
    faces = _without_flat(vertices, faces, done)
    if len(faces) == 0:
        raise MeshError("none of its faces has an area", "export the mesh again", name)
    lone = len(index) - len(np.unique(faces))
    note(done, lone, "{vertices} without a face removed")
    faces = _without_small(vertices, faces, small, done)
    wound = orient(Mesh(vertices, faces)).faces
    note(done, int((wound != faces).any(axis=1).sum()), "{faces} turned over")
    return kept(vertices, wound, first, np.unique(wound), done)


def _without(faces, wrong, text: str, done):
    note(done, int(wrong.sum()), f"{text} removed")
    return faces[~wrong]


def _merged(vertices, faces):
    """The vertex (n,) that each becomes: the lowest one in the same place.

    Vertices inside a surface stay apart if merging them would join surfaces that only
    touch: some edge or vertex would no longer be manifold.
    """
    n = len(vertices)
    first = first_equal(vertices)
    if len(faces) == 0 or (first == np.arange(n)).all():
        return first
    inside = np.zeros(n, bool)
    inside[faces] = True
    inside[boundary_edges(faces)] = False
    shared = np.bincount(first, minlength=n)[first] > 1
    bad_edges, bad_vertices = _nonmanifold(faces, n)
    apart = np.zeros(n, bool)
    while True:
        # Those inside that stay apart are alone; the lowest of the others stands for
        # them.
        lowest = np.full(n, n)
        np.minimum.at(lowest, first[~apart], np.flatnonzero(~apart))
        to = np.where(apart, np.arange(n), lowest[first])
        now = to[faces]
        now = now[~repeats_vertex(now)]
        now = now[doubled_faces(vertices, now).keep]
        some_edges, some_vertices = _nonmanifold(now, n)
        # What was so before is not for want of merging.
        old = to[bad_edges].min(1) * n + to[bad_edges].max(1)
        key = some_edges.min(1) * n + some_edges.max(1)
        worse = np.zeros(n, bool)
        worse[some_edges[~np.isin(key, old)]] = True
        worse[some_vertices[~np.isin(some_vertices, to[bad_vertices])]] = True
        more = worse[to] & shared & inside & ~apart
        if not more.any():
            return to
        apart |= more


def _nonmanifold(faces, n: int):
    """Edges with three faces or more, and vertices with several fans."""
    solid = faces[~repeats_vertex(faces)]
    found = edges(solid)
    pinched = pinched_vertices(solid, n, pair_half_edges(solid, n))
    return found.ends[found.counts > 2], np.flatnonzero(pinched)


def _flattened(vertices, faces, done):
    flat = without_spikes(Mesh(vertices, faces)).vertices
    moved = (flat != vertices).any(axis=1)
    note(done, int(moved.sum()), "{vertices} moved from spikes")
    return flat


def _without_flat(vertices, faces, done):
    """Faces without area are turned into the neighbour across their longest side.

    To remove one alone would leave a slit: the middle one of its corners lies on that
    side, which then belongs to the neighbour only.
    """
    number = int(degenerate_faces(vertices, faces).sum())
    for _ in range(FLAT_ROUNDS):
        flat = np.flatnonzero(degenerate_faces(vertices, faces))
        if not len(flat):
            break
        faces = _turned(vertices, faces, flat)
    faces = faces[~degenerate_faces(vertices, faces)]
    note(done, number, "{faces} without area mended")
    return faces


def _turned(vertices, faces, flat):
    """Each of these flat faces split with its neighbour at its middle corner.

    A face takes part once, so some are left for another round.
    """
    faces, done = faces.copy(), np.zeros(len(faces), bool)
    solid = np.flatnonzero(~repeats_vertex(faces))
    pairs = pair_half_edges(faces[solid], len(vertices))
    left, right = pairs.left[pairs.manifold], pairs.right[pairs.manifold]
    across = np.full(3 * len(faces), -1)
    half = 3 * solid[:, None] + np.arange(3)
    left, right = half.ravel()[left], half.ravel()[right]
    across[left], across[right] = right // 3, left // 3
    sides = vertices[faces[flat]] - vertices[np.roll(faces[flat], -1, axis=1)]
    longest = (sides**2).sum(axis=2).argmax(axis=1)
    for face, side in zip(flat, longest, strict=True):
        other = across[3 * face + side]
        if other < 0 or done[face] or done[other]:
            continue
        start, end, middle = np.roll(faces[face], -side)
        whole = faces[other]
        faces[face] = np.where(whole == start, middle, whole)
        faces[other] = np.where(whole == end, middle, whole)
        done[[face, other]] = True
    return faces


def _without_small(vertices, faces, small: float, done):
    owner = vertex_components(faces, len(vertices))[faces[:, 0]]
    area = np.bincount(owner, face_areas(vertices, faces))
    keep = area >= small * area.max()
    keep[area.argmax()] = True
    lost = np.unique(owner[~keep[owner]])
    share = area[lost].sum() / area.sum()
    number = len(np.unique(faces[~keep[owner]]))
    note(
        done,
        len(lost),
        f"small {{components}} removed, {share:.2%} of the area and {number} vertices",
    )
    return faces[keep[owner]]
