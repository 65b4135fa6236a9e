"""What is wrong with a mesh: connectivity, manifoldness, winding. Host side (numpy).

Half-edge 3 f + i runs from corner i of face f to the next corner. Faces that repeat a
vertex have no edges worth the name, so they are counted and then left out.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jfsf.types import ArrayLike, Mesh

# Twice the area over the squared longest edge: below this, a face is a line. Collinear
# points come out near 1e-16; the thinnest triangles seen in scans near 1e-6.
_FLAT = 1e-12


class Report(NamedTuple):
    """The health of a mesh, in plain values. A point cloud has None for every answer.

    vertices, faces: how many.
    components: pieces connected through shared vertices; a vertex alone is none.
    boundary_edges, nonmanifold_edges: edges with one face; with three or more.
    nonmanifold_vertices: vertices where several fans of faces meet only in a point.
    unreferenced_vertices: vertices without a face.
    degenerate_faces: faces that repeat a vertex or have no area.
    duplicate_faces: faces with the vertices of an earlier face, in any order.
    closed: every edge has exactly two faces.
    consistent: no two faces run through an edge in the same direction; so False where
        an edge has three faces.
    outward: every piece encloses a positive volume; None unless closed and consistent,
        and where a piece encloses nothing.
    area, volume: in the file's units; volume is None unless closed and consistent.
    """

    vertices: int
    faces: int
    components: int | None
    boundary_edges: int | None
    nonmanifold_edges: int | None
    nonmanifold_vertices: int | None
    unreferenced_vertices: int | None
    degenerate_faces: int | None
    duplicate_faces: int | None
    closed: bool | None
    consistent: bool | None
    outward: bool | None
    area: float | None
    volume: float | None

    def __str__(self) -> str:
        if self.faces == 0:
            return f"point cloud of {self.vertices} vertices"
        facing = {True: ", outward", False: ", inward", None: ""}[self.outward]
        lines = [
            f"{self.vertices} vertices, {self.faces} faces, "
            f"{self.components} component{'' if self.components == 1 else 's'}",
            f"{'closed' if self.closed else 'open'}, wound "
            f"{'consistently' if self.consistent else 'inconsistently'}{facing}",
            f"area {self.area:.6g}"
            + ("" if self.volume is None else f", volume {self.volume:.6g}"),
        ]
        flaws = {
            "boundary edges": self.boundary_edges,
            "non-manifold edges": self.nonmanifold_edges,
            "non-manifold vertices": self.nonmanifold_vertices,
            "unreferenced vertices": self.unreferenced_vertices,
            "degenerate faces": self.degenerate_faces,
            "duplicate faces": self.duplicate_faces,
        }
        found = [f"{number} {name}" for name, number in flaws.items() if number]
        return "\n".join(lines + ([", ".join(found)] if found else []))


class Links(NamedTuple):
    """Which half-edges lie on one edge.

    counts: (e,) faces of each undirected edge.
    left, right: (p,) pairs of half-edges on one edge; an edge with c faces gives a
        chain of c - 1 pairs.
    manifold: (p,) whether the pair's edge has two faces only.
    clash: (p,) whether both run in the same direction.
    """

    counts: ArrayLike
    left: ArrayLike
    right: ArrayLike
    manifold: ArrayLike
    clash: ArrayLike


def check(mesh: Mesh) -> Report:
    """Examine a mesh whose indices are in range and whose coordinates are finite.

    Args:
        mesh: n vertices, m faces; see `jfsf.mesh.validate` for bad values.

    Returns:
        The report; 0.3 s at 100 000 vertices.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    n, m = len(vertices), len(faces)
    if m == 0:
        return Report(n, 0, *[None] * (len(Report._fields) - 2))
    used = np.zeros(n, bool)
    used[faces] = True
    pair = vertex_components(mesh)
    solid = faces[~repeats(faces)]
    links = edge_links(solid, n)
    closed = len(solid) > 0 and bool((links.counts == 2).all())
    consistent = bool((links.counts <= 2).all() and not links.clash.any())
    volume = outward = None
    if closed and consistent:
        piece = _components(len(solid), links.left // 3, links.right // 3)
        volumes, areas = piece_volumes(vertices, solid, piece)
        volume = float(volumes.sum())
        if (np.abs(volumes) > 1e-9 * areas**1.5).all():
            outward = bool((volumes > 0).all())
    return Report(
        vertices=n,
        faces=m,
        components=len(np.unique(pair[used])),
        boundary_edges=int((links.counts == 1).sum()),
        nonmanifold_edges=int((links.counts > 2).sum()),
        nonmanifold_vertices=_pinched(solid, links),
        unreferenced_vertices=int(n - used.sum()),
        degenerate_faces=int(_degenerate(vertices, faces).sum()),
        duplicate_faces=_duplicates(faces),
        closed=closed,
        consistent=consistent,
        outward=outward,
        area=float(face_areas(vertices, faces).sum()),
        volume=volume,
    )


def face_areas(vertices: ArrayLike, faces: ArrayLike) -> Any:
    """Areas of the faces, (m,) float64."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def vertex_components(mesh: Mesh) -> Any:
    """Label (n,) of the connected piece of each vertex, counted from 0."""
    faces = np.asarray(mesh.faces)
    return _components(len(mesh.vertices), faces, np.roll(faces, -1, axis=1))


def repeats(faces: ArrayLike) -> Any:
    """Whether each face (m,) names a vertex twice."""
    return (faces == np.roll(faces, -1, axis=1)).any(axis=1)


def edge_links(faces: ArrayLike, n: int) -> Links:
    """Pair up the half-edges of `faces`, none of which may repeat a vertex."""
    tail = faces.ravel().astype(np.int64)
    head = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    key = np.minimum(tail, head) * n + np.maximum(tail, head)
    order = np.argsort(key, kind="stable")
    key = key[order]
    counts = np.diff(np.flatnonzero(np.diff(key, prepend=-1)), append=len(key))
    mates = np.flatnonzero(key[1:] == key[:-1])
    left, right = order[mates], order[mates + 1]
    manifold = np.repeat(counts, counts)[mates] == 2
    return Links(counts, left, right, manifold, tail[left] == tail[right])


def piece_volumes(vertices: ArrayLike, faces: ArrayLike, piece: ArrayLike) -> Any:
    """Signed volume and area of each piece of a surface.

    An open piece is closed by a cone to its centroid, so the volume of a scan with
    holes still has the right sign.

    Args:
        vertices: (n, 3).
        faces: (m, 3), each piece wound consistently.
        piece: (m,) the piece of each face, counted from 0.

    Returns:
        (p,) volumes, positive where the winding faces outward, and (p,) areas.
    """
    corners = vertices[faces]
    weight = face_areas(vertices, faces)
    area = np.bincount(piece, weight)
    centre = [
        np.bincount(piece, weight * x) / np.where(area > 0, area, 1)
        for x in corners.mean(axis=1).T
    ]
    a, b, c = np.moveaxis(corners - np.stack(centre, 1)[piece][:, None], 1, 0)
    return np.bincount(piece, (a * np.cross(b, c)).sum(axis=1) / 6), area


def _components(size, left, right):
    left, right = np.ravel(left), np.ravel(right)
    graph = coo_array((np.ones(len(left), bool), (left, right)), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def _pinched(faces, links):
    # Corners of one vertex are joined where their faces share an edge; a vertex whose
    # corners stay apart holds several fans.
    def ends(half):
        return half, half - half % 3 + (half % 3 + 1) % 3

    (tail_l, head_l), (tail_r, head_r) = ends(links.left), ends(links.right)
    joined = (
        np.where(links.clash, tail_r, head_r),
        np.where(links.clash, head_r, tail_r),
    )
    fan = _components(
        faces.size,
        np.concatenate([tail_l, head_l]),
        np.concatenate(joined),
    )
    owner = np.zeros(fan.max(initial=-1) + 1, np.int64)
    owner[fan] = faces.ravel()
    return int((np.bincount(owner) > 1).sum())


def _degenerate(vertices, faces):
    sides = vertices[faces] - vertices[np.roll(faces, -1, axis=1)]
    longest = (sides**2).sum(axis=2).max(axis=1)
    return 2 * face_areas(vertices, faces) <= _FLAT * longest


def _duplicates(faces):
    ordered = np.sort(faces, axis=1)
    ordered = ordered[np.lexsort(ordered.T)]
    return int((ordered[1:] == ordered[:-1]).all(axis=1).sum())
