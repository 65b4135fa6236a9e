"""A mesh at rest for deformations that are solved with a sparse factor. Host side.

The energy is that of `jfsf.refine.deform`, but that there each cotangent is clipped,
here their sum at an edge. There products are jitted and the solve is by conjugate
gradients, for shapes of padded sizes. Here each solve is exact, which large
deformations and weak pulls need.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.geometry._surface import STIFFNESS_RANGE
from jfsf.refine._rotations import closest_rotations
from jfsf.spectral import operators
from jfsf.types import Mesh


class Rest(NamedTuple):
    """A shape at rest.

    mesh: mirrored where the map is to mirror.
    normal_sign: -1 where it is mirrored: its faces then are wound inward.
    edges: (e, 2), each of both ways.
    along: (e, 3), from the second vertex to the first.
    stiff: (e,) that of each in the Laplacian, clipped to be positive.
    laplacian: (n, n) sparse, of these.
    sums: (n, e) sparse, adds values of edges at their first vertex.
    """

    mesh: Mesh
    normal_sign: int
    edges: np.ndarray
    along: np.ndarray
    stiff: np.ndarray
    laplacian: sp.csc_matrix
    sums: sp.csr_matrix


def at_rest(mesh: Mesh, sign: int = 1) -> Rest:
    """A mesh to deform, mirrored in x where `sign` is -1."""
    n = len(mesh.vertices)
    vertices = mesh.vertices * np.array([sign, 1, 1])
    off_diagonal = -sp.coo_matrix(operators(mesh)[0])
    apart = off_diagonal.row != off_diagonal.col
    edges = np.stack([off_diagonal.row[apart], off_diagonal.col[apart]], 1)
    stiff = np.clip(off_diagonal.data[apart], *STIFFNESS_RANGE)
    places = edges[:, 0], np.arange(len(edges))
    sums = sp.csr_matrix((np.ones(len(edges)), places), (n, len(edges)))
    graph = sp.csr_matrix((stiff, edges.T), (n, n))
    laplacian = (sp.diags(sums @ stiff) - graph).tocsc()
    along = vertices[edges[:, 0]] - vertices[edges[:, 1]]
    rest = Mesh(vertices, mesh.faces)
    return Rest(rest, sign, edges, along, stiff, laplacian, sums)


def edges_of(rest: Rest, moved: np.ndarray) -> np.ndarray:
    """(e, 3) the edges of moved vertices, as `Rest.along`."""
    return moved[rest.edges[:, 0]] - moved[rest.edges[:, 1]]


def rotations_of(rest: Rest, moved: np.ndarray, rings: int = 0) -> np.ndarray:
    """(n, 3, 3), those that turn the edges at rest most nearly to where they are.

    Args:
        rest: the shape.
        moved: (n, 3) positions.
        rings: how often the edges of all neighbours are added to those of a vertex: the
            more, the larger the surroundings that turn together.
    """
    outer = edges_of(rest, moved)[:, :, None] * rest.along[:, None]
    spread = rest.sums @ (rest.stiff[:, None] * outer.reshape(-1, 9))
    for _ in range(rings):
        spread = spread + rest.sums @ spread[rest.edges[:, 1]]
    return closest_rotations(spread.reshape(-1, 3, 3))


def turned(rest: Rest, rotation: np.ndarray) -> np.ndarray:
    """(e, 3) the edges at rest, turned by the mean rotation of their ends."""
    mean = (rotation[rest.edges[:, 0]] + rotation[rest.edges[:, 1]]) / 2
    return np.einsum("eij,ej->ei", mean, rest.along)
