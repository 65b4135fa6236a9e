"""The whole deformed onto the part, from a start that may be far off. Host side.

A part alone is a strip of surface that bends to anything, and what it should cover is
not known. The whole keeps its form, and every point of the part has a partner on it. So
a whole that is drawn to the part slides to the right place from starts that are off by
a tenth of the shape, and what is left apart then tells right starts from wrong ones.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh._geometry import vertex_areas, vertex_normals
from jfsf.refine._rest import (
    Rest,
    at_rest,
    closest_rotations,
    deformed,
    edges_of,
    fitted_scale,
    rotated_edges,
    rotations_of,
    solver,
)
from jfsf.types import Mesh

# Lengths are in sqrt(area of the whole). The first step smooths the motion of the whole
# over this length: the start is trusted.
FIRST_REACH = 0.15
FIRST_UPDATES = 20  # deformations in the first step
# Those of the steps that follow, each with a search for the nearest vertices.
REACHES = 0.3, 0.3, 0.2, 0.2, 0.14, 0.14, 0.1, 0.1, 0.07, 0.07, 0.05, 0.05
UPDATES = 3  # deformations in each of these
NORMAL_WEIGHT = 0.1  # half the length that opposite normals count as, in that search
CURVATURE_WEIGHT = 0.15  # length that one standard deviation of curvature counts as
# A point farther from an open whole than this length and this share of the reach is not
# covered by it.
COVERED_DISTANCE, COVERED_REACH = 0.03, 0.5
TRIMMED_REACH = 0.14  # from this reach on, what lies beyond its boundary is not either
UNCOVERED_WEIGHT = 1e-3  # of the pull of a point that is not covered, beside 1
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
    trusted=None,
    *,
    curvature: tuple[np.ndarray, np.ndarray] | None = None,
    reaches: Sequence[float] = REACHES,
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
        trusted: (p,) bool, where the start is to be trusted: the other points neither
            place nor draw an open whole in the first step. None for all.
        curvature: (p, c) of the part and (n, c) of the whole, see
            `jfsf.matching.parts._sides`; None compares positions and normals only.
        reaches: of the steps after the first, in sqrt(area of the whole).
    """
    at, normal, mass = part.vertices, vertex_normals(*part), vertex_areas(*part)
    none = (np.zeros((len(v), 0)) for v in (at, whole.mesh.vertices))
    unlike = 0.0 if curvature is None else CURVATURE_WEIGHT
    of_part, of_whole = (unlike * values for values in curvature or none)
    columns = at, NORMAL_WEIGHT * normal, of_part
    points = np.concatenate(columns, 1)
    edge = whole.outward.any(1)
    scale, covered = 1.0, np.ones(len(at), bool)
    if edge.any() and trusted is not None and np.any(trusted):
        covered = np.asarray(trusted)
    moved = _placed(whole.mesh.vertices, at, mass * covered, T)
    rest = whole.rest
    away = np.zeros(len(at))
    rotation = np.broadcast_to(np.eye(3), (len(moved), 3, 3))
    for step, reach in enumerate((FIRST_REACH, *reaches)):
        goal, pull = _drawn_to(part, mass, covered, T, len(moved), reach)
        solve = solver(rest, pull + TINY)
        for _ in range(UPDATES if step else FIRST_UPDATES):
            moved = deformed(rest, solve, rotations_of(rest, moved), scale, goal)
        rotation = rotations_of(rest, moved)
        best = fitted_scale(rest, moved, rotation)
        scale = (scale + float(np.clip(best, 0.5, 2))) / 2
        normals = rest.normal_sign * vertex_normals(moved, whole.mesh.faces)
        weighted = NORMAL_WEIGHT * normals
        queried = np.concatenate([moved, weighted, of_whole], 1)
        away, T = map(np.asarray, KDTree(queried).query(points))
        if edge.any():
            outward = np.einsum("pij,pj->pi", rotation[T], whole.outward[T])
            beyond = np.sum((at - moved[T]) * outward, 1) > 0
            apart = np.linalg.norm(at - moved[T], axis=1)
            near = apart < COVERED_DISTANCE + COVERED_REACH * reach
            covered = near & ~(beyond & (reach <= TRIMMED_REACH))
    share = mass @ covered / mass.sum()
    residual = np.sqrt((mass * covered) @ away**2 / max(mass @ covered, 1e-12))
    ahead = rotated_edges(rest, rotation)
    bent = np.sum((edges_of(rest, moved) - scale * ahead) ** 2, 1)
    energy = float(rest.stiff @ bent) / 2 / scale**2
    return Registered(
        *(moved, rotation, scale, T, float(residual), energy, covered, float(share))
    )


def _drawn_to(part: Mesh, mass, covered, T, n: int, reach: float):
    """Sums of what draws each vertex of the whole, and how much that is."""
    weight = mass * np.where(covered, 1, UNCOVERED_WEIGHT) / reach**2
    goal = np.zeros((n, 3))
    np.add.at(goal, T, weight[:, None] * part.vertices)
    return goal, np.bincount(T, weight, n)


def _placed(vertices, points, mass, T) -> np.ndarray:
    """The whole moved rigidly to where the start has it."""
    middle, there = (mass @ v / mass.sum() for v in (vertices[T], points))
    spread = (points - there).T @ ((vertices[T] - middle) * mass[:, None])
    return (vertices - middle) @ closest_rotations(spread).T + there
