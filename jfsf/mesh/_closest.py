"""The point of a surface nearest to each of many points (numpy, scipy).

Faces are cut into pieces of at most one radius, and the centres of these are in a k-d
tree. A piece whose centre is farther from a point than the best distance so far plus
the radius holds no nearer point.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh._geometry import edge_keys, face_normals
from jfsf.mesh._values import MeshError, mesh_arrays
from jfsf.types import ArrayLike, Mesh

FIRST = 12  # centres of pieces that are tried first; more change the time only
PIECES = 4  # a face, on average, at most
PAIRS = 1_000_000  # of a point and a face, at a time


class OnSurface(NamedTuple):
    """The nearest allowed point of a surface for each of q points.

    face: (q,) the face that the nearest point lies on; -1 where none was allowed.
    barycentric: (q, 3) barycentric coordinates on that face; nan where none was
        allowed.
    position: (q, 3) coordinates of the nearest point.
    distance: (q,) distance to it, in the unit of the mesh; inf where none was allowed.
    """

    face: ArrayLike
    barycentric: ArrayLike
    position: ArrayLike
    distance: ArrayLike


class SurfaceTree(NamedTuple):
    """A surface whose nearest points can be asked for.

    mesh: the mesh.
    normal: (m, 3) unit normals of its faces, 0 for a face without an area.
    rim: (m, 3) whether the edge opposite to each corner has one face only.
    rim_vertex: (n,) whether a vertex is at the end of such an edge.
    owner: (p,) the face of each piece.
    centre: (p, 3) of each piece.
    radius: no point of a piece is farther from its centre.
    tree: of the centres.
    """

    mesh: Mesh
    normal: ArrayLike
    rim: ArrayLike
    rim_vertex: ArrayLike
    owner: ArrayLike
    centre: ArrayLike
    radius: float
    tree: KDTree


class FacingTree(NamedTuple):
    """A surface whose nearest points that face alike can be asked for.

    surface: the surface.
    vertex_normal: (n, 3) normals of its vertices, wound alike.
    normal: (m, 3) unit normals of its faces: the mean of those of the corners.
    weight: of the normals in the tree.
    tree: of the centres of the pieces, and the weighted normals.
    """

    surface: SurfaceTree
    vertex_normal: ArrayLike
    normal: ArrayLike
    weight: float
    tree: KDTree


def surface_tree(mesh: Mesh) -> SurfaceTree:
    """Prepare a surface for `closest`.

    Args:
        mesh: with faces.

    Raises:
        MeshError: a point cloud, or faces that are single points.
    """
    vertices, faces = mesh_arrays(mesh)
    vertices = vertices.astype(float)
    if len(faces) == 0:
        raise MeshError("the mesh has no faces", "triangulate it", "surface_tree")
    corner = vertices[faces]
    middle = corner.mean(1)
    reach = np.linalg.norm(corner - middle[:, None], axis=2).max(1)
    if not reach.any():
        raise MeshError(
            "its faces are single points", "repair the mesh", "surface_tree"
        )
    radius = np.median(reach[reach > 0])
    while (np.ceil(reach / radius) ** 2).sum() > PIECES * len(faces):
        radius *= 1.5
    parts = np.maximum(np.ceil(reach / radius), 1).astype(int)
    owner, centre = [], []
    for number in np.unique(parts):
        which = np.flatnonzero(parts == number)
        weight = middles(number)
        owner.append(np.repeat(which, len(weight)))
        centre.append(np.einsum("wc,fcd->fwd", weight, corner[which]).reshape(-1, 3))
    owner, centre = np.concatenate(owner), np.concatenate(centre)
    normal = face_normals(vertices, faces)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    rim, rim_vertex = _rims(faces, len(vertices))
    return SurfaceTree(
        Mesh(vertices, faces),
        *(normal / np.where(size > 0, size, 1), rim, rim_vertex),
        *(owner, centre, float(radius), KDTree(centre)),
    )


def closest(surface: SurfaceTree, points: ArrayLike) -> OnSurface:
    """The nearest point of the surface for each point, exactly.

    Args:
        surface: what `surface_tree` makes of a mesh.
        points: (q, 3) finite coordinates, in the unit of that mesh.

    Returns:
        The nearest points and their distances. Between equal distances the choice is
        arbitrary.
    """
    points = np.asarray(points, float)
    k = min(FIRST, len(surface.owner))
    away, piece = surface.tree.query(points, np.arange(1, k + 1))
    row = np.repeat(np.arange(len(points)), k)
    found = nearest_of(surface, points, row, surface.owner[piece.ravel()])
    reach = found.distance * (1 + 1e-12) + surface.radius
    rest = np.flatnonzero((away[:, -1] <= reach) & (k < len(surface.owner)))
    if len(rest):
        near = surface.tree.query_ball_point(points[rest], reach[rest])
        count = np.array([len(one) for one in near])
        pieces = np.concatenate([np.asarray(one, int) for one in near])
        more = nearest_of(
            surface,
            points[rest],
            np.repeat(np.arange(len(rest)), count),
            surface.owner[pieces],
        )
        for old, new in zip(found, more, strict=True):
            old[rest] = new
    return found


def nearest_of(
    surface: SurfaceTree, points: ArrayLike, row: ArrayLike, face: ArrayLike
) -> OnSurface:
    """The nearest point on some faces only.

    Args:
        surface: `surface_tree`.
        points: (q, 3).
        row, face: (c,) pairs of a point and a face, in the order of the points.
    """
    q = len(points)
    found = OnSurface(
        np.full(q, -1),
        np.full((q, 3), np.nan),
        np.full((q, 3), np.nan),
        np.full(q, np.inf),
    )
    vertices, faces = surface.mesh
    for at in np.array_split(np.arange(len(row)), max(1, -(-len(row) // PAIRS))):
        rows, candidates = row[at], face[at]
        corner = vertices[faces[candidates]]
        bary = _on_triangle(points[rows], corner)
        place = np.einsum("pc,pcd->pd", bary, corner)
        away = np.linalg.norm(points[rows] - place, axis=1)
        best = np.lexsort((away, rows))
        best = best[np.diff(rows[best], prepend=-1) > 0]
        best = best[away[best] < found.distance[rows[best]]]
        to = rows[best]
        found.face[to], found.barycentric[to] = candidates[best], bary[best]
        found.position[to], found.distance[to] = place[best], away[best]
    return found


def facing_tree(
    surface: SurfaceTree, vertex_normal: ArrayLike, weight: float
) -> FacingTree:
    """Prepare a surface for `facing`.

    Args:
        surface: `surface_tree`.
        vertex_normal: (n, 3) normals of its vertices, wound alike.
        weight: distance that unit normals at an angle of 1 count for.
    """
    mean = vertex_normal[surface.mesh.faces].sum(1)
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    normal = mean / np.where(size > 0, size, 1)
    points = np.hstack([surface.centre, weight * normal[surface.owner]])
    return FacingTree(surface, vertex_normal, normal, weight, KDTree(points))


def facing(
    tree: FacingTree,
    points: ArrayLike,
    normal: ArrayLike,
    *,
    candidates: int,
    min_alike: float,
) -> OnSurface:
    """The nearest point of the surface that faces alike, for each point.

    Args:
        tree: `facing_tree`.
        points: (q, 3), finite.
        normal: (q, 3) unit normals.
        candidates: pieces of the surface that are looked at for each point.
        min_alike: the cosine between the normals is above this.

    Returns:
        Where it lies, and how far away; the face is -1 where no candidate faces alike.
    """
    surface = tree.surface
    k = min(candidates, len(surface.owner))
    queries = np.hstack([points, tree.weight * normal])
    piece = np.asarray(tree.tree.query(queries, np.arange(1, k + 1))[1]).ravel()
    row, face = np.repeat(np.arange(len(points)), k), surface.owner[piece]
    alike = np.einsum("pd,pd->p", tree.normal[face], normal[row]) > min_alike
    return nearest_of(surface, points, row[alike], face[alike])


def nearest_vertices(points: Mesh, queries: Mesh) -> np.ndarray:
    """(q,) int32, the vertex of `points` nearest to each vertex of `queries`."""
    near = KDTree(points.vertices).query(queries.vertices)[1]
    return np.asarray(near, np.int32)


def on_rim(surface: SurfaceTree, found: OnSurface) -> Any:
    """(q,) whether each point lies on an edge with one face only, or its end."""
    face = np.maximum(found.face, 0)
    zero = ~(found.barycentric > 1e-9)
    at_edge = (zero & surface.rim[face]).any(1) & (zero.sum(1) == 1)
    corner = np.argmax(np.nan_to_num(found.barycentric), 1)
    vertex = surface.mesh.faces[face, corner]
    at_vertex = (zero.sum(1) == 2) & surface.rim_vertex[vertex]
    return (at_edge | at_vertex) & (found.face >= 0)


def middles(parts: int):
    """(parts^2, 3) barycentric centres of the triangles that a triangle is cut into."""
    i, j = np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij")
    up = np.stack([i, j], 2)[i + j < parts] + 1 / 3
    down = np.stack([i, j], 2)[i + j < parts - 1] + 2 / 3
    two = np.concatenate([up, down]) / parts
    return np.concatenate([1 - two.sum(1, keepdims=True), two], 1)


def _rims(faces, n: int):
    """Whether the edge opposite to each corner has one face, and each vertex's."""
    # Half-edge 3 f + i runs from corner i to the next, opposite to the one after it.
    _, edge, count = np.unique(
        edge_keys(faces, n), return_inverse=True, return_counts=True
    )
    alone = (count == 1)[edge.ravel()].reshape(-1, 3)
    vertex = np.zeros(n, bool)
    vertex[faces[alone]] = vertex[np.roll(faces, -1, 1)[alone]] = True
    return np.roll(alone, -1, 1), vertex


