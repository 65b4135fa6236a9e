"""Faces of a deformed template that are turned over or have no area left.

Corners of those that stay turned over are moved until these look ahead (`unfold`).
"""

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.optimize import minimize
from scipy.sparse.csgraph import connected_components

from jfsf.mesh import closest
from jfsf.mesh._closest import FacingTree
from jfsf.mesh._geometry import face_areas, face_normals, vertex_normals
from jfsf.refine._rest import Rest, rotations_of

COLLAPSED = 1e-4  # of the area at rest
RINGS = 2  # surroundings that say which way a face should look
NEAR = 0.005  # of sqrt(area): a face lies on what is nearer than this
MOST_RINGS = 8  # of vertices around a flaw that may move
LEAST_AREA, STAYS = 0.2, (1.0, 0.1, 0.01)  # see `_unfolded`
SOLVER = {"gtol": 1e-9, "ftol": 1e-10, "maxiter": 200}


# Positions (n, 3) of the vertices -> (m,) whether a face has a flaw.
Flawed = Callable[[np.ndarray], np.ndarray]


class Flaws(NamedTuple):
    """(m,) each: faces that are turned over, and those that are collapsed."""

    flipped: np.ndarray
    collapsed: np.ndarray


def flaws_of(
    rest: Rest,
    moved: np.ndarray,
    scale: float,
    scan: FacingTree,
    sign: int,
    *,
    least_area: float = COLLAPSED,
    least_cosine: float = 0.0,
) -> Flaws:
    """Which faces have a flaw.

    A face is turned over if its normal is more than a right angle away from where its
    surroundings turn that of the face at rest, and does not look as the scan does below
    it: the skin of a scan may have folds, and one that lies in them is right. Of a face
    that lies in a fold of the template at rest this says nothing: that may unfold.
    FAUST's registrations have such folds under the arms, between neighbours.

    Args:
        rest: the template.
        moved: (n, 3) its vertices.
        scale: factor of its lengths.
        scan: that it lies on.
        sign: -1 where the template's faces look into the scan.
        least_area: of the area at rest, below which a face is collapsed.
        least_cosine: of the angle above.
    """
    vertices, faces = rest.mesh
    before, after = (face_normals(v, faces) for v in (vertices, moved))
    turn = rotations_of(rest, moved, RINGS)[faces].mean(1)
    looks = np.einsum("fij,fj->fi", turn, before)
    cosine = np.einsum("fi,fi->f", looks, after)
    size = np.linalg.norm(looks, axis=1) * np.linalg.norm(after, axis=1)
    area = face_areas(vertices, faces) * scale**2
    collapsed = face_areas(moved, faces) < least_area * area
    judged = (size > 0) & ~_folded(rest, before) & ~collapsed
    flipped = (cosine <= least_cosine * size) & judged
    at = np.flatnonzero(flipped)
    below = closest(scan.surface, moved[faces[at]].mean(1))
    alike = sign * np.sum(after[at] * scan.surface.normal[below.face], 1) > 0
    flipped[at] = ~(alike & (below.distance < NEAR))
    return Flaws(flipped, collapsed)


def _folded(rest: Rest, normals):
    """(m,) whether a face at rest looks away from where its surroundings look."""
    around = vertex_normals(*rest.mesh)
    for _ in range(RINGS):
        around = around + rest.sums @ around[rest.edges[:, 1]]
    return np.einsum("fi,fi->f", normals, around[rest.mesh.faces].sum(1)) <= 0


def unfold(rest: Rest, moved: np.ndarray, scale: float, flawed: Flawed) -> np.ndarray:
    """Positions (n, 3) with fewer flaws, and none where that can be.

    Around each piece of flawed faces only their corners may move at first, then those
    within a ring more, and so on, until there are fewer flaws.

    Args:
        rest: the template.
        moved: (n, 3) its vertices.
        scale: factor of its lengths.
        flawed: which faces have a flaw, by positions.
    """
    n = len(moved)
    near = sp.csr_matrix((np.ones(len(rest.edges)), rest.edges.T), (n, n))
    bad = flawed(moved)
    while bad.any():
        regions = _regions(near, rest.mesh.faces[bad])
        ways = (
            _unfolded(rest, free, moved, scale, stay)
            for free, stay in product(regions, STAYS)
        )
        tried = ((placed, flawed(placed)) for placed in ways)
        better = next((way for way in tried if way[1].sum() < bad.sum()), None)
        if better is None:
            break
        moved, bad = better
    return moved


def _regions(near, faces):
    """(n,) bool of each piece of these faces, the smallest rings first."""
    touched = np.zeros(near.shape[0], bool)
    touched[faces] = True
    number, label = connected_components(near[touched][:, touched])
    pieces = np.zeros((number, len(touched)), bool)
    pieces[label, np.flatnonzero(touched)] = True
    for _ in range(MOST_RINGS + 1):
        yield from pieces
        pieces = np.array([free | (near @ free > 0) for free in pieces])


def _unfolded(rest: Rest, free, moved, scale: float, stay: float) -> np.ndarray:
    """Positions, as little moved as lets each face look where its surroundings turn it.

    Of least energy over the positions p of the free vertices, by L-BFGS:

        E(p) = sum_f max(LEAST_AREA a_f - A_f(p), 0)^2 / a_f + stay |p - moved|^2,

    f the faces with a free corner, a_f the area at rest, A_f that of the projection
    along the direction f should look, negative where it is turned over.
    """
    vertices, faces = rest.mesh
    at = np.flatnonzero(free)
    faces = faces[free[faces].any(1)]
    turn = rotations_of(rest, moved, RINGS)[faces].mean(1)
    ahead = np.einsum("fij,fj->fi", turn, face_normals(vertices, faces))
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-300)
    area = face_areas(vertices, faces) * scale**2
    place = moved.copy()

    def energy(flat):
        place[at] = flat.reshape(-1, 3)
        a, b, c = (place[faces[:, i]] for i in range(3))
        along = np.sum(np.cross(b - a, c - a) * ahead, 1) / 2
        short = np.maximum(LEAST_AREA * area - along, 0)
        slope = np.zeros_like(place)
        for i, edge in enumerate((c - b, a - c, b - a)):
            push = np.cross(edge, ahead) * (short / area)[:, None]
            np.add.at(slope, faces[:, i], push)
        off = place[at] - moved[at]
        value = np.sum(short**2 / area) + stay * np.sum(off**2)
        return value, (slope[at] + 2 * stay * off).ravel()

    start = moved[at].ravel()
    best = minimize(energy, start, jac=True, method="L-BFGS-B", options=SOLVER)
    place[at] = best.x.reshape(-1, 3)
    return place
