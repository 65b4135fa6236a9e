"""A template drawn to a scan, stiff at first and softer round by round. Host side.

The energy is that of `jfsf.refine.deform`, with the edges at rest as large as the
template is on the scan. A vertex is drawn to its image at first, then to the nearest
point of the scan that faces alike. One whose nearest point lies on the rim of the scan
is not drawn: there the template bridges a hole.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jfsf.apps.registration._flaws import flaws_of, unfold
from jfsf.array._jit import check_types
from jfsf.mesh._closest import FacingTree, facing, on_rim
from jfsf.mesh._geometry import vertex_normals
from jfsf.refine._rest import (
    Rest,
    closest_rotations,
    deformed,
    fitted_scale,
    rotations_of,
    solver,
)

CANDIDATES = 12  # pieces of the scan that are looked at for each point
MIN_ALIKE = 0.5  # least cosine of the angle between the normals
TINY = 1e-6  # of the mean force: what nothing draws stays
# Faces nearly as bad as these are mended too, so that none is on the verge.
NEARLY_COLLAPSED, NEARLY_FLIPPED = 0.01, 0.1
MENDED_RINGS = 2  # of faces around a flaw
MENDING_ROUNDS = 2  # after the last round, at most; then corners of faces are moved
MENDING_REACH = 0.005  # how far rotations around a flaw come from, in sqrt(area)
EASING = 0.1  # factor of the force around a flaw, each time
LEAST_MATCHED = 0.1  # of the area: with fewer images all are taken
UPDATES = 3  # of a round: rotations, each followed by a linear solve
ROTATION_RINGS = 2  # surroundings that the first rotations are read from
TURN_REACH = 0.05  # how far the first rotations are smoothed, in sqrt(area)
# Where normals of the images look away from the scan's, over a region of this size in
# sqrt(area), the map is inside out there and does not count.
SIDE_REACH = 0.05
# Mean cosine between both normals: 1 is no angle between them, 0 a right one.
MIN_SIDE = 0.2


@dataclass(frozen=True)
class RegistrationSettings:
    """How a template is deformed onto a scan. Lengths are in sqrt(area) of the scan.

    A vertex is drawn with a force of its area over the square of a reach: the larger
        the
    reach, the stiffer the template.

    map_reaches: reach in each of the first rounds, which draw a vertex to its image.
    reaches: reach in each of the later rounds, which draw a vertex to the nearest point
        of the scan.
    hold: reach with which the images continue to draw in the later rounds: the smaller,
        the less the template slides along the scan. Of 0.03, 0.05, 0.1 and none, 0.05
        had the least error on pairs of one body and of two.
    max_distance: largest distance from which a point of the scan draws a vertex.
    unmatched_distance: largest distance from which a point of the scan draws a vertex
        whose image does not count.
    """

    map_reaches: tuple[float, ...] = (0.1, 0.06, 0.04)
    reaches: tuple[float, ...] = (0.03, 0.02, 0.014, 0.01, 0.007, 0.005, 0.0035, 0.0025)
    hold: float = 0.05
    max_distance: float = 0.1
    unmatched_distance: float = 0.02

    def __post_init__(self) -> None:
        """ValueError for numbers that nothing can be registered with."""
        check_types(self)
        if not self.reaches or not min([*self.map_reaches, *self.reaches]) > 0:
            raise ValueError(
                f"RegistrationSettings: map_reaches are {self.map_reaches} and reaches "
                f"{self.reaches}; give one or more of these, all above 0"
            )
        for name in ("hold", "max_distance"):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"RegistrationSettings: {name} is {getattr(self, name)}; give more "
                    "than 0"
                )


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


class Deformed(NamedTuple):
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
    scan: FacingTree,
    T: np.ndarray,
    settings: RegistrationSettings,
) -> Deformed:
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
    counts = template.matched & (template.rim | ~scan.surface.rim_vertex[T])
    sign, side = _sides(template, scan, T)
    counts &= side > MIN_SIDE
    if template.mass @ counts < LEAST_MATCHED * template.mass.sum():
        counts = template.matched
    placed = _to_images(template, image, counts, sign, settings)
    hold = template.mass * counts / settings.hold**2
    return _to_surface(template, scan, placed, (hold, image), settings)


def _sides(template: Template, scan: FacingTree, T):
    """Which way the normals of the images look, beside those of the scan.

    What a map turns inside out, such as a head whose face is at the back, would stay
    so: it must not draw the template.

    Returns:
        -1 if most look away, else 1; and (n,) by how much they look as most do around
        each vertex, 1 at most.
    """
    rest, mass = template.rest, template.mass
    image = scan.surface.mesh.vertices[T]
    alike = np.sum(vertex_normals(image, rest.mesh.faces) * scan.vertex_normal[T], 1)
    sign = -1 if mass @ alike < 0 else 1
    return sign, sign * _spread(rest, mass / SIDE_REACH**2, alike)


def _to_images(template: Template, image, counts, sign, settings) -> Deformed:
    """The template drawn to the images of its vertices, where these count."""
    rest, mass = template.rest, template.mass
    moved, scale = image, 1.0
    rotation = rotations_of(rest, moved, ROTATION_RINGS)
    rotation = _from_around(rest, rotation, mass * counts, TURN_REACH)
    for reach in settings.map_reaches:
        for _ in range(UPDATES):
            pull = mass * counts / reach**2
            moved = _solved(rest, rotation, scale, pull, pull[:, None] * image, moved)
            rotation = rotations_of(rest, moved)
        scale = _rescaled(rest, moved, scale)
    return Deformed(moved, scale, counts, sign)


def _to_surface(template: Template, scan: FacingTree, placed: Deformed, hold, settings):
    """The template drawn to the surface of the scan, with as few flaws as may be."""
    force = np.ones(len(placed.moved))
    state = best = _softer(template, scan, placed, hold, settings)
    fewest = np.inf
    for number in range(MENDING_ROUNDS + 1):
        around, count = _around_flaws(template, scan, state)
        if count < fewest:
            best, fewest = state, count
        if count == 0:
            return state
        force = force * np.where(around, EASING, 1)
        if number < MENDING_ROUNDS:
            eased, reach = (around, force), settings.reaches[-1]
            state = _round(template, scan, state, hold, eased, reach, settings)

    def flawed(moved):
        flaws = flaws_of(template.rest, moved, best.scale, scan, best.sign)
        return flaws.flipped | flaws.collapsed

    moved = unfold(template.rest, *best[:2], flawed)
    return best._replace(moved=moved)


def _softer(template: Template, scan: FacingTree, state: Deformed, hold, settings):
    """The rounds from the stiffest to the softest."""
    for reach in settings.reaches:
        flawed = _around_flaws(template, scan, state)[0]
        # Here and now only: with the next round the surroundings may be right.
        eased = flawed, np.where(flawed, EASING, 1)
        state = _round(template, scan, state, hold, eased, reach, settings)
        state = state._replace(scale=_rescaled(template.rest, *state[:2]))
    return state


def _round(
    template: Template, scan: FacingTree, state: Deformed, hold, eased, reach, settings
):
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
        rotation = _from_around(rest, rotation, mass * ~flawed, MENDING_REACH)
    for _ in range(UPDATES):
        normal = sign * vertex_normals(moved, rest.mesh.faces)
        nearest = facing(
            scan, moved, normal, candidates=CANDIDATES, min_alike=MIN_ALIKE
        )
        drawn = nearest.distance < limit
        drawn &= rim | ~on_rim(scan.surface, nearest)
        force = factor * mass * drawn / reach**2
        there = np.where(drawn[:, None], nearest.position, 0)
        goal = force[:, None] * there + (factor * held)[:, None] * image
        moved = _solved(rest, rotation, scale, force + factor * held, goal, moved)
        rotation = rotations_of(rest, moved)
    return Deformed(moved, scale, drawn, sign)


def _around_flaws(template: Template, scan: FacingTree, state: Deformed):
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
    return solver(rest, weight + tiny)(((weight + tiny) * values.T).T)


def _solved(rest: Rest, rotation, scale: float, pull, goal, moved):
    """The positions (n, 3) of least energy for given rotations.

    Args:
        rest, rotation, scale: the template.
        pull: (n,) how much each vertex is drawn.
        goal: (n, 3) where to, times that.
        moved: (n, 3) where what is not drawn stays, unless its neighbours move it.
    """
    tiny = TINY * pull.mean()
    solve = solver(rest, pull + tiny)
    return deformed(rest, solve, rotation, scale, goal, tiny * moved)


def _rescaled(rest: Rest, moved, scale: float) -> float:
    """Half way to the scale that fits the edges best."""
    return (scale + fitted_scale(rest, moved, rotations_of(rest, moved))) / 2
