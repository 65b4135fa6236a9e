"""From where two shapes of which one is a part may be drawn together. Host side.

Each start is an assignment of a few samples (`_beam`), or a map that is given, and a
coarse copy of Y drawn onto X by it (`_register`). What is left apart, the energy, and
the share of Y that is used rank the starts. The best are drawn once more, from where
they came to: one that begins a tenth of the shape off is then still on its way.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jfsf.geometry import GeodesicSolver
from jfsf.mesh import decimate, orient, surface_area, vertex_normals
from jfsf.parts._beam import anchors_of, assign
from jfsf.parts._curvature import curvature, standard_curvature, usual_curvature
from jfsf.parts._region import near_vertices, outward, scaled
from jfsf.parts._register import Registered, Whole, register, whole_at_rest
from jfsf.parts._settings import PartSettings
from jfsf.parts._shape import PartSamples, along_cut, part_samples
from jfsf.types import ArrayLike, Mesh

# Of distances, from which on their ratio is read.
FEW = 10


class Sides(NamedTuple):
    """Both shapes in the unit of Y, and coarse copies of both.

    coarse_x: the copy of X.
    whole: that of Y.
    on_x: the vertex of X nearest to each of its copy.
    from_y: the vertex of the copy nearest to each of Y.
    on_y: the vertex of Y nearest to each of its copy.
    usual_curvature: (times,) of Y, see `jfsf.parts._curvature`.
    curvature_y: (n_y, times) of Y in these units.
    sign: -1 for maps that mirror, and the whole is mirrored.
    settings: with the scales that are tried.
    same_unit: whether both shapes were in one unit.
    """

    x: PartSamples
    y: PartSamples
    coarse_x: Mesh
    whole: Whole
    on_x: np.ndarray
    from_y: np.ndarray
    on_y: np.ndarray
    usual_curvature: np.ndarray
    curvature_y: np.ndarray
    sign: int
    settings: PartSettings
    same_unit: bool = True

    def curvature_x(self, scale: float) -> np.ndarray:
        """(n_x, times) of X at that size, like `curvature_y`."""
        own = curvature(scaled(self.x.mesh, scale), self.settings.curvature_times)
        return standard_curvature(own, self.usual_curvature, self.settings)


class Start(NamedTuple):
    """An assignment, and Y drawn onto X by it.

    scale: of X, in the assignment.
    cost: of the drawing, by the weights of `RegisterWeights`. Small is good.
    rank: the same; where units may differ, with that of the size.
    missed: landmarks whose image is far from where it should be, see
        `PartSettings.max_landmark_distance`.
    """

    scale: float
    registered: Registered
    cost: float
    rank: float
    missed: int = 0


def both_sides(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    landmarks: ArrayLike | None = None,
    descriptors: tuple[ArrayLike, ArrayLike] | None = None,
    same_unit: bool = True,
    settings: PartSettings,
) -> Sides:
    """For maps that keep left and right.

    Args:
        mesh_x, mesh_y: both shapes.
        landmarks: rows (vertex of X, vertex of Y).
        descriptors: of X and of Y, a row a vertex.
        same_unit: whether both are in one unit; else any size of X is as likely.
        settings: how many samples, and the sizes of the copies.
    """
    if not same_unit:
        settings = replace(
            settings,
            scales=settings.any_scales,
            scale_bands=settings.any_scale_bands,
            scale_weight=0.0,
        )
    unit = np.sqrt(surface_area(mesh_y))
    at = ((), ()) if landmarks is None else np.asarray(landmarks).T
    given = (None, None) if descriptors is None else descriptors

    def in_unit(mesh):
        own = orient(mesh)
        return Mesh(np.asarray(own.vertices, float) / unit, np.asarray(own.faces))

    nums = settings.samples_of_part, settings.samples_of_whole
    x, y = (
        part_samples(
            in_unit(mesh), num, landmarks=own, descriptors=desc, settings=settings
        )
        for mesh, num, own, desc in zip((mesh_x, mesh_y), nums, at, given, strict=True)
    )
    coarse_x = decimate(x.mesh, settings.coarse_part)
    coarse_y = decimate(y.mesh, settings.coarse_whole)
    on_x = near_vertices(x.mesh, coarse_x)
    out = outward(coarse_y, vertex_normals(*coarse_y))
    whole = whole_at_rest(coarse_y, out)
    from_y, on_y = near_vertices(coarse_y, y.mesh), near_vertices(y.mesh, coarse_y)
    copies = coarse_x, whole, on_x, from_y, on_y
    curved = curvature(y.mesh, settings.curvature_times)
    usual = usual_curvature(curved)
    curved = standard_curvature(curved, usual, settings)
    return Sides(x, y, *copies, usual, curved, 1, settings, same_unit)


def mirrored(sides: Sides) -> Sides:
    """For maps that exchange left and right."""
    mesh, out = sides.whole.mesh, sides.whole.outward
    return sides._replace(whole=whole_at_rest(mesh, out, -1), sign=-1)


def starts(
    sides: Sides, progress: Callable[[str], object] | None = None
) -> Iterator[Start]:
    """Of the assignments.

    Args:
        sides: both shapes.
        progress: called with the name of each step as it begins.
    """
    x, y, settings = sides.x, sides.y, sides.settings
    say = progress or (lambda name: None)
    say("assignments")
    assigned = assign(x, y, orientation=sides.sign, settings=settings)
    from_x = x.distance[np.ix_(assigned.which, sides.on_x)]
    curvature_of = {s: sides.curvature_x(s) for s in set(assigned.scale.tolist())}

    def start(partner: np.ndarray, scale: float) -> Start:
        there = partner >= 0
        from_y = y.distance[np.ix_(partner[there], sides.on_y)]
        T = _by_distances(scale * from_x[there], from_y, settings)
        return _start(sides, T, scale, curvature_of[scale])

    given = list(zip(assigned.partner, assigned.scale.tolist(), strict=True))
    num = len(given)
    yield from _at_once(start, given, lambda i: say(f"registration {i + 1} of {num}"))


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
    """Y, at rest again, drawn onto X by the map and the size that a start has found."""
    scale = start.scale / start.registered.scale
    return _start(sides, start.registered.T, scale, sides.curvature_x(scale))


def start_of(sides: Sides, T_xy: np.ndarray, scale: float | None = None) -> Start:
    """Of one map.

    Args:
        sides: both shapes.
        T_xy: the vertex of Y for each vertex of X, right or nearly so.
        scale: factor of X's lengths; when absent, that of the map (`scale_of`).
    """
    scale = scale_of(sides, T_xy) if scale is None else scale
    T = sides.from_y[T_xy[sides.on_x]]
    return _start(sides, T, scale, sides.curvature_x(scale))


def _start(sides: Sides, T: np.ndarray, scale: float, curvature_x: np.ndarray) -> Start:
    """Of a map T from the copy of X to that of Y."""
    settings, part = sides.settings, scaled(sides.coarse_x, scale)
    curved = curvature_x[sides.on_x], sides.curvature_y[sides.on_y]
    found = register(sides.whole, part, T, curvature=curved, settings=settings)
    cost = rank = _cost(found, settings)
    if not sides.same_unit:
        rank += settings.register_weights.size * float(np.log(scale / found.scale))
    return Start(scale, found, cost, rank, _missed(sides, found))


def _by_distances(
    from_x: np.ndarray,
    from_y: np.ndarray,
    settings: PartSettings,
) -> np.ndarray:
    """T: for points of X, that of Y as far from the partners as they from the anchors.

    Near anchors count most.

    Args:
        from_x: (a, p) distances of points of X from the anchors, in the unit of Y.
        from_y: (a, q) those of points of Y from their partners.
        settings: how much near anchors count.
    """
    weight = 1 / (from_x + settings.anchor_radius) ** 2
    weight /= weight.sum(0)
    apart = weight.T @ from_y**2 - 2 * (weight * from_x).T @ from_y
    return apart.argmin(1)


def scale_of(sides: Sides, T_xy: np.ndarray) -> float:
    """The factor of X's lengths that a map tells.

    It is the median ratio of geodesic distances on Y, of the images of the anchors, to
    those on X, in the range of `PartSettings.scales`. Paths along a cut do not count.
    Edges would say less: an image is off by the distance of two vertices of Y. 1 where
    fewer than `FEW` distances are left, or where the images are all in one place.

    Args:
        sides: both shapes.
        T_xy: the vertex of Y for each vertex of X.
    """
    x, settings = sides.x, sides.settings
    which = anchors_of(x, settings)
    images = T_xy[x.at[which]]
    far_x = x.between[np.ix_(which, which)]
    far_y = GeodesicSolver(sides.y.mesh).rows(images)[:, images]
    counts = ~along_cut(x.around[np.ix_(which, which)], far_x, settings)
    counts &= (far_x > 0) & (far_y > 0)
    if counts.sum() < 2 * FEW:  # each distance is there twice
        return 1.0
    ratio = float(np.median(far_y[counts] / far_x[counts]))
    return float(np.clip(ratio, min(settings.scales), max(settings.scales)))


def _missed(sides: Sides, found: Registered) -> int:
    x, y = sides.x, sides.y
    near = x.distance[x.landmarks][:, sides.on_x].argmin(1)
    images = sides.on_y[found.T[near]]
    away = y.distance[y.landmarks, images]
    return int(np.sum(away > sides.settings.max_landmark_distance))


def _cost(found: Registered, settings: PartSettings) -> float:
    weights = settings.register_weights[:3]
    figures = found.residual, found.energy, found.share
    logs = (np.log(max(float(f), 1e-6)) for f in figures)
    return float(sum(w * log for w, log in zip(weights, logs, strict=True)))
