"""Small holes closed with triangles between the vertices of their rims."""

import numpy as np

from jfsf.mesh._geometry import boundary_edges, face_areas, vertex_components
from jfsf.types import ArrayLike, Mesh

# Length of a rim that is closed, at most, in sqrt(area) of its component: the rim of a
# separate triangle or flake is no hole. The 20 holes of a body in
# experiments/accuracy/damage.py have 0.35; where an arm was cut it is about as much.
LONGEST = 0.4


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
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
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
