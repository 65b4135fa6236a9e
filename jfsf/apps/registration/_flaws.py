"""Faces of a deformed template that are turned over or have no area left."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jfsf.apps.registration._scan import Scan
from jfsf.mesh import closest, face_normals, vertex_normals
from jfsf.mesh._geometry import face_areas
from jfsf.refine._rest import Rest, rotations_of

COLLAPSED = 1e-4  # of the area at rest
RINGS = 2  # surroundings that say which way a face should look
NEAR = 0.005  # of sqrt(area): a face lies on what is nearer than this


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
    scan: Scan,
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
