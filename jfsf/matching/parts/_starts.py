"""From where two shapes of which one is a part may be drawn together. Host side.

Each start is an assignment of a few samples (`_beam`), a rigid motion (`_alignments`),
of people the map between likely places (`jfsf.learned`), or a map that is given; and a
coarse copy of Y drawn onto X by it (`_register`). What is left apart, the energy, the
share of Y that is used, and the agreement with the places rank the starts. The best are
drawn once more, in all steps and from where they came to: one that begins a tenth of
the shape off is then still on its way.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from jfsf.geometry import GeodesicSolver
from jfsf.learned import agreement, best_agreement
from jfsf.matching.parts._alignments import aligned
from jfsf.matching.parts._beam import anchors_of, assign
from jfsf.matching.parts._register import REACHES, Registered, register
from jfsf.matching.parts._samples import along_cut
from jfsf.matching.parts._sides import Sides, mirrored
from jfsf.matching.parts._surfaces import scaled
from jfsf.mesh._closest import nearest_vertices
from jfsf.mesh._geometry import vertex_areas
from jfsf.types import ArrayLike

# In sqrt(area of the whole): distance from an anchor below which its weight for the
# first dense map levels off.
ANCHOR_RADIUS = 0.05
# In sqrt(area of the whole): a start misses a landmark whose image is farther than this
# from where it should be. Those that miss more than others are dropped.
MAX_LANDMARK_DISTANCE = 0.15
SEEN = 0.3  # agreement from which on the map between places is trusted; by hand
FEW = 10  # distances, from which on their ratio is read


class RankWeights(NamedTuple):
    """Weights of what ranks starts and maps; a small sum is good.

    The first three make `Certificate.region_cost`, and the confidence of parts was
    fitted to it by these numbers. All are fitted by `experiments/fit/fit_parts.py`.

    residual: of the logarithm of `Registered.residual`.
    energy: of the logarithm of `Registered.energy`.
    share: of the logarithm of `Registered.share`.
    agreement: of `Start.agreement`, where there are places.
    log_odds: of the log odds of the refined map between the regions.
    size: of the logarithm of the factor of the part's lengths, read only where units
        may differ. A small part leaves little apart, wherever it lies.
    """

    residual: float = 7.68
    energy: float = 1.0
    share: float = -1.68
    agreement: float = -4.19
    log_odds: float = -0.16
    size: float = -1.24


WEIGHTS = RankWeights()


class Start(NamedTuple):
    """Y drawn onto X by an assignment, a rigid motion, or a map that is given.

    scale: factor of X's lengths that the start has.
    cost: of the drawing, by `RankWeights`. Small is good.
    agreement: mean of `jfsf.learned.agreement` over the covered points of X; nan
        without places.
    rank: the cost, with the weighted agreement where there is one and the weighted size
        where units may differ.
    missed: landmarks whose image is more than `MAX_LANDMARK_DISTANCE` from where it
        should be.
    """

    scale: float
    registered: Registered
    cost: float
    agreement: float
    rank: float
    missed: int = 0


def starts(
    sides: Sides, progress: Callable[[str], object] | None = None
) -> Iterator[Start]:
    """Of the assignments, and of the rigid motions.

    Args:
        sides: both shapes.
        progress: called with the name of each step as it begins.
    """
    say = progress or (lambda name: None)
    say("assignments")
    assigned = _assigned(sides)
    say("rigid motions")
    motions = aligned(
        sides.coarse_x,
        sides.whole,
        sides.settings.alignments,
        same_unit=sides.same_unit,
    )
    maps = [*assigned, *((T, scale, None) for T, scale in motions)]
    maps += _by_places(sides)
    # Every second step, the last among them, tells the best.
    draw = partial(_start, sides, reaches=REACHES[::-1][::2][::-1])
    name = f"of {len(maps)}"
    yield from _at_once(draw, maps, lambda i: say(f"registration {i + 1} {name}"))


def _assigned(sides: Sides) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """A map from the copy of X to that of Y, the scale, and where it is known.

    Of each assignment. It is known at points whose nearest anchor has a partner.
    """
    x, y = sides.x, sides.y
    assigned = assign(
        x,
        y,
        orientation=sides.sign,
        same_unit=sides.same_unit,
        settings=sides.settings,
    )
    from_x = x.distance[np.ix_(assigned.which, sides.on_x)]
    maps = []
    each = zip(assigned.partner, assigned.scale.tolist(), strict=True)
    for partner, scale in each:
        there = partner >= 0
        from_y = y.distance[np.ix_(partner[there], sides.on_y)]
        T = _by_distances(scale * from_x[there], from_y)
        maps.append((T, scale, there[from_x.argmin(0)]))
    return maps


def _by_places(sides: Sides) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """As `_assigned`: where the places on a person agree best. Empty without places."""
    if sides.places is None:
        return []
    T = best_agreement(*sides.places)
    near = nearest_vertices(sides.coarse_x, sides.x.mesh)
    seen = agreement(T, *sides.places) > SEEN
    return [(T, scale_of(sides, sides.on_y[T[near]]), seen)]


def _at_once(draw: Callable, given: Iterable, say: Callable) -> Iterator[Start]:
    """`draw` of each, on all cores; `say` is told its number before it is there."""
    # They spend their time in libraries that let other threads run.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for i, start in enumerate([pool.submit(draw, *own) for own in given]):
            say(i)
            yield start.result()


def first_starts(
    both: Sides,
    sign: int,
    T_xy: ArrayLike | None = None,
    progress: Callable[[str], object] | None = None,
) -> list[tuple[Sides, Start]]:
    """The best first, without those that miss more landmarks than others.

    Args:
        both: sides for maps that keep left and right.
        sign: 1 for these maps, -1 for those that mirror, 0 for both.
        T_xy: a map that is to be the only start, whatever `sign` says.
        progress: as `starts`.
    """
    say = progress or (lambda name: None)
    begin = []
    if T_xy is not None:
        # Which way round it is shows in how much the whole bends by it.
        for sides in (both, mirrored(both)):
            say("registration of the initial map")
            begin.append((sides, start_of(sides, np.asarray(T_xy))))
        return [min(begin, key=lambda pair: pair[1].rank)]
    for way in (1, -1) if sign == 0 else (sign,):
        sides = both if way > 0 else mirrored(both)
        begin += [(sides, start) for start in starts(sides, progress)]
    order = lambda pair: (pair[1].missed, pair[1].rank)
    least = min(start.missed for _, start in begin)
    begin = sorted((p for p in begin if p[1].missed == least), key=order)
    best = begin[: both.settings.registered_again]
    name = f"of {len(best)} again"
    further = _at_once(start_from, best, lambda i: say(f"registration {i + 1} {name}"))
    again = [(sides, new) for (sides, _), new in zip(best, further, strict=True)]
    better = [min(two, key=order) for two in zip(best, again, strict=True)]
    return sorted([*better, *begin[len(best) :]], key=order)


def start_from(sides: Sides, start: Start) -> Start:
    """Y, at rest again, drawn onto X by the map and the size that a start has found.

    That map is known where Y covers X.
    """
    before = start.registered
    return _start(sides, before.T, start.scale / before.scale, before.covered)


def start_of(sides: Sides, T_xy: np.ndarray, scale: float | None = None) -> Start:
    """Of one map.

    Args:
        sides: both shapes.
        T_xy: the vertex of Y for each vertex of X, right or nearly so.
        scale: factor of X's lengths; when absent, that of the map (`scale_of`).
    """
    scale = scale_of(sides, T_xy) if scale is None else scale
    T = sides.from_y[T_xy[sides.on_x]]
    return _start(sides, T, scale)


def _start(
    sides: Sides,
    T: np.ndarray,
    scale: float,
    trusted: np.ndarray | None = None,
    *,
    reaches: Sequence[float] | None = None,
) -> Start:
    """Of a map T from the copy of X to that of Y, right where it is `trusted`."""
    part = scaled(sides.coarse_x, scale)
    curved = sides.curvature_x(scale)[sides.on_x], sides.curvature_y[sides.on_y]
    options = {"curvature": curved, "reaches": reaches or REACHES}
    registered = register(sides.whole, part, T, trusted, **options)
    cost = rank = cost_of(registered)
    agreed = np.nan
    if sides.places is not None:
        covered = vertex_areas(*sides.coarse_x) * registered.covered
        each = agreement(registered.T, *sides.places)
        agreed = float(np.average(each, weights=covered))
        rank += WEIGHTS.agreement * agreed
    if not sides.same_unit:
        rank += WEIGHTS.size * float(np.log(scale / registered.scale))
    missed = _missed(sides, registered)
    return Start(scale, registered, cost, agreed, rank, missed)


def cost_of(registered: Registered, weights: RankWeights = WEIGHTS) -> float:
    """What `Start.cost` is: the weighted logarithms of residual, energy and share."""
    figures = registered.residual, registered.energy, registered.share
    logs = (np.log(max(float(f), 1e-6)) for f in figures)
    return float(sum(w * log for w, log in zip(weights[:3], logs, strict=True)))


def _by_distances(from_x: np.ndarray, from_y: np.ndarray) -> np.ndarray:
    """T: for points of X, that of Y as far from the partners as they from the anchors.

    Near anchors count most.

    Args:
        from_x: (a, p) distances of points of X from the anchors, in the unit of Y.
        from_y: (a, q) those of points of Y from their partners.
    """
    weight = 1 / (from_x + ANCHOR_RADIUS) ** 2
    weight /= weight.sum(0)
    apart = weight.T @ from_y**2 - 2 * (weight * from_x).T @ from_y
    return apart.argmin(1)


def scale_of(sides: Sides, T_xy: np.ndarray) -> float:
    """The factor of X's lengths that a map tells.

    It is the median ratio of geodesic distances on Y, of the images of the anchors, to
    those on X; where both are in one unit, in the range of `PartSettings.scales`. Paths
    along a cut do not count. Edges would say less: an image is off by the distance of
    two vertices of Y. 1 where fewer than `FEW` distances are left, or where the images
    are all in one place.

    Args:
        sides: both shapes.
        T_xy: the vertex of Y for each vertex of X.
    """
    x, settings = sides.x, sides.settings
    which = anchors_of(x, settings.anchors)
    images = T_xy[x.at[which]]
    far_x = x.between[np.ix_(which, which)]
    far_y = GeodesicSolver(sides.y.mesh).rows(images)[:, images]
    counts = ~along_cut(x.around[np.ix_(which, which)], far_x)
    counts &= (far_x > 0) & (far_y > 0)
    if counts.sum() < 2 * FEW:  # each distance is there twice
        return 1.0
    ratio = float(np.median(far_y[counts] / far_x[counts]))
    if not sides.same_unit:
        return ratio
    return float(np.clip(ratio, min(settings.scales), max(settings.scales)))


def _missed(sides: Sides, registered: Registered) -> int:
    x, y = sides.x, sides.y
    near = x.distance[x.landmarks][:, sides.on_x].argmin(1)
    images = sides.on_y[registered.T[near]]
    away = y.distance[y.landmarks, images]
    return int(np.sum(away > MAX_LANDMARK_DISTANCE))
