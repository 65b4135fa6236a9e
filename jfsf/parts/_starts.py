"""From where two shapes of which one is a part may be drawn together. Host side.

Each start is an assignment of a few samples (`_beam`), and a coarse copy of Y drawn
onto X by it (`_register`). What is left apart, the energy, and the share of Y that is
used rank the starts.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jfsf.mesh import decimate, orient, surface_area, vertex_normals
from jfsf.parts._beam import assign
from jfsf.parts._region import dense_map, near_vertices, outward, scaled
from jfsf.parts._register import Registered, Whole, register, whole_at_rest
from jfsf.parts._settings import PartSettings
from jfsf.parts._shape import PartSamples, part_samples
from jfsf.types import Mesh


class Sides(NamedTuple):
    """Both shapes in the unit of Y, and coarse copies of both.

    coarse_x: the copy of X.
    whole: that of Y.
    on_x: the vertex of X nearest to each of its copy.
    from_y: the vertex of the copy nearest to each of Y.
    sign: -1 for maps that mirror, and the whole is mirrored.
    """

    x: PartSamples
    y: PartSamples
    coarse_x: Mesh
    whole: Whole
    on_x: np.ndarray
    from_y: np.ndarray
    sign: int
    settings: PartSettings


class Start(NamedTuple):
    """An assignment, and Y drawn onto X by it.

    scale: of X, in the assignment.
    rank: by the weights of `RegisterWeights`. Small is good.
    """

    scale: float
    registered: Registered
    rank: float


def both_sides(mesh_x: Mesh, mesh_y: Mesh, *, settings: PartSettings) -> Sides:
    """For maps that keep left and right."""
    unit = np.sqrt(surface_area(mesh_y))

    def in_unit(mesh):
        own = orient(mesh)
        return Mesh(np.asarray(own.vertices, float) / unit, np.asarray(own.faces))

    x = part_samples(in_unit(mesh_x), settings.samples_of_part, settings=settings)
    y = part_samples(in_unit(mesh_y), settings.samples_of_whole, settings=settings)
    coarse_x = decimate(x.mesh, settings.coarse_part)
    coarse_y = decimate(y.mesh, settings.coarse_whole)
    on_x = near_vertices(x.mesh, coarse_x)
    out = outward(coarse_y, vertex_normals(*coarse_y))
    whole = whole_at_rest(coarse_y, out)
    from_y = near_vertices(coarse_y, y.mesh)
    return Sides(x, y, coarse_x, whole, on_x, from_y, 1, settings)


def mirrored(sides: Sides) -> Sides:
    """For maps that exchange left and right."""
    mesh, out = sides.whole.mesh, sides.whole.outward
    return sides._replace(whole=whole_at_rest(mesh, out, -1), sign=-1)


def starts(sides: Sides) -> Iterator[Start]:
    """Of the assignments."""
    x, y, settings = sides.x, sides.y, sides.settings
    assigned = assign(x, y, orientation=sides.sign, settings=settings)
    for partner, scale in zip(assigned.partner, assigned.scale, strict=True):
        T_xy = dense_map(x, y, assigned.which, partner, scale, settings=settings)
        part, T = scaled(sides.coarse_x, scale), sides.from_y[T_xy[sides.on_x]]
        found = register(sides.whole, part, T, settings=settings)
        yield Start(float(scale), found, _rank(found, settings))


def _rank(found: Registered, settings: PartSettings) -> float:
    weights = settings.register_weights[:3]
    figures = found.residual, found.energy, found.share
    logs = (np.log(max(float(f), 1e-6)) for f in figures)
    return sum(w * log for w, log in zip(weights, logs, strict=True))
