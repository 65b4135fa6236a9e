"""A whole that is near its place slides to it. Host side.

Where points are drawn to the nearest vertices of the other surface, they hardly move
along it. Here each pair of near points draws along the normal only (Chen and Medioni,
Image and Vision Computing 1992), so that surfaces slide freely, and what keeps the
whole in form, and the details of both, decide where to.

Only points of the part look for a partner. If vertices of the whole did so too, a limb
that the part lacks would be drawn to the limb beside it.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from jfsf.mesh import vertex_areas, vertex_normals
from jfsf.parts._register import TINY, Registered, Whole
from jfsf.parts._settings import PartSettings
from jfsf.refine import edges_of, rotations_of, turned
from jfsf.types import Mesh


def settle(
    whole: Whole,
    part: Mesh,
    found: Registered,
    *,
    settings: PartSettings = PartSettings(),
) -> Registered:
    """The whole drawn to the part from where it is.

    Each step takes the energy of `jfsf.refine.deform` down, in which the distance of a
    point p of the part from its nearest vertex q counts as
    a_p exp(-(d / width)^2) (((q - p) n)^2 + friction |q - p|^2) / reach^2, with a_p the
    area, n the mean normal of both, and d the distance with normals.

    Args:
        whole: at rest.
        part: as for `register`.
        found: of `register`.
        settings: `settle_reaches` and what follows these.
    """
    rest, scale, moved, n = whole.rest, found.scale, found.moved, len(found.moved)
    at, normal, mass = part.vertices, vertex_normals(*part), vertex_areas(*part)
    turn_weight = settings.settle_normal_weight
    points = np.concatenate([at, turn_weight * normal], 1)
    stiff = sp.kron(rest.laplacian, sp.eye(3)).tocsc()
    rotation, T, away = rotations_of(rest, moved), found.T, np.zeros(len(at))
    covered = np.ones(len(at), bool)
    steps = zip(settings.settle_reaches, settings.settle_widths, strict=True)
    for reach, width in [s for s in steps for _ in range(settings.settle_rounds)]:
        own = rest.normal_sign * vertex_normals(moved, rest.mesh.faces)
        tree = KDTree(np.concatenate([moved, turn_weight * own], 1))
        away, T = map(np.asarray, tree.query(points))
        outward = np.einsum("pij,pj->pi", rotation[T], whole.outward[T])
        covered = np.sum((at - moved[T]) * outward, 1) <= 0
        weight = mass * covered * np.exp(-((away / width) ** 2)) / reach**2
        axis = normal + own[T]
        size = np.linalg.norm(axis, axis=1, keepdims=True)
        axis = np.where(size > 1e-6, axis / np.maximum(size, 1e-6), normal)
        block = axis[:, :, None] * axis[:, None] + settings.settle_friction * np.eye(3)
        block *= weight[:, None, None]
        pull, goal = np.tile(TINY * np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        np.add.at(pull, T, block)
        np.add.at(goal, T, np.einsum("pij,pj->pi", block, at))
        places = np.arange(n), np.arange(n + 1)
        drawn = sp.bsr_matrix((pull, *places), (3 * n, 3 * n))
        solve = splu((stiff + drawn).tocsc()).solve
        for _ in range(settings.settle_updates):
            ahead = scale * turned(rest, rotations_of(rest, moved))
            right = rest.sums @ (rest.stiff[:, None] * ahead) + goal
            moved = solve(right.ravel()).reshape(n, 3)
        rotation = rotations_of(rest, moved)
        ahead = turned(rest, rotation)
        best = np.sum(rest.stiff[:, None] * edges_of(rest, moved) * ahead)
        best /= np.sum(rest.stiff[:, None] * rest.along**2)
        scale = (scale + float(np.clip(best, 0.5, 2))) / 2
    share = mass @ covered / mass.sum()
    residual = np.sqrt((mass * covered) @ away**2 / max(mass @ covered, 1e-12))
    bent = np.sum((edges_of(rest, moved) - scale * turned(rest, rotation)) ** 2, 1)
    energy = float(rest.stiff @ bent) / 2 / scale**2
    return Registered(
        *(moved, rotation, scale, T, float(residual), energy, float(share))
    )
