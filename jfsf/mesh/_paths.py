"""Shortest paths along the edges of a mesh."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from jfsf.mesh._geometry import edges
from jfsf.types import ArrayLike, Mesh


def edge_graph(mesh: Mesh) -> sp.csr_matrix:
    """The lengths (n, n) of the edges, each in one direction."""
    vertices, n = np.asarray(mesh.vertices), len(mesh.vertices)
    one, two = edges(mesh.faces).ends.T
    length = np.linalg.norm(vertices[one] - vertices[two], axis=1)
    return sp.csr_matrix((length, (one, two)), (n, n))


def farthest_vertices(mesh: Mesh, num: int, *, start: int = 0) -> ArrayLike:
    """Vertices (num,), each the farthest along edges from those before it.

    Args:
        mesh: n vertices, one connected component.
        num: n or fewer.
        start: the first of them.
    """
    graph = edge_graph(mesh)
    far, chosen = np.full(len(mesh.vertices), np.inf), [start]
    while len(chosen) < num:
        # Vertices beyond the limit cannot come closer, so the search is local.
        reach = {"limit": far.max(), "indices": chosen[-1], "directed": False}
        far = np.minimum(far, dijkstra(graph, **reach))
        chosen.append(int(far.argmax()))
    return np.array(chosen)
