"""A mesh at rest for deformations that are solved with a sparse factor. Host side.

The energy is that of `jfsf.refine.deform`, but that there each cotangent is clipped,
here their sum at an edge. There products are jitted and the solve is by conjugate
gradients, for shapes of padded sizes. Here each solve is exact, which large
deformations and weak pulls need.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.geometry._surface import STIFFNESS_RANGE
from jfsf.spectral._laplacian import definite_solver, operators
from jfsf.types import Mesh

# The Newton steps end below this, and rows that have not come so far get an SVD.
PRECISION = 1e-10
MAX_STEPS = 25
# Rows that are nearer than this to having no single best rotation get an SVD.
DISTINCT = 1e-6
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


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


def rotated_edges(rest: Rest, rotation: np.ndarray) -> np.ndarray:
    """(e, 3) the edges at rest, rotated by the mean rotation of their ends."""
    mean = (rotation[rest.edges[:, 0]] + rotation[rest.edges[:, 1]]) / 2
    return np.einsum("eij,ej->ei", mean, rest.along)


def deformed(
    rest: Rest, solve: Callable, rotation: np.ndarray, scale: float, *pulls: np.ndarray
) -> np.ndarray:
    """(n, 3) positions of least energy for given rotations.

    Args:
        rest: the shape.
        solve: see `solver`.
        rotation: (n, 3, 3) of the surroundings of each vertex.
        scale: factor of the lengths at rest.
        pulls: (n, 3) each: places that draw the vertices, times how much they do.
    """
    ahead = scale * rotated_edges(rest, rotation)
    right = rest.sums @ (rest.stiff[:, None] * ahead)
    for pull in pulls:
        right = right + pull
    return solve(right)


def solver(rest: Rest, pull: np.ndarray) -> Callable:
    """Solves for positions where `pull` (n,) is how much each vertex is drawn."""
    return definite_solver(rest.laplacian + sp.diags(pull))


def fitted_scale(rest: Rest, moved: np.ndarray, rotation: np.ndarray) -> float:
    """The factor of the rotated edges at rest that fits the moved ones best."""
    ahead = rotated_edges(rest, rotation)
    best = np.sum(rest.stiff[:, None] * edges_of(rest, moved) * ahead)
    return float(best / np.sum(rest.stiff[:, None] * rest.along**2))


def follow(
    points: np.ndarray,
    rest: np.ndarray,
    moved: np.ndarray,
    rotation: np.ndarray,
    near: np.ndarray,
    away: np.ndarray,
) -> np.ndarray:
    """Where points go if each follows the rigid motions of some vertices.

    sum_j w_j (R_j (p - q_j) + m_j) for the point p, with weights w_j ~ 1 / away_j^2
    that sum to 1 (embedded deformation, Sumner et al., SIGGRAPH 2007, equation 1).

    Args:
        points: (n, 3) p.
        rest, moved: (c, 3) vertices of the coarse shape before, q, and after, m.
        rotation: (c, 3, 3) R of each.
        near, away: (n, k) vertices that a point follows, and how far they are.

    Returns:
        (n, 3).
    """
    weight = 1 / (away + 1e-6) ** 2
    weight /= weight.sum(1, keepdims=True)
    followed = np.zeros(points.shape)
    for one, share in zip(near.T, weight.T, strict=True):
        turned = np.einsum("nij,nj->ni", rotation[one], points - rest[one])
        followed += share[:, None] * (turned + moved[one])
    return followed


def closest_rotations(spread: np.ndarray) -> np.ndarray:
    """The rotation R of each matrix that makes the trace of R^T spread largest.

    That largest trace is a root of a quartic, and R a polynomial of the matrix and the
    root (Markley, Fast Optimal Attitude Matrix, J. Astronautical Sciences 41, 1993).
    It takes a quarter of the time of SVDs, which the rare matrices get that have
    several best rotations, or nearly so.

    Args:
        spread: (..., 3, 3), finite.
    """
    flat = spread.reshape(-1, 3, 3)
    size = np.sqrt(np.einsum("nij,nij->n", flat, flat))
    unit = flat / np.where(size > 0, size, 1)[:, None, None]
    matrix = np.ascontiguousarray(np.moveaxis(unit, 0, 2))  # the long axis last
    cofactor = matrix[NEXT][:, NEXT] * matrix[LAST][:, LAST]
    cofactor -= matrix[NEXT][:, LAST] * matrix[LAST][:, NEXT]
    det, square = np.sum(matrix[0] * cofactor[0], 0), np.sum(cofactor**2, (0, 1))
    # (trace^2 - 1)^2 - 8 det trace - 4 square = 0, from above its largest root.
    trace, step = np.full(len(det), np.sqrt(3.0)), np.ones(len(det))
    for _ in range(MAX_STEPS):
        more = trace**2 - 1
        slope = 4 * (more * trace - 2 * det)
        value = more**2 - 8 * det * trace - 4 * square
        step = value / np.where(slope > 0, slope, np.inf)
        trace = trace - step
        if np.abs(step).max(initial=0) < PRECISION:
            break
    half = (trace**2 - 1) / 2
    scale = half * trace - det
    clear = (scale > DISTINCT) & (np.abs(step) < PRECISION)
    cube = np.moveaxis(unit @ unit.swapaxes(1, 2) @ unit, 0, 2)
    rotation = (half + 1) * matrix + trace * cofactor - cube
    rotation = np.moveaxis(rotation / np.where(clear, scale, 1), 2, 0)
    if not clear.all():
        rotation[~clear] = _by_svd(flat[~clear])
    return rotation.reshape(spread.shape)


def _by_svd(spread: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(spread)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return left @ right
