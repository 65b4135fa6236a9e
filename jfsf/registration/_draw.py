"""A template drawn to a scan, stiff at first and softer round by round. Host side."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jfsf.mesh import on_rim, vertex_areas, vertex_normals
from jfsf.refine import Rest, closest_rotations, edges_of, rotations_of, turned
from jfsf.registration._flaws import flaws_of
from jfsf.registration._scan import Scan, facing
from jfsf.registration._settings import RegistrationSettings

TINY = 1e-6  # of the mean force: what nothing draws stays


class Drawn(NamedTuple):
    """moved: (n, 3). scale: of the template's lengths. drawn: (n,) whether the scan
    draws each vertex."""

    moved: np.ndarray
    scale: float
    drawn: np.ndarray


def draw(
    rest: Rest, own_rim, scan: Scan, T, *, settings: RegistrationSettings
) -> Drawn:
    """Deform a template onto a scan."""
    mass = vertex_areas(*rest.mesh)
    image = scan.surface.mesh.vertices[T]
    trusted = own_rim | ~scan.surface.rim_vertex[T]
    looks = vertex_normals(image, rest.mesh.faces)
    alike = np.sum(looks * scan.normal[T], 1)
    facing_sign = np.sign(mass @ alike)
    smooth = _diffused(rest, mass / settings.side_reach**2, facing_sign * alike)
    trusted = trusted & (smooth > settings.min_side)
    moved, scale = image, 1.0
    for number, reach in enumerate(settings.map_reaches):
        pull = mass * trusted / reach**2
        for i in range(settings.updates):
            rotation = rotations_of(rest, moved)
            if number == i == 0:
                rotation = _diffused(
                    rest,
                    mass * trusted / settings.turn_reach**2 + 1e-6 * mass,
                    rotations_of(rest, moved, settings.rotation_rings).reshape(-1, 9),
                )
                rotation = closest_rotations(rotation.reshape(-1, 3, 3))
            moved = _solved(rest, moved, scale, image, pull, rotation)
        scale = _rescaled(rest, moved, scale)
    ease = np.ones(len(mass))
    drawn = np.ones(len(mass), bool)

    def update(moved, scale, reach, ease):
        normal = facing_sign * vertex_normals(moved, rest.mesh.faces)
        found = facing(scan, moved, normal, settings)
        beyond = on_rim(scan.surface, found) & ~own_rim
        drawn = (found.distance < settings.max_distance) & ~beyond
        goal = np.where(drawn[:, None], found.position, moved)
        moved = _solved(rest, moved, scale, goal, mass * drawn * ease / reach**2)
        return moved, drawn

    for reach in settings.reaches:
        for _ in range(settings.updates):
            moved, drawn = update(moved, scale, reach, ease)
        scale = _rescaled(rest, moved, scale)
    for _ in range(settings.mending_rounds):
        flaws = flaws_of(rest, moved, scale, least_area=0.01, least_cosine=0.1)
        bad = flaws.flipped | flaws.collapsed
        if not bad.any():
            break
        around = np.zeros(len(mass))
        around[rest.mesh.faces[bad]] = 1
        for _ in range(2):
            around = np.maximum(around, (rest.sums @ around[rest.edges[:, 1]]) > 0)
        ease = ease * np.where(around > 0, settings.easing, 1)
        for _ in range(settings.updates):
            moved, drawn = update(moved, scale, settings.reaches[-1], ease)
    return Drawn(moved, scale, drawn)


def _diffused(rest: Rest, weight, values):
    return splu((rest.laplacian + sp.diags(weight)).tocsc()).solve(
        weight.reshape(-1, *[1] * (values.ndim - 1)) * values
    )


def _solved(rest: Rest, moved, scale, goal, pull, rotation=None):
    """The vertices after one update of rotations and positions."""
    if rotation is None:
        rotation = rotations_of(rest, moved)
    tiny = TINY * pull.mean()
    ahead = scale * turned(rest, rotation)
    solve = splu((rest.laplacian + sp.diags(pull + tiny)).tocsc()).solve
    right = rest.sums @ (rest.stiff[:, None] * ahead)
    return solve(right + pull[:, None] * goal + tiny * moved)


def _rescaled(rest: Rest, moved, scale: float) -> float:
    """Half way to the scale that fits the edges best."""
    ahead = turned(rest, rotations_of(rest, moved))
    best = np.sum(rest.stiff[:, None] * edges_of(rest, moved) * ahead)
    best /= np.sum(rest.stiff[:, None] * rest.along**2)
    return (scale + float(best)) / 2
