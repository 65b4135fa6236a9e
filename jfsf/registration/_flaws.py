"""Faces of a deformed template that are turned over or have no area left."""

from typing import NamedTuple

import numpy as np

from jfsf.mesh import face_areas, face_normals
from jfsf.refine import Rest, rotations_of

COLLAPSED = 1e-4  # of the area at rest
RINGS = 2  # surroundings that say which way a face should look


class Flaws(NamedTuple):
    """(m,) each: faces that are turned over, and those that are collapsed."""

    flipped: np.ndarray
    collapsed: np.ndarray


def flaws_of(
    rest: Rest, moved, scale: float, *, least_area=COLLAPSED, least_cosine=0.0
) -> Flaws:
    """Which faces have a flaw.

    A face is turned over if its normal is more than a right angle away from where its
    surroundings turn that of the face at rest.

    Args:
        rest: the template.
        moved: (n, 3) its vertices.
        scale: factor of its lengths.
        least_area: of the area at rest, below which a face is collapsed.
        least_cosine: of the angle above.
    """
    faces = rest.mesh.faces
    before, after = (face_normals(v, faces) for v in (rest.mesh.vertices, moved))
    turn = rotations_of(rest, moved, RINGS)[faces].mean(1)
    looks = np.einsum("fij,fj->fi", turn, before)
    cosine = np.einsum("fi,fi->f", looks, after)
    size = np.linalg.norm(looks, axis=1) * np.linalg.norm(after, axis=1)
    area = face_areas(rest.mesh.vertices, faces) * scale**2
    collapsed = face_areas(moved, faces) < least_area * area
    return Flaws((cosine <= least_cosine * size) & ~collapsed, collapsed)
