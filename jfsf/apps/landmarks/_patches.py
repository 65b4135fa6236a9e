"""Points spread over the part of a surface within a rim."""

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from trimesh.remesh import subdivide

from jfsf.apps.landmarks._outlines import Outline
from jfsf.apps.landmarks._paths import at_shares, length_of
from jfsf.mesh import closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import (
    components,
    edge_graph,
    face_areas,
    pair_half_edges,
)
from jfsf.types import Mesh

# Vertices within a rim among which each point is chosen: then the grid they lie on
# moves a point by a tenth of the distance to the next. By hand.
_CHOICE = 100
_MOST_HALVINGS = 6  # of edges, to have so many
# Halvings of the step along a line between two faces that are not neighbours. Where it
# runs through a vertex they never are, and the faces there part the sides all the same.
_BETWEEN = 16


def spread(mesh: Mesh, rim: np.ndarray, one: Outline) -> np.ndarray:
    """Points spread over the part of a mesh within a rim.

    Distances are those of `_steps`, on edges that were halved until there is choice
    enough.

    Args:
        mesh: a surface.
        rim: points of a closed line on it.
        one: the patch.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    outside = None
    for _ in range(_MOST_HALVINGS + 1):
        crossed = _crossed(vertices, faces, rim)
        outside = _beyond(vertices, faces, crossed, outside)
        inner = np.setdiff1d(faces[~crossed & ~outside], faces[crossed])
        if len(inner) >= _CHOICE * one.number:
            break
        # The rest is far from the rim.
        near = ~outside | np.isin(faces, faces[crossed]).any(1)
        faces, outside = faces[near], outside[near]
        halves: Any = subdivide(vertices, faces, return_index=True)
        vertices, faces, of = halves
        halved = np.zeros(len(faces), bool)
        for old, new in of.items():
            halved[new] = outside[old]
        outside = halved
    else:
        raise ValueError(
            f"{one.name}: its rim surrounds no part of the surface with room for "
            f"{one.number} points; give its landmarks in their order along the rim"
        )
    faces = faces[~outside]
    far = np.full(len(vertices), -1.0)
    graph = _steps(vertices, faces)
    reach = dijkstra(graph, indices=np.unique(faces[crossed[~outside]]), min_only=True)
    far[inner] = reach[inner]
    chosen = []
    for _ in range(one.number):
        chosen.append(int(far.argmax()))
        nearer = dijkstra(graph, indices=chosen[-1], limit=far.max())
        far = np.minimum(far, nearer)
    return vertices[chosen]


def _steps(vertices, faces) -> csr_matrix:
    """Lengths of the edges, and of the lines from corner to corner across each.

    With these lines the shortest way is nearer to straight in all directions.
    """
    pairs = pair_half_edges(faces, len(vertices))
    # The corner opposite to a half-edge is the one before it.
    ends = np.roll(faces, 1, 1).ravel()[np.stack([pairs.left, pairs.right])]
    length = np.linalg.norm(vertices[ends[0]] - vertices[ends[1]], axis=1)
    shape = len(vertices), len(vertices)
    across = csr_matrix((length, (ends.min(0), ends.max(0))), shape)
    found = edge_graph(Mesh(vertices, faces)).maximum(across)
    return found + found.T


def _crossed(vertices, faces, rim) -> np.ndarray:
    """The faces that a line runs through, each next to the one before it."""
    kept = np.flatnonzero(face_areas(vertices, faces) > 0)
    corners = vertices[faces[kept]]
    step = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).mean()
    surface = surface_tree(Mesh(vertices, faces[kept]))
    of = lambda shares: kept[closest(surface, at_shares(rim, shares)).face]
    shares = np.linspace(0, 1, int(2 * length_of(rim) / step) + 2)
    face = of(shares)
    for _ in range(_BETWEEN):
        # Two corners in common are an edge, and a face has three with itself.
        one, two = faces[face[:-1], :, None], faces[face[1:], None]
        gap = np.flatnonzero((one == two).sum((1, 2)) < 2)
        if not len(gap):
            break
        middle = (shares[gap] + shares[gap + 1]) / 2
        shares = np.insert(shares, gap + 1, middle)
        face = np.insert(face, gap + 1, of(middle))
    crossed = np.zeros(len(faces), bool)
    crossed[face] = True
    return crossed


def _beyond(vertices, faces, crossed, outside) -> np.ndarray:
    """The faces beyond a wall of others.

    Args:
        vertices, faces: of the surface.
        crossed: the wall.
        outside: faces that are known to be so; None: those of the largest part.
    """
    pairs = pair_half_edges(faces, len(vertices))
    left, right = pairs.left // 3, pairs.right // 3
    free = ~(crossed[left] | crossed[right])
    part = components(len(faces), left[free], right[free])
    if outside is None:
        area = np.where(crossed, 0, face_areas(vertices, faces))
        return ~crossed & (part == np.bincount(part, area).argmax())
    return ~crossed & np.isin(part, part[outside & ~crossed])
