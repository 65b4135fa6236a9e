"""The whole deformed onto the part, from a start that may be far off. Host side.

A part alone is a strip of surface that bends to anything, and what it should cover is
not known. The whole keeps its form, and every point of the part has a partner on it. So
a whole that is drawn to the part slides to the right place from starts that are off by
a tenth of the shape, and what is left apart then tells right starts from wrong ones.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from jfsf.matching.parts._settings import PartSettings
from jfsf.mesh import vertex_areas, vertex_normals
from jfsf.refine._rest import (
    Rest,
    at_rest,
    closest_rotations,
    edges_of,
    rotated_edges,
    rotations_of,
)
from jfsf.spectral._laplacian import definite_solver
from jfsf.types import Mesh

TINY = 1e-9  # of the pull: without any, what nothing draws could be anywhere


class Whole(NamedTuple):
    """A coarse shape at rest, in the unit of its sqrt(area).

    rest: see `Rest`.
    outward: (n, 3), tangents out of the surface on its boundary; else 0.
    """

    rest: Rest
    outward: np.ndarray

    @property
    def mesh(self) -> Mesh:
        """Mirrored where the map is to mirror."""
        return self.rest.mesh


class Registered(NamedTuple):
    """The whole on the part.

    moved: (n, 3) positions of its vertices.
    rotation: (n, 3, 3), of the surroundings of each.
    scale: factor of its lengths.
    T: (p,) the vertex of the whole nearest to each point of the part.
    residual: root mean square distance of what it covers, by position, normal and
        curvature.
    energy: of the deformation, see `jfsf.refine.deform`, at the size of the whole.
    covered: (p,) bool, the points of the part that it covers: all, if it is closed.
    share: of the part's area that it covers.
    """

    moved: np.ndarray
    rotation: np.ndarray
    scale: float
    T: np.ndarray
    residual: float
    energy: float
    covered: np.ndarray
    share: float


def whole_at_rest(mesh: Mesh, outward, sign: int = 1) -> Whole:
    """A whole to register, mirrored where `sign` is -1.

    Args:
        mesh: one piece, wound outward, in the unit of its sqrt(area).
        outward: (n, 3), see `Whole`.
        sign: 1 or -1.
    """
    return Whole(at_rest(mesh, sign), outward * np.array([sign, 1, 1]))


def register(
    whole: Whole,
    part: Mesh,
    T,
    known=None,
    *,
    curvature: tuple[np.ndarray, np.ndarray] | None = None,
    settings: PartSettings = PartSettings(),
) -> Registered:
    """The whole drawn to the part, stiff at first and softer step by step.

    Each step takes the energy of `jfsf.refine.deform` down, where a vertex of the whole
    is drawn to the mean of the points of the part that it is nearest to, by position,
    normal and curvature. What lies beyond the boundary of an open whole does not draw
    it.

    Args:
        whole: at rest.
        part: about as large as the whole has it.
        T: the start: the vertex of the whole for each vertex of the part.
        known: (p,) bool, where the start is to be trusted: the other points neither
            place nor draw an open whole in the first step. None for all.
        curvature: (p, c) of the part and (n, c) of the whole, see
            `jfsf.matching.parts._curvature`; None compares positions and normals only.
        settings: `first_reach`, `reaches` and what follows these.
    """
    at, normal, mass = part.vertices, vertex_normals(*part), vertex_areas(*part)
    none = (np.zeros((len(v), 0)) for v in (at, whole.mesh.vertices))
    unlike = 0.0 if curvature is None else settings.registered_curvature_weight
    of_part, of_whole = (unlike * values for values in curvature or none)
    columns = at, settings.registered_normal_weight * normal, of_part
    points = np.concatenate(columns, 1)
    edge = whole.outward.any(1)
    scale, covered = 1.0, np.ones(len(at), bool)
    if edge.any() and known is not None and np.any(known):
        covered = np.asarray(known)
    moved = _placed(whole.mesh.vertices, at, mass * covered, T)
    rest = whole.rest
    away = np.zeros(len(at))
    rotation = np.broadcast_to(np.eye(3), (len(moved), 3, 3))
    ahead = rest.along
    for step, reach in enumerate((settings.first_reach, *settings.reaches)):
        goal, pull = _drawn_to(part, mass, covered, T, len(moved), reach, settings)
        solve = definite_solver(rest.laplacian + sp.diags(pull + TINY))
        for _ in range(settings.updates if step else settings.first_updates):
            ahead = scale * rotated_edges(rest, rotations_of(rest, moved))
            moved = solve(rest.sums @ (rest.stiff[:, None] * ahead) + goal)
        rotation = rotations_of(rest, moved)
        ahead = rotated_edges(rest, rotation)
        best = np.sum(rest.stiff[:, None] * edges_of(rest, moved) * ahead)
        best /= np.sum(rest.stiff[:, None] * rest.along**2)
        scale = (scale + float(np.clip(best, 0.5, 2))) / 2
        normals = rest.normal_sign * vertex_normals(moved, whole.mesh.faces)
        weighted = settings.registered_normal_weight * normals
        queried = np.concatenate([moved, weighted, of_whole], 1)
        found = KDTree(queried).query(points)
        away, T = map(np.asarray, found)
        if edge.any():
            outward = np.einsum("pij,pj->pi", rotation[T], whole.outward[T])
            beyond = np.sum((at - moved[T]) * outward, 1) > 0
            apart = np.linalg.norm(at - moved[T], axis=1)
            near = apart < settings.covered_distance + settings.covered_reach * reach
            covered = near & ~(beyond & (reach <= settings.trimmed_reach))
    share = mass @ covered / mass.sum()
    residual = np.sqrt((mass * covered) @ away**2 / max(mass @ covered, 1e-12))
    bent = np.sum((edges_of(rest, moved) - scale * ahead) ** 2, 1)
    energy = float(rest.stiff @ bent) / 2 / scale**2
    return Registered(
        *(moved, rotation, scale, T, float(residual), energy, covered, float(share))
    )


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
    return (vertices - middle) @ closest_rotations(spread).T + there
