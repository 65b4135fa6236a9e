"""Two meshes laid over each other, by a map of vertices or by a registration.

A map gives each vertex of X one of Y, and says nothing of what lies between vertices.
X is registered to Y (`jfsf.apps.registration`): its vertices move onto Y's surface,
and each point of its faces goes along. What is carried is read at the nearest point.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jfsf.apps.registration import Registration, RegistrationSettings, register
from jfsf.matching._arguments import checked_map
from jfsf.mesh import unclear_winding
from jfsf.mesh._values import check_values, checked_mesh, mesh_arrays
from jfsf.mesh._winding import MAX_UNCLEAR
from jfsf.types import ArrayLike, Mesh

SAME = 1e-9  # of the size of a mesh: points that are one


class Overlay(NamedTuple):
    """X and Y, and where their vertices are when one lies on the other.

    mesh_x: gets what is carried; in its own coordinates, n_x vertices.
    mesh_y: has what is carried; in its own coordinates, n_y vertices.
    at_x: positions of X in common coordinates; nan for a vertex that has no place.
    at_y: positions of Y in common coordinates; nan for a vertex that has no place.
    known_x: whether Y has a surface for a vertex of X, which has a place.
    orientation_sign: -1 where the outer sides of both look away from each other, since
        the map mirrors; 0 if it is not known which side is outside.
    """

    mesh_x: Mesh
    mesh_y: Mesh
    at_x: Float[ArrayLike, "n_x 3"]
    at_y: Float[ArrayLike, "n_y 3"]
    known_x: Bool[ArrayLike, " n_x"]
    orientation_sign: int


def overlay(
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    matched_x: Bool[ArrayLike, " n_x"] | None = None,
    settings: RegistrationSettings = RegistrationSettings(),
) -> Overlay:
    """Lay X over Y, to carry what Y has to X.

    To carry from X to Y, exchange the meshes and give `T_yx` and `matched_y`.

    Args:
        mesh_x: gets what is carried. Of a point cloud each vertex is put on its image.
        mesh_y: has it; it may be a point cloud too.
        T_xy: the vertex of Y for each vertex of X, as `Match.T_xy`.
        matched_x: whether it counts, as `Match.matched_x` of `partial=True`; None:
            everywhere. Elsewhere X gets nothing.
        settings: settings of the registration.

    Returns:
        Both meshes, and X's vertices on Y, in Y's coordinates.

    Raises:
        MeshError: bad values, or a vertex of a mesh with faces that belongs to none.
        ValueError: T_xy or matched_x do not fit the meshes.
    """
    mesh_x, mesh_y = checked_mesh(mesh_x, "X"), checked_mesh(mesh_y, "Y")
    sizes = len(mesh_x.vertices), len(mesh_y.vertices)
    T_xy, matched = checked_map(T_xy, matched_x, sizes, caller="overlay")
    if len(mesh_x.faces) and len(mesh_y.faces):
        on_y = register(mesh_x, mesh_y, T_xy, matched=matched, settings=settings)
        at_x, sign = on_y.vertices, int(on_y.orientation_sign)
    else:
        at_x, sign = np.asarray(mesh_y.vertices, np.float64)[T_xy], 0
    at_y = np.asarray(mesh_y.vertices, np.float64)
    return Overlay(mesh_x, mesh_y, at_x, at_y, matched, _clear(mesh_x, mesh_y) * sign)


def overlay_template(template: Mesh, scan: Mesh, registration: Registration) -> Overlay:
    """A template that was registered to a scan: to carry what the template has.

    Args:
        template: Y of what is returned.
        scan: X of it: it gets what is carried.
        registration: of `jfsf.register(template, scan, T)`.

    Returns:
        Both meshes, and the template's vertices on the scan, in its coordinates.

    Raises:
        MeshError: bad values.
        ValueError: the registration is that of another template.
    """
    scan, template = checked_mesh(scan, "scan"), checked_mesh(template, "template")
    at_x = np.asarray(scan.vertices, np.float64)
    at_y = np.asarray(registration.vertices, np.float64)
    if at_y.shape != template.vertices.shape:
        raise ValueError(
            f"overlay_template: the registration has {len(at_y)} vertices, and the "
            f"template {len(template.vertices)}; give that of this template"
        )
    sign = _clear(scan, template) * int(registration.orientation_sign)
    return Overlay(scan, template, at_x, at_y, np.ones(len(at_x), bool), sign)


def extended(overlay: Overlay, mesh_x: Mesh, mesh_y: Mesh) -> Overlay:
    """Whole meshes in place of what was kept of them, as by a repair.

    Args:
        overlay: of what was kept.
        mesh_x, mesh_y: the whole meshes. A vertex lies where one at the same point was
            put, and has no place if none is there, or if it is not finite.

    Returns:
        Both meshes; the one whose coordinates are the common ones keeps its own.

    Raises:
        MeshError: arrays that are no mesh.
    """
    mesh_x, mesh_y = Mesh(*mesh_arrays(mesh_x, "X")), Mesh(*mesh_arrays(mesh_y, "Y"))
    check_values(*mesh_x, "X", finite=False)
    check_values(*mesh_y, "Y", finite=False)
    at_x, known_x = _places(overlay.mesh_x, overlay.at_x, mesh_x, overlay.known_x)
    at_y, _ = _places(
        overlay.mesh_y, overlay.at_y, mesh_y, np.ones(len(overlay.at_y), bool)
    )
    return Overlay(mesh_x, mesh_y, at_x, at_y, known_x, overlay.orientation_sign)


def _places(part: Mesh, at, whole: Mesh, known):
    """Positions of the vertices of the whole, and whether each is known."""
    own = np.asarray(part.vertices, np.float64)
    points = np.asarray(whole.vertices, np.float64)
    finite = np.asarray(np.isfinite(points).all(1))
    size = float(np.ptp(points[finite], axis=0).max(initial=0))
    away, near = KDTree(own).query(np.where(finite[:, None], points, 0))
    there = finite & (away <= SAME * size)
    if np.array_equal(own, at):
        return np.where(finite[:, None], points, np.nan), there & known[near]
    return np.where(there[:, None], at[near], np.nan), there & known[near]


def _clear(*meshes: Mesh) -> int:
    """1 if it is clear which side of the meshes is outside, else 0."""
    return int(all(unclear_winding(mesh) <= MAX_UNCLEAR for mesh in meshes))
