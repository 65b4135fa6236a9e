"""A template drawn to a scan, stiff at first and softer round by round. Host side.

The energy is that of `jfsf.refine.deform`, with the edges at rest as large as the
template is on the scan. A vertex is drawn to its image at first, then to the nearest
point of the scan that faces alike. One whose nearest point lies on the rim of the scan
is not drawn: there the template bridges a hole.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.apps.registration._flaws import flaws_of
from jfsf.apps.registration._scan import Scan, facing
from jfsf.apps.registration._settings import RegistrationSettings
from jfsf.apps.registration._unfold import unfold
from jfsf.mesh import vertex_normals
from jfsf.mesh._closest import on_rim
from jfsf.refine._rest import (
    Rest,
    closest_rotations,
    edges_of,
    rotated_edges,
    rotations_of,
)
from jfsf.spectral._laplacian import definite_solver

TINY = 1e-6  # of the mean force: what nothing draws stays
# Faces nearly as bad as these are mended too, so that none is on the verge.
NEARLY_COLLAPSED, NEARLY_FLIPPED = 0.01, 0.1
MENDED_RINGS = 2  # of faces around a flaw
LEAST_KNOWN = 0.1  # of the area: with fewer images all are taken


class Template(NamedTuple):
    """A template, and what is known of its vertices.

    rest: in the unit of the scan.
    mass: (n,) areas.
    rim: (n,) whether a vertex is on the boundary.
    matched: (n,) whether its image counts.
    """

    rest: Rest
    mass: np.ndarray
    rim: np.ndarray
    matched: np.ndarray


class Drawn(NamedTuple):
    """A template on a scan.

    moved: (n, 3) positions.
    scale: factor of the lengths at rest.
    drawn: (n,) whether the scan draws each vertex.
    sign: -1 where its faces look into the scan.
    """

    moved: np.ndarray
    scale: float
    drawn: np.ndarray
    sign: int


def draw(
    template: Template,
    scan: Scan,
    T: np.ndarray,
    settings: RegistrationSettings,
) -> Drawn:
    """Deform a template onto a scan.

    Args:
        template: at rest.
        scan: `scan_of`.
        T: (n,) the vertex of the scan for each of the template.
        settings: see `RegistrationSettings`.

    Returns:
        The state with the fewest flaws after the last round.
    """
    image = scan.surface.mesh.vertices[T]
    # Beyond a hole all images are on its rim.
    known = template.matched & (template.rim | ~scan.surface.rim_vertex[T])
    sign, side = _sides(template, scan, T, settings)
    known &= side > settings.min_side
    if template.mass @ known < LEAST_KNOWN * template.mass.sum():
        known = template.matched
    placed = _to_images(template, image, known, sign, settings)
    hold = template.mass * known / settings.hold**2
    return _to_surface(template, scan, placed, (hold, image), settings)


def _sides(template: Template, scan: Scan, T, settings):
    """Which way the normals of the images look, beside those of the scan.

    What a map turns inside out, such as a head whose face is at the back, would stay
    so: it must not draw the template.

    Returns:
        -1 if most look away, else 1; and (n,) by how much they look as most do around
        each vertex, 1 at most.
    """
    rest, mass = template.rest, template.mass
    image = scan.surface.mesh.vertices[T]
    alike = np.sum(vertex_normals(image, rest.mesh.faces) * scan.normal[T], 1)
    sign = -1 if mass @ alike < 0 else 1
    return sign, sign * _spread(rest, mass / settings.side_reach**2, alike)


def _to_images(template: Template, image, known, sign, settings) -> Drawn:
    """The template drawn to the images of its vertices, where these are known."""
    rest, mass = template.rest, template.mass
    moved, scale = image, 1.0
    rotation = rotations_of(rest, moved, settings.rotation_rings)
    rotation = _from_around(rest, rotation, mass * known, settings.turn_reach)
    for reach in settings.map_reaches:
        for _ in range(settings.updates):
            pull = mass * known / reach**2
            moved = _solved(rest, rotation, scale, pull, pull[:, None] * image, moved)
            rotation = rotations_of(rest, moved)
        scale = _rescaled(rest, moved, scale)
    return Drawn(moved, scale, known, sign)


def _to_surface(template: Template, scan: Scan, placed: Drawn, hold, settings):
    """The template drawn to the surface of the scan, with as few flaws as may be."""
    force = np.ones(len(placed.moved))
    state = best = _softer(template, scan, placed, hold, settings)
    fewest = np.inf
    for number in range(settings.mending_rounds + 1):
        around, count = _around_flaws(template, scan, state)
        if count < fewest:
            best, fewest = state, count
        if count == 0:
            return state
        force = force * np.where(around, settings.easing, 1)
        if number < settings.mending_rounds:
            eased, reach = (around, force), settings.reaches[-1]
            state = _round(template, scan, state, hold, eased, reach, settings)

    def flawed(moved):
        flaws = flaws_of(template.rest, moved, best.scale, scan, best.sign)
        return flaws.flipped | flaws.collapsed

    moved = unfold(template.rest, *best[:2], flawed)
    return best._replace(moved=moved)


def _softer(template: Template, scan: Scan, state: Drawn, hold, settings):
    """The rounds from the stiffest to the softest."""
    for reach in settings.reaches:
        flawed = _around_flaws(template, scan, state)[0]
        # Here and now only: with the next round the surroundings may be right.
        eased = flawed, np.where(flawed, settings.easing, 1)
        state = _round(template, scan, state, hold, eased, reach, settings)
        state = state._replace(scale=_rescaled(template.rest, *state[:2]))
    return state


def _round(template: Template, scan: Scan, state: Drawn, hold, eased, reach, settings):
    """Some updates with one reach.

    Args:
        template, scan, state: as they are.
        hold: (n,) how much the map holds each vertex, and (n, 3) where.
        eased: (n,) whether a vertex is near a flaw, and a factor of its force.
        reach, settings: see `RegistrationSettings`.
    """
    rest, mass, rim, matched = template
    limit = np.where(matched, settings.max_distance, settings.unmatched_distance)
    moved, scale, drawn, sign = state
    (held, image), (flawed, factor) = hold, eased
    rotation = rotations_of(rest, moved)
    if flawed.any():
        # A fold keeps itself: its vertices have turned with it.
        rotation = _from_around(rest, rotation, mass * ~flawed, settings.mending_reach)
    for _ in range(settings.updates):
        normal = sign * vertex_normals(moved, rest.mesh.faces)
        found = facing(scan, moved, normal, settings)
        drawn = found.distance < limit
        drawn &= rim | ~on_rim(scan.surface, found)
        force = factor * mass * drawn / reach**2
        there = np.where(drawn[:, None], found.position, 0)
        goal = force[:, None] * there + (factor * held)[:, None] * image
        moved = _solved(rest, rotation, scale, force + factor * held, goal, moved)
        rotation = rotations_of(rest, moved)
    return Drawn(moved, scale, drawn, sign)


def _around_flaws(template: Template, scan: Scan, state: Drawn):
    """(n,) whether each vertex is near a face with a flaw, or nearly one; how many."""
    rest = template.rest
    nearly = {"least_area": NEARLY_COLLAPSED, "least_cosine": NEARLY_FLIPPED}
    flaws = flaws_of(rest, *state[:2], scan, state.sign, **nearly)
    flawed = flaws.flipped | flaws.collapsed
    around = np.zeros(len(template.mass), bool)
    around[rest.mesh.faces[flawed]] = True
    for _ in range(MENDED_RINGS):
        around |= rest.sums @ around[rest.edges[:, 1]] > 0
    return around, int(flawed.sum())


def _from_around(rest: Rest, rotation, mass, reach: float):
    """Rotations (n, 3, 3) smoothed over `reach`; those of mass 0 come from around."""
    weight = mass / reach**2
    smooth = _spread(rest, weight, rotation.reshape(-1, 9))
    return closest_rotations(smooth.reshape(-1, 3, 3))


def _spread(rest: Rest, weight, values):
    """(n, ...) values smoothed along the surface, by their weight."""
    tiny = TINY * (weight.mean() or 1)
    solve = definite_solver(rest.laplacian + sp.diags(weight + tiny))
    return solve(((weight + tiny) * values.T).T)


def _solved(rest: Rest, rotation, scale: float, pull, goal, moved):
    """The positions (n, 3) of least energy for given rotations.

    Args:
        rest, rotation, scale: the template.
        pull: (n,) how much each vertex is drawn.
        goal: (n, 3) where to, times that.
        moved: (n, 3) where what is not drawn stays, unless its neighbours move it.
    """
    tiny = TINY * pull.mean()
    solve = definite_solver(rest.laplacian + sp.diags(pull + tiny))
    ahead = scale * rotated_edges(rest, rotation)
    return solve(rest.sums @ (rest.stiff[:, None] * ahead) + goal + tiny * moved)


def _rescaled(rest: Rest, moved, scale: float) -> float:
    """Half way to the scale that fits the edges best."""
    ahead = rotated_edges(rest, rotations_of(rest, moved))
    best = np.sum(rest.stiff[:, None] * edges_of(rest, moved) * ahead)
    best /= np.sum(rest.stiff[:, None] * rest.along**2)
    return (scale + float(best)) / 2
