"""A template and a scan to the template on the scan."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jfsf.mesh import (
    boundary_edges,
    closest,
    orient,
    surface_area,
    vertex_areas,
)
from jfsf.refine import at_rest
from jfsf.registration._draw import Template, draw
from jfsf.registration._flaws import flaws_of
from jfsf.registration._scan import scan_of
from jfsf.registration._settings import RegistrationSettings
from jfsf.registration._start import start_of
from jfsf.types import ArrayLike, Mesh


class Registration(NamedTuple):
    """A template on a scan."""

    vertices: Float[ArrayLike, "n 3"]
    distance: Float[ArrayLike, " n"]
    bridged: Bool[ArrayLike, " n"]
    on_face: Int[ArrayLike, " n"]
    barycentric: Float[ArrayLike, "n 3"]
    flipped: int
    collapsed: int
    scale: float
    orientation_sign: int


def register(
    template: Mesh,
    scan: Mesh,
    T: Int[ArrayLike, " n"],
    *,
    settings: RegistrationSettings = RegistrationSettings(),
) -> Registration:
    """Deform a template onto a scan, by a map from it."""
    T = np.asarray(T)
    unit = np.sqrt(surface_area(scan))
    middle = np.asarray(scan.vertices, float).mean(0)
    onto = Mesh((scan.vertices - middle) / unit, scan.faces)
    start = start_of(
        np.asarray(template.vertices, float) / np.sqrt(surface_area(template)),
        onto.vertices[T],
        settings,
    )
    factor = start.scale / np.sqrt(surface_area(template))
    wound = orient(Mesh(np.asarray(template.vertices, float), template.faces))
    middle_t = wound.vertices.mean(0)
    rest = at_rest(Mesh((wound.vertices - middle_t) * factor, wound.faces), start.sign)
    own_rim = np.zeros(len(T), bool)
    own_rim[boundary_edges(wound.faces)] = True
    target = scan_of(orient(onto), settings)
    whole = Template(rest, vertex_areas(*rest.mesh), own_rim)
    found = draw(whole, target, T, np.ones(len(T), bool), settings)
    flaws = flaws_of(rest, found.moved, found.scale)
    surface = target.surface._replace(mesh=onto)
    below = closest(surface, found.moved)
    return Registration(
        found.moved * unit + middle,
        below.distance * unit,
        ~found.drawn,
        below.face,
        below.barycentric,
        int(flaws.flipped.sum()),
        int(flaws.collapsed.sum()),
        found.scale * factor * unit,
        start.sign,
    )