def _on_triangle(points, corner):
    """(p, 3) barycentric coordinates of the nearest point of each triangle."""
    a = corner[:, 0]
    one, two, to = corner[:, 1] - a, corner[:, 2] - a, points - a
    dot = lambda u, v: np.einsum("pd,pd->p", u, v)
    g11, g12, g22 = dot(one, one), dot(one, two), dot(two, two)
    p1, p2 = dot(to, one), dot(to, two)
    det = g11 * g22 - g12**2
    flat = det <= 1e-14 * g11 * g22
    safe = np.where(flat, 1, det)
    s, t = (g22 * p1 - g12 * p2) / safe, (g11 * p2 - g12 * p1) / safe
    inside = ~flat & (s >= 0) & (t >= 0) & (s + t <= 1)

    def along(product, square):
        return np.clip(product / np.where(square > 0, square, 1), 0, 1)

    on_one, on_two = along(p1, g11), along(p2, g22)
    across = along(p2 - p1 + g11 - g12, g11 - 2 * g12 + g22)
    zero = np.zeros_like(s)
    best_s, best_t, least = s, t, np.where(inside, -np.inf, np.inf)
    for on_s, on_t in ((on_one, zero), (zero, on_two), (1 - across, across)):
        value = on_s * (on_s * g11 - 2 * p1) + on_t * (on_t * g22 - 2 * p2)
        value += 2 * on_s * on_t * g12
        better = value < least
        best_s, best_t = np.where(better, on_s, best_s), np.where(better, on_t, best_t)
        least = np.where(better, value, least)
    return np.stack([np.maximum(1 - best_s - best_t, 0), best_s, best_t], 1)
