"""What is wrong with a mesh: `check` reports it, `validate` refuses it. numpy only.

Faces that repeat a vertex have no proper edges: they are counted, then left out.
"""

from typing import Any, NamedTuple

import numpy as np

from jfsf.mesh._denoise import rounding
from jfsf.mesh._geometry import (
    HalfEdgePairs,
    component_volumes,
    components,
    face_areas,
    pair_half_edges,
    repeats_vertex,
    vertex_components,
)
from jfsf.mesh._values import MeshError, check_values, mesh_arrays
from jfsf.types import ArrayLike, Mesh

# Twice the area over the squared longest edge: below this, a face is a line. Collinear
# points come out near 1e-16; the thinnest triangles seen in scans near 1e-6.
_FLAT_FACE = 1e-12
# Area over the squared size of the bounding box: below this, a surface is a line.
_FLAT_SURFACE = 1e-12
# With coordinates rounded to this many edge lengths, and this share of faces without
# area, the shape is lost; the map of a body rounded so has an error of 0.6.
_LOST_STEP, _LOST_FACES = 0.5, 0.1
# What to do about several components.
ONE_COMPONENT = (
    "keep one with largest_component, match all with match_components, or join seams "
    "of coincident vertices with weld"
)


class Report(NamedTuple):
    """What `check` finds, in plain values. For a point cloud most of it is None.

    vertices, faces: numbers of both.
    components: pieces connected through shared vertices; a vertex without a face is not
        counted.
    boundary_edges, nonmanifold_edges: edges with one face; with three or more.
    nonmanifold_vertices: vertices where several fans of faces meet only in a point.
    unreferenced_vertices: vertices without a face.
    degenerate_faces: faces that repeat a vertex or have no area.
    duplicate_faces: faces with the vertices of an earlier face, in any order.
    closed: every edge has exactly two faces.
    consistent: no two faces run through an edge in the same direction; so it is False
        if an edge has three faces.
    outward: every piece encloses a positive volume; None unless closed and consistent,
        and if a piece encloses no volume.
    area, volume: in the units of the mesh; volume is None unless closed and consistent.
    coordinate_step: where coordinates were rounded far from the origin, and so coarsely
        that it harms the shape, the step between them over the mean edge length, see
        `rounding`; else None. For clouds too.
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
    coordinate_step: float | None = None

    def __str__(self) -> str:
        rounded = []
        if self.coordinate_step is not None:
            rounded.append(
                f"coordinates rounded to {self.coordinate_step:.0%} of an edge, far "
                "from the origin"
            )
        if self.faces == 0:
            return "\n".join([f"point cloud of {self.vertices} vertices", *rounded])
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
        counts = [f"{number} {name}" for name, number in flaws.items() if number]
        return "\n".join(lines + ([", ".join(counts)] if counts else []) + rounded)


def check(mesh: Mesh) -> Report:
    """Examine a mesh whose indices are in range and whose coordinates are finite.

    Args:
        mesh: n vertices, m faces; see `jfsf.mesh.validate` for bad values.

    Returns:
        The report; 0.3 s at 100 000 vertices.
    """
    vertices, faces = mesh_arrays(mesh)
    n, m = len(vertices), len(faces)
    coarse = rounding(mesh) if n else None
    step = None if coarse is None else coarse.step / coarse.edge
    if m == 0:
        return Report(n, 0, *[None] * (len(Report._fields) - 3), coordinate_step=step)
    used = np.zeros(n, bool)
    used[faces] = True
    component = vertex_components(faces, n)
    solid = faces[~repeats_vertex(faces)]
    pairs = pair_half_edges(solid, n)
    closed = len(solid) > 0 and bool((pairs.counts == 2).all())
    consistent = bool((pairs.counts <= 2).all() and not pairs.clash.any())
    volume = outward = None
    if closed and consistent:
        piece = components(len(solid), pairs.left // 3, pairs.right // 3)
        volumes, areas = component_volumes(vertices, solid, piece)
        volume = float(volumes.sum())
        if (np.abs(volumes) > 1e-9 * areas**1.5).all():
            outward = bool((volumes > 0).all())
    return Report(
        vertices=n,
        faces=m,
        components=len(np.unique(component[used])),
        boundary_edges=int((pairs.counts == 1).sum()),
        nonmanifold_edges=int((pairs.counts > 2).sum()),
        nonmanifold_vertices=int(pinched_vertices(solid, n, pairs).sum()),
        unreferenced_vertices=int(n - used.sum()),
        degenerate_faces=int(degenerate_faces(vertices, faces).sum()),
        duplicate_faces=_duplicates(faces),
        closed=closed,
        consistent=consistent,
        outward=outward,
        area=float(face_areas(vertices, faces).sum()),
        volume=volume,
        coordinate_step=step,
    )


def validate(
    mesh: Mesh, *, k: int | None = None, name: str = "mesh", components: bool = True
) -> None:
    """Raise MeshError if a map to or from this mesh would have no meaning.

    Call it once, on the way in: what follows relies on it. 0.1 s at 160 000 vertices.

    Args:
        mesh: n vertices, m faces; of a point cloud only the points are checked.
        k: eigenpairs that will be asked for, at most n.
        name: opens the message: the file or the argument.
        components: refuse more than one connected component.

    Raises:
        MeshError: wrong shapes or types, non-finite coordinates, indices out of range,
            fewer than k vertices, all vertices in one place, no area, coordinates
            rounded so coarsely that the shape is lost, vertices without a face, several
            components.
    """
    vertices, faces = mesh_arrays(mesh, name)
    check_values(vertices, faces, name)
    n = len(vertices)
    if k is not None and n < k:
        raise MeshError(
            f"has {n} vertices, fewer than the {k} eigenpairs asked for",
            "ask for fewer or subdivide the mesh",
            name,
        )
    # Centred and scaled without overflow: neither unit nor place matters here.
    low, high = vertices.min(axis=0) / 2, vertices.max(axis=0) / 2
    size = (high - low).max()
    if size == 0:
        raise MeshError(f"all {n} vertices coincide", "choose another shape", name)
    if len(faces) == 0:
        return
    if face_areas((vertices - (low + high)) / size, faces).sum() <= _FLAT_SURFACE:
        raise MeshError(f"the area of its {len(faces)} faces is 0", "repair it", name)
    coarse = rounding(mesh)
    if coarse is not None and coarse.step > _LOST_STEP * coarse.edge:
        lost = degenerate_faces(vertices, faces)
        if lost.mean() > _LOST_FACES:
            raise MeshError(f"{lost.sum()} faces have no area, and {coarse}", name=name)
    loose = np.ones(n, bool)
    loose[faces] = False
    if loose.any():
        first, others = np.argmax(loose), int(loose.sum()) - 1
        what, which = f"vertex {first} belongs to no face", "it"
        if others:
            many = f"{others} others" if others > 1 else "1 other"
            what, which = f"vertex {first} and {many} belong to no face", "them"
        advice = f"remove {which}, as without_strays and largest_component do"
        raise MeshError(what, advice, name)
    if not components:
        return
    pieces = vertex_components(faces, n).max() + 1
    if pieces > 1:
        raise MeshError(f"has {pieces} connected components", ONE_COMPONENT, name)


def pinched_vertices(faces: ArrayLike, n: int, pairs: HalfEdgePairs) -> Any:
    """Whether each vertex (n,) joins several fans of faces.

    Args:
        faces: (m, 3), none of which repeats a vertex.
        n: number of vertices.
        pairs: the half-edges of the faces.
    """

    # Two corners of one vertex are joined if their faces share an edge. Each component
    # of corners is a fan.
    def ends(half):
        return half, half - half % 3 + (half % 3 + 1) % 3

    (tail_l, head_l), (tail_r, head_r) = ends(pairs.left), ends(pairs.right)
    joined = (
        np.where(pairs.clash, tail_r, head_r),
        np.where(pairs.clash, head_r, tail_r),
    )
    fan = components(
        faces.size,
        np.concatenate([tail_l, head_l]),
        np.concatenate(joined),
    )
    owner = np.zeros(fan.max(initial=-1) + 1, np.int64)
    owner[fan] = faces.ravel()
    return np.bincount(owner, minlength=n) > 1


def degenerate_faces(vertices: ArrayLike, faces: ArrayLike) -> Any:
    """Whether each face (m,) repeats a vertex or has no area."""
    sides = vertices[faces] - vertices[np.roll(faces, -1, axis=1)]
    longest = (sides**2).sum(axis=2).max(axis=1)
    return 2 * face_areas(vertices, faces) <= _FLAT_FACE * longest


def _duplicates(faces):
    ordered = np.sort(faces, axis=1)
    ordered = ordered[np.lexsort(ordered.T)]
    return int((ordered[1:] == ordered[:-1]).all(axis=1).sum())
