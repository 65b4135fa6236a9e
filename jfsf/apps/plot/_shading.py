"""Shapes as the viewer sees them: turned, lit and shaded."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.apps.plot._colours import Up, frame, points_of
from jfsf.apps.plot._upright import find_frame, find_frames
from jfsf.mesh import vertex_normals
from jfsf.mesh._geometry import face_areas
from jfsf.types import ArrayLike, Mesh

_TURN = 20.0  # degrees: a little from the side
_FROM_SIDE = 55.0  # for an animal, whose face hides the rest of it
_LONG = 2.2  # depth over width, of a body that is turned more
_TILT = 8.0  # from a little above


class View(NamedTuple):
    """A shape as the viewer sees it, scaled to area 1.

    body: (n, 3), right, up and front of the shape itself.
    xy: (n, 2), right and up on the page, from (0, 0).
    depth: (n,), towards the viewer.
    normals: (n, 3), right, up and towards the viewer; those of a point cloud point to
        the viewer.
    sky: (n,), the share of light that its surroundings let through to a vertex.
    faces: (m, 3).
    """

    body: np.ndarray
    xy: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    sky: np.ndarray
    faces: np.ndarray


def look(mesh: Mesh, *, up: Up | None = None, turn: float | None = None) -> View:
    """One shape, in the frame found for it or with this axis up."""
    points_of(mesh.vertices)
    axes = frame(up) if up else find_frame(mesh).axes
    if turn is None:
        turn = natural_turn(np.asarray(mesh.vertices) @ axes)
    return _view(mesh, axes, turn)


def look_at_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    up: Up | None = None,
    turn: float | None = None,
) -> tuple[View, View]:
    """Two shapes from one side."""
    for mesh in (mesh_x, mesh_y):
        points_of(mesh.vertices)
    if up:
        axes_x = axes_y = frame(up)
    else:
        axes_x, axes_y = (f.axes for f in find_frames(mesh_x, mesh_y, T_xy))
    if turn is None:
        shapes = (mesh_x, axes_x), (mesh_y, axes_y)
        turn = natural_turn(*(np.asarray(m.vertices) @ axes for m, axes in shapes))
    return _view(mesh_x, axes_x, turn), _view(mesh_y, axes_y, turn)


def lit(
    colours: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    sky: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Colours under a key light, a fill light and ambient light (Lambert)."""
    # Key light from the upper left, fill from the right. Light beyond 1 adds white,
    # like a soft highlight.
    key, fill = np.array([-0.45, 0.55, 0.75]), np.array([0.8, 0.1, 0.5])
    light = 0.42 + 0.62 * np.clip(normals @ key / np.linalg.norm(key), 0, 1)
    light += 0.18 * np.clip(normals @ fill / np.linalg.norm(fill), 0, 1)
    light = (light * sky)[:, None]
    return np.clip(colours * np.minimum(light, 1) + np.clip(light - 1, 0, 1), 0, 1)


def natural_turn(*bodies: Float[np.ndarray, "n 3"]) -> float:
    """Degrees by which to turn shapes to their right: more for long ones, as horses.

    Args:
        bodies: points of each shape, their axes right, up and front.
    """
    # By the spread: an arm that points to the viewer is not a long body.
    across, _, depth = np.mean([body.std(0) for body in bodies], 0)
    share = float(np.clip(depth / max(across, 1e-9) - _LONG, 0, 1))
    return _TURN + (_FROM_SIDE - _TURN) * share


def _view(mesh, axes, turn) -> View:
    body = points_of(mesh.vertices) @ axes
    faces = np.asarray(mesh.faces).reshape(-1, 3)
    turn, tilt = np.radians([turn, _TILT])
    c, s = np.cos(turn), np.sin(turn)
    points = body @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    c, s = np.cos(tilt), np.sin(tilt)
    points = points @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])

    size = np.sqrt(face_areas(points, faces).sum())
    if size == 0:
        size = 2.6 * np.linalg.norm(points.std(0))
    points = (points - points.min(0)) / (size or 1)
    normals = vertex_normals(points, faces)
    normals[~normals.any(1)] = [0, 0, 1]  # towards the eye
    sky = _sky(points, normals)
    return View(body, points[:, :2], points[:, 2], normals, sky, faces)


def _sky(points, normals):
    # Nearby points in front of the tangent plane take light away: without this the
    # inside of a mouth is as bright as a cheek. About 5000 points represent the shape.
    some = points[:: -(-len(points) // 5000)]
    distance, near = KDTree(some).query(points, min(64, len(some)), workers=1)
    distance, near = distance.reshape(len(points), -1), near.reshape(len(points), -1)
    rise = np.einsum("nkd,nd->nk", some[near] - points[:, None], normals)
    rise = np.clip(rise / np.maximum(distance, 1e-12), 0, 1)
    return 1 - np.clip(1.2 * rise.mean(1), 0, 0.5)
