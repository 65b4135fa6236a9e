"""A template and a scan -> the template on the scan: checks and units. Host side."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jfsf.apps.registration._draw import RegistrationSettings, Template, draw
from jfsf.apps.registration._flaws import flaws_of
from jfsf.matching._arguments import checked_map
from jfsf.mesh import MeshError, closest, orient, surface_area, validate
from jfsf.mesh._closest import FacingTree, facing_tree, surface_tree
from jfsf.mesh._geometry import boundary_edges, vertex_areas, vertex_normals
from jfsf.refine._rest import at_rest
from jfsf.types import ArrayLike, Mesh

SAMPLES = 400  # neighbourhoods that scale and sign are read from
NORMAL_WEIGHT = 0.05  # distance that normals at an angle of 1 count for, in sqrt(area)
SCALE_NEIGHBOURS = 0.01  # share of the vertices in each of these


class Registration(NamedTuple):
    """A template on a scan. Lengths are in the unit of the scan.

    vertices: position of each vertex of the template on the scan, in the scan's
        coordinates. The faces are those of the template.
    distance: unsigned distance of each vertex to the nearest point of the scan's
        surface.
    bridged: whether the scan has no surface for a vertex: its nearest point lies on the
        scan's boundary, or nothing near faces the same way. There the template keeps
        its own form.
    on_face: the face of the scan on which the nearest point of each vertex lies.
    barycentric: barycentric coordinates of the nearest point on the face `on_face`.
    flipped: number of faces whose normal is more than a right angle from where their
        surroundings turn it, and from the normal of the scan there.
    collapsed: number of faces with less than 1e-4 of their area at rest, at the scale
        `scale`.
    scale: factor of the template's lengths.
    orientation_sign: -1 if the template was mirrored because the map mirrors, else 1.
        Faces of a mirrored template point inward: wind them as `faces[:, ::-1]`.
    """

    vertices: Float[ArrayLike, "n 3"]
    distance: Float[ArrayLike, " n"]
    bridged: Bool[ArrayLike, " n"]
    on_face: Int[ArrayLike, " n"]
    barycentric: Float[ArrayLike, "n 3"]
    flipped: Int[ArrayLike, ""]
    collapsed: Int[ArrayLike, ""]
    scale: Float[ArrayLike, ""]
    orientation_sign: Int[ArrayLike, ""]


def register(
    template: Mesh,
    scan: Mesh,
    T: Int[ArrayLike, " n"],
    *,
    matched: Bool[ArrayLike, " n"] | None = None,
    orientation_sign: int | None = None,
    settings: RegistrationSettings = RegistrationSettings(),
) -> Registration:
    """Deform a template onto a scan, as rigid as possible, from a map to the scan.

    Scans that one template is registered to have one topology: vertex i is the same
    place on all. What follows from the map is where the template lies on the whole; it
    is smoothed, and the template lies on the surface, not on its vertices. The method
    is that of non-rigid iterative closest points with an energy of Sorkine and Alexa
    (SGP 2007): stiff at first, softer round by round. Holes of the scan are bridged.

    Args:
        template: its faces are kept. Several pieces, and a boundary, are allowed.
        scan: any unit and size; holes and a boundary are allowed.
        T: the vertex of the scan for each vertex of the template, such as the T_xy of
            `jfsf.match(template, scan)`.
        matched: for each vertex of the template, whether T counts, such as
            `Match.matched_x` of `partial=True`; everywhere if None. Elsewhere the
            template keeps its form, unless it happens to lie near the scan.
        orientation_sign: -1 for a T that mirrors, 1 for one that does not; read from T
            if None.
        settings: how stiff the template is in each round.

    Returns:
        Positions, distances and what is bridged, in float64. If the scan is scaled,
        translated or rotated, so is the result.

    Raises:
        MeshError: a mesh without faces or with bad values, or a vertex without a face.
        ValueError: T or matched that do not fit the meshes, or another sign.
    """
    for name, mesh in (("template", template), ("scan", scan)):
        validate(mesh, name=name, components=False)
        if len(mesh.faces) == 0:
            raise MeshError(
                "has no faces, and registration needs a surface",
                "triangulate it (jfsf.mesh.reconstruct)",
                name,
            )
    T, matched = checked_map(
        T,
        matched,
        (len(template.vertices), len(scan.vertices)),
        caller="register",
        called=("T", "matched"),
        names=("the template", "the scan"),
    )
    if matched.sum() < 4:
        raise ValueError(
            f"register: T counts at {matched.sum()} vertices; more must be matched"
        )
    if orientation_sign not in (None, 1, -1):
        raise ValueError(
            f"register: orientation_sign is {orientation_sign!r}; give 1, -1 or None"
        )
    onto, place = _in_own_unit(scan)
    alone, own = _in_own_unit(template)
    first_scale, sign = scale_and_sign(
        alone.vertices[matched], onto.vertices[T[matched]]
    )
    sign = sign if orientation_sign is None else orientation_sign
    wound = orient(alone)
    rest = at_rest(Mesh(wound.vertices * first_scale, wound.faces), sign)
    rim = np.zeros(len(T), bool)
    rim[boundary_edges(wound.faces)] = True
    whole = Template(rest, vertex_areas(*rest.mesh), rim, matched)
    target = scan_of(orient(onto))
    moved, scale, drawn, side = draw(whole, target, T, settings)
    flaws = flaws_of(rest, moved, scale, target, side)
    # Faces as the scan has them, so that the corners keep their order.
    below = closest(target.surface._replace(mesh=onto), moved)
    return Registration(
        moved * place.unit + place.middle,
        below.distance * place.unit,
        ~drawn,
        below.face,
        below.barycentric,
        np.asarray(flaws.flipped.sum()),
        np.asarray(flaws.collapsed.sum()),
        np.asarray(first_scale * scale * place.unit / own.unit),
        np.asarray(sign),
    )


def scale_and_sign(vertices, images) -> tuple[float, int]:
    """Factor of the template's lengths, and -1 for a map that mirrors, else 1.

    They are read in small neighbourhoods, since the shape as a whole bends: the scale
    is the median of what the map stretches these by, the sign that of most of their
    volume.

    Args:
        vertices: (n, 3) of the template.
        images: (n, 3) their images.
    """
    n = len(vertices)
    size = min(n, max(12, round(SCALE_NEIGHBOURS * n)))
    at = np.unique(np.linspace(0, n - 1, min(n, SAMPLES)).round().astype(int))
    near = np.asarray(KDTree(vertices).query(vertices[at], size)[1])
    here, there = (p[near] - p[near].mean(1, keepdims=True) for p in (vertices, images))
    before, after = ((one**2).sum((1, 2)) for one in (here, there))
    scale = np.sqrt(np.median(after / np.maximum(before, 1e-300)))
    spread = np.einsum("skc,skd->scd", there, here)
    least = np.linalg.svd(spread, compute_uv=False)[:, 2]
    side = np.sum(np.sign(np.linalg.det(spread)) * least)
    return float(scale), -1 if side < 0 else 1


class _Place(NamedTuple):
    """Of a mesh: sqrt(area), and the mean of its surface."""

    unit: float
    middle: np.ndarray


def _in_own_unit(mesh: Mesh) -> tuple[Mesh, _Place]:
    """Centred, with area 1."""
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    weight = vertex_areas(vertices, faces)
    middle = weight @ vertices / weight.sum()
    unit = np.sqrt(surface_area(Mesh(vertices, faces)))
    return Mesh((vertices - middle) / unit, faces), _Place(float(unit), middle)


def scan_of(mesh: Mesh) -> FacingTree:
    """A scan, wound alike everywhere, in the unit of its sqrt(area)."""
    surface = surface_tree(mesh)
    return facing_tree(surface, vertex_normals(*surface.mesh), NORMAL_WEIGHT)
