"""A template drawn to a scan, stiff at first and softer round by round. Host side.

The energy is that of `jfsf.refine.deform`, with the edges at rest as large as the
template is on the scan. A vertex is drawn to its image at first, then to the nearest
point of the scan that faces alike. One whose nearest point lies on the rim of the scan
is not drawn: there the template bridges a hole.
"""

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
# Faces nearly as bad as these are mended too, so that none is on the verge.
NEARLY_COLLAPSED, NEARLY_FLIPPED = 0.01, 0.1
MENDED_RINGS = 2  # of faces around a flaw


class Template(NamedTuple):
    """A template, and what is known of its vertices.

    rest: in the unit of the scan.
    mass: (n,) areas.
    rim: (n,) whether a vertex is on the boundary.
    """

    rest: Rest
    mass: np.ndarray
    rim: np.ndarray


class Drawn(NamedTuple):
    """A template on a scan.

    moved: (n, 3) positions.
    scale: factor of the lengths at rest.
    drawn: (n,) whether the scan draws each vertex.
    """

    moved: np.ndarray
    scale: float
    drawn: np.ndarray


def draw(
    template: Template,
    scan: Scan,
    T: np.ndarray,
    matched: np.ndarray,
    settings: RegistrationSettings,
) -> Drawn:
    """Deform a template onto a scan.

    Args:
        template: at rest.
        scan: `scan_of`.
        T: (n,) the vertex of the scan for each of the template.
        matched: (n,) whether that counts.
        settings: see `RegistrationSettings`.
    """
    image = scan.surface.mesh.vertices[T]
    # Beyond a hole all images are on its rim.
    known = matched & (template.rim | ~scan.surface.rim_vertex[T])
    sign, side = _sides(template, scan, T, settings)
    known &= side > settings.min_side
    placed = _to_images(template, image, known, settings)
    hold = template.mass * known / settings.hold**2
    return _to_surface(template, scan, placed, sign, (hold, image), settings)


def _sides(template: Template, scan: Scan, T, settings):
    """The sign that makes the normals of the images look as the scan's do on the
    whole, and (n,) how far they do around each vertex, 1 at most.

    What a map turns inside out, such as a head whose face is at the back, would stay
    so.
    """
    rest, mass = template.rest, template.mass
    image = scan.surface.mesh.vertices[T]
    alike = np.sum(vertex_normals(image, rest.mesh.faces) * scan.normal[T], 1)
    sign = -1 if mass @ alike < 0 else 1
    return sign, sign * _spread(rest, mass / settings.side_reach**2, alike)


def _to_images(template: Template, image, known, settings) -> Drawn:
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
    return Drawn(moved, scale, known)


def _to_surface(template: Template, scan: Scan, placed: Drawn, sign, hold, settings):
    """The template drawn to the surface of the scan, and its flaws mended."""
    rest, mass, rim = template
    moved, scale, drawn = placed
    force = np.ones(len(moved))
    rounds = len(settings.reaches)
    for number in range(rounds + settings.mending_rounds):
        reach = settings.reaches[min(number, rounds - 1)]
        flawed = _around_flaws(rest, moved, scale)
        if number >= rounds and not flawed.any():
            break
        eased = force * np.where(flawed, settings.easing, 1)
        if number >= rounds:
            force = eased
        rotation = rotations_of(rest, moved)
        if flawed.any():
            # A fold keeps itself: its vertices have turned with it.
            sound = mass * ~flawed
            rotation = _from_around(rest, rotation, sound, settings.mending_reach)
        for _ in range(settings.updates):
            normal = sign * vertex_normals(moved, rest.mesh.faces)
            found = facing(scan, moved, normal, settings)
            drawn = found.distance < settings.max_distance
            drawn &= rim | ~on_rim(scan.surface, found)
            pull = mass * drawn * eased / reach**2
            goal = np.where(drawn[:, None], found.position, 0)
            goal = pull[:, None] * goal + (hold[0] * eased)[:, None] * hold[1]
            moved = _solved(rest, rotation, scale, pull + hold[0] * eased, goal, moved)
            rotation = rotations_of(rest, moved)
        if number < rounds:
            scale = _rescaled(rest, moved, scale)
    return Drawn(moved, scale, drawn)


def _around_flaws(rest: Rest, moved, scale: float):
    """(n,) whether each vertex is near a face with a flaw, or nearly one."""
    flaws = flaws_of(
        rest,
        moved,
        scale,
        least_area=NEARLY_COLLAPSED,
        least_cosine=NEARLY_FLIPPED,
    )
    around = np.zeros(len(moved), bool)
    around[rest.mesh.faces[flaws.flipped | flaws.collapsed]] = True
    for _ in range(MENDED_RINGS):
        around |= rest.sums @ around[rest.edges[:, 1]] > 0
    return around


def _from_around(rest: Rest, rotation, mass, reach: float):
    """Rotations (n, 3, 3) smoothed over `reach`; those of mass 0 come from around."""
    weight = mass / reach**2
    smooth = _spread(rest, weight, rotation.reshape(-1, 9))
    return closest_rotations(smooth.reshape(-1, 3, 3))


def _spread(rest: Rest, weight, values):
    """(n, ...) values smoothed along the surface, by their weight."""
    tiny = TINY * weight.mean()
    solve = splu((rest.laplacian + sp.diags(weight + tiny)).tocsc()).solve
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
    solve = splu((rest.laplacian + sp.diags(pull + tiny)).tocsc()).solve
    ahead = scale * turned(rest, rotation)
    return solve(rest.sums @ (rest.stiff[:, None] * ahead) + goal + tiny * moved)


def _rescaled(rest: Rest, moved, scale: float) -> float:
    """Half way to the scale that fits the edges best."""
    ahead = turned(rest, rotations_of(rest, moved))
    best = np.sum(rest.stiff[:, None] * edges_of(rest, moved) * ahead)
    best /= np.sum(rest.stiff[:, None] * rest.along**2)
    return (scale + float(best)) / 2
