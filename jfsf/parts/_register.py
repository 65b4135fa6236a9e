"""The whole deformed onto the part, from a start that may be far off. Host side.

A part alone is a strip of surface that bends to anything, and what it should cover is
not known. The whole keeps its form, and every point of the part has a partner on it. So
a whole that is drawn to the part slides to the right place from starts that are off by
a tenth of the shape, and what is left apart then tells right starts from wrong ones.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from jfsf.geometry import STIFFNESS_RANGE
from jfsf.mesh import vertex_areas, vertex_normals
from jfsf.parts._settings import PartSettings
from jfsf.spectral import operators
from jfsf.types import Mesh

TINY = 1e-9  # of the pull: without any, what nothing draws could be anywhere


class Whole(NamedTuple):
    """A coarse shape at rest.

    mesh: mirrored where the map is to mirror, in the unit of its sqrt(area).
    normal_sign: -1 where it is mirrored.
    edges: (e, 2), each of both ways.
    along: (e, 3), from the second vertex to the first.
    stiff: (e,) that of each in the Laplacian, clipped to be positive.
    laplacian: (n, n) sparse, of these.
    sums: (n, e) sparse, adds values of edges at their first vertex.
    outward: (n, 3), tangents out of the surface on its boundary; else 0.
    """

    mesh: Mesh
    normal_sign: int
    edges: np.ndarray
    along: np.ndarray
    stiff: np.ndarray
    laplacian: sp.csc_matrix
    sums: sp.csr_matrix
    outward: np.ndarray


class Registered(NamedTuple):
    """The whole on the part.

    moved: (n, 3) positions of its vertices.
    rotation: (n, 3, 3), of the surroundings of each.
    scale: factor of its lengths.
    T: (p,) the vertex of the whole nearest to each point of the part.
    residual: root mean square distance of what it covers.
    energy: of the deformation, see `jfsf.refine.deform`, at the size of the whole.
    share: of the part's area that it covers.
    """

    moved: np.ndarray
    rotation: np.ndarray
    scale: float
    T: np.ndarray
    residual: float
    energy: float
    share: float


def whole_at_rest(mesh: Mesh, outward, sign: int = 1) -> Whole:
    """A whole to register, mirrored where `sign` is -1.

    Args:
        mesh: one piece, wound outward, in the unit of its sqrt(area).
        outward: (n, 3), see `Whole`.
        sign: 1 or -1.
    """
    flip, n = np.array([sign, 1, 1]), len(mesh.vertices)
    vertices = mesh.vertices * flip
    off_diagonal = -sp.coo_matrix(operators(mesh)[0])
    apart = off_diagonal.row != off_diagonal.col
    edges = np.stack([off_diagonal.row[apart], off_diagonal.col[apart]], 1)
    stiff = np.clip(off_diagonal.data[apart], *STIFFNESS_RANGE)
    places = edges[:, 0], np.arange(len(edges))
    sums = sp.csr_matrix((np.ones(len(edges)), places), (n, len(edges)))
    graph = sp.csr_matrix((stiff, edges.T), (n, n))
    laplacian = (sp.diags(sums @ stiff) - graph).tocsc()
    along = vertices[edges[:, 0]] - vertices[edges[:, 1]]
    return Whole(
        Mesh(vertices, mesh.faces),
        *(sign, edges, along, stiff, laplacian, sums, outward * flip),
    )


def register(
    whole: Whole,
    part: Mesh,
    T,
    *,
    settings: PartSettings = PartSettings(),
) -> Registered:
    """The whole drawn to the part, stiff at first and softer step by step.

    Each step takes the energy of `jfsf.refine.deform` down, where a vertex of the whole
    is drawn to the mean of the points of the part that it is nearest to, by position
    and normal. What lies beyond the boundary of an open whole does not draw it.

    Args:
        whole: at rest.
        part: about as large as the whole has it.
        T: the start: the vertex of the whole for each vertex of the part.
        settings: `first_reach`, `reaches` and what follows these.
    """
    at, normal, mass = part.vertices, vertex_normals(*part), vertex_areas(*part)
    points = np.concatenate([at, settings.registered_normal_weight * normal], 1)
    edge = whole.outward.any(1)
    scale, covered = 1.0, np.ones(len(at), bool)
    moved = _placed(whole.mesh.vertices, at, mass, T)
    away, turned = np.zeros(len(at)), whole.along
    rotation = np.broadcast_to(np.eye(3), (len(moved), 3, 3))
    for step, reach in enumerate((settings.first_reach, *settings.reaches)):
        goal, pull = _drawn_to(part, mass, covered, T, len(moved), reach, settings)
        solve = splu((whole.laplacian + sp.diags(pull + TINY)).tocsc()).solve
        for _ in range(settings.updates if step else settings.first_updates):
            turned = scale * _turned(whole, rotations_of(whole, moved))
            moved = solve(whole.sums @ (whole.stiff[:, None] * turned) + goal)
        rotation = rotations_of(whole, moved)
        turned = _turned(whole, rotation)
        best = np.sum(whole.stiff[:, None] * _edges(whole, moved) * turned)
        best /= np.sum(whole.stiff[:, None] * whole.along**2)
        scale = (scale + float(np.clip(best, 0.5, 2))) / 2
        normals = whole.normal_sign * vertex_normals(moved, whole.mesh.faces)
        weighted = settings.registered_normal_weight * normals
        found = KDTree(np.concatenate([moved, weighted], 1)).query(points)
        away, T = map(np.asarray, found)
        if edge.any():
            outward = np.einsum("pij,pj->pi", rotation[T], whole.outward[T])
            beyond = np.sum((at - moved[T]) * outward, 1) > 0
            near = away < settings.covered_distance + reach
            covered = near & ~(beyond & (reach <= settings.trimmed_reach))
    share = mass @ covered / mass.sum()
    residual = np.sqrt((mass * covered) @ away**2 / max(mass @ covered, 1e-12))
    bent = np.sum((_edges(whole, moved) - scale * turned) ** 2, 1)
    energy = float(whole.stiff @ bent) / 2 / scale**2
    return Registered(
        *(moved, rotation, scale, T, float(residual), energy, float(share))
    )


def rotations_of(whole: Whole, moved: np.ndarray) -> np.ndarray:
    """(n, 3, 3), those that turn the edges at rest most nearly to where they are."""
    outer = _edges(whole, moved)[:, :, None] * whole.along[:, None]
    spread = whole.sums @ (whole.stiff[:, None] * outer.reshape(-1, 9))
    return _closest_rotations(spread.reshape(-1, 3, 3))


def _closest_rotations(spread: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(spread)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return left @ right


def _edges(whole: Whole, moved: np.ndarray) -> np.ndarray:
    return moved[whole.edges[:, 0]] - moved[whole.edges[:, 1]]


def _turned(whole: Whole, rotation: np.ndarray) -> np.ndarray:
    """The edges at rest, turned by the mean rotation of their ends."""
    mean = (rotation[whole.edges[:, 0]] + rotation[whole.edges[:, 1]]) / 2
    return np.einsum("eij,ej->ei", mean, whole.along)


def _drawn_to(part: Mesh, mass, covered, T, n: int, reach: float, settings):
    """Sums of what draws each vertex of the whole, and how much that is."""
    weight = mass * np.where(covered, 1, settings.uncovered_weight) / reach**2
    goal = np.zeros((n, 3))
    np.add.at(goal, T, weight[:, None] * part.vertices)
    return goal, np.bincount(T, weight, n)


def _placed(vertices, points, mass, T) -> np.ndarray:
    """The whole moved rigidly to where the start has it."""
    middle, there = (mass @ v / mass.sum() for v in (vertices[T], points))
    spread = (points - there).T @ ((vertices[T] - middle) * mass[:, None])
    return (vertices - middle) @ _closest_rotations(spread).T + there
