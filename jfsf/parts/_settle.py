"""A whole that is near its place slides to it. Host side.

Where points are drawn to the nearest vertices of the other surface, they hardly move
along it. Here each pair of near points draws along the normal only (Chen and Medioni,
1992), so that surfaces slide freely, and what keeps the whole in form, and the details
of both, decide where to. Both surfaces look for their nearest points, since two that
overlap have equal rights. Pairs that are far apart, or beyond a rim, hardly count.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from jfsf.mesh import vertex_areas, vertex_normals
from jfsf.parts._register import Registered, Whole
from jfsf.parts._settings import PartSettings
from jfsf.refine import edges_of, rotations_of, turned
from jfsf.types import Mesh

TINY = 1e-9


def settle(
    whole: Whole,
    part: Mesh,
    outward: np.ndarray,
    found: Registered,
    *,
    settings: PartSettings = PartSettings(),
) -> Registered:
    """The whole drawn to the part from where it is.

    Args:
        whole: at rest.
        part: as for `register`.
        outward: (p, 3) tangents out of the part on its boundary; else 0.
        found: of `register`.
        settings: `settle_reaches` and what follows these.
    """
    rest, scale, moved = whole.rest, found.scale, found.moved
    at, normal, mass = part.vertices, vertex_normals(*part), vertex_areas(*part)
    n, mass_whole = len(moved), vertex_areas(*rest.mesh)
    turn_weight = settings.settle_normal_weight
    tree = KDTree(np.concatenate([at, turn_weight * normal], 1))
    stiff = sp.kron(rest.laplacian, sp.eye(3)).tocsc()
    rotation = rotations_of(rest, moved)
    T, away = found.T, np.zeros(len(at))
    covered = np.ones(len(at), bool)
    for reach, width in zip(
        settings.settle_reaches, settings.settle_widths, strict=True
    ):
        for _ in range(settings.settle_rounds):
            own = rest.normal_sign * vertex_normals(moved, rest.mesh.faces)
            there = KDTree(np.concatenate([moved, turn_weight * own], 1))
            away, T = map(
                np.asarray,
                there.query(np.concatenate([at, turn_weight * normal], 1)),
            )
            out = np.einsum("pij,pj->pi", rotation[T], whole.outward[T])
            covered = np.sum((at - moved[T]) * out, 1) <= 0
            back_away, back = map(
                np.asarray, tree.query(np.concatenate([moved, turn_weight * own], 1))
            )
            seen = np.sum((moved - at[back]) * outward[back], 1) <= 0
            # Pairs (vertex of the whole, point of the part, weight).
            q = np.concatenate([T, np.arange(n)])
            p = np.concatenate([np.arange(len(at)), back])
            weight = np.concatenate([mass * covered, scale**2 * mass_whole * seen])
            far = np.concatenate([away, back_away])
            weight = weight * np.exp(-((far / width) ** 2)) / reach**2
            keep = weight > 0
            q, p, weight = q[keep], p[keep], weight[keep]
            # Normals of both count alike.
            axis = normal[p] + own[q]
            size = np.linalg.norm(axis, axis=1, keepdims=True)
            axis = np.where(size > 1e-6, axis / np.maximum(size, 1e-6), normal[p])
            block = axis[:, :, None] * axis[:, None]
            block += settings.settle_friction * np.eye(3)
            pull, goal = np.zeros((n, 3, 3)), np.zeros((n, 3))
            np.add.at(pull, q, weight[:, None, None] * block)
            np.add.at(goal, q, weight[:, None] * np.einsum("kij,kj->ki", block, at[p]))
            pull += TINY * np.eye(3)
            drawn = sp.bsr_matrix(
                (pull, np.arange(n), np.arange(n + 1)), (3 * n, 3 * n)
            )
            solve = splu((stiff + drawn.tocsc()).tocsc()).solve
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
