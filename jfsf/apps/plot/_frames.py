"""Frames: in which axes shapes are seen, as columns right, up and to the viewer.

A shape stands as its file says. The second shape of a pair is turned onto the first by
the rotation that fits the map best (orthogonal Procrustes, Kabsch 1976), so that both
are seen from one side whatever the axes of its file.
"""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from jfsf.types import ArrayLike, Mesh

Up = Literal["x", "y", "z", "-x", "-y", "-z"]

# Share of the sizes of both point sets that a rotation must explain. With less the map
# is far from any rotation, and the second shape stands as its file says.
_EXPLAINED = 0.6
_TURN = 20.0  # degrees: a little from the side
_FROM_SIDE = 55.0  # degrees, for an animal, whose face hides the rest of it
_LONG = 2.2  # depth over width, of a body that is turned more


def frame(up: str) -> Float[np.ndarray, "3 3"]:
    """The frame of a shape, for the axis of its file that points up.

    The front is where modelling tools have it: z if y is up, -y if z is up.

    Raises:
        ValueError: no such axis.
    """
    frames = {
        "x": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
        "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    }
    # Upside down: half a turn about the axis to the front.
    frames |= {
        f"-{axis}": np.array(rows) * [[-1], [-1], [1]] for axis, rows in frames.items()
    }
    if up not in frames:
        raise ValueError(f"draw: up is one of {', '.join(frames)}; got {up!r}")
    return np.array(frames[up], float).T


def frames_of_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    up: Up = "y",
    matched_x: Bool[ArrayLike, " n_x"] | None = None,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Frames of X and Y, so that corresponding parts are seen from the same side.

    Reflections are not allowed: a map that exchanges left and right is fitted by the
    best rotation, which may show the back of Y.

    Args:
        mesh_x, mesh_y: meshes or point clouds.
        T_xy: the vertex of Y for each vertex of X.
        up: the axis of X's file that points up.
        matched_x: `Match.matched_x`; the other vertices do not count.

    Returns:
        The frame of X by `up`, and that of Y by the map. Where no rotation explains
        the map, Y has the frame of X.

    Raises:
        ValueError: no such axis, vertices that are not finite points, or `matched_x`
            that is not one truth value a vertex.
    """
    axes = frame(up)
    points = points_of(mesh_x.vertices)
    images = points_of(mesh_y.vertices)[np.asarray(T_xy)]
    if matched_x is not None:
        matched = checked_mask(matched_x, len(points))
        points, images = points[matched], images[matched]
    if not len(points):
        return axes, axes
    points, images = points - points.mean(0), images - images.mean(0)
    left, explained, right = np.linalg.svd(points.T @ images)
    both = np.linalg.norm(points) * np.linalg.norm(images)
    if explained.sum() <= _EXPLAINED * both:
        return axes, axes
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    return axes, (left @ right).T @ axes


def natural_turn(*bodies: Float[np.ndarray, "n 3"]) -> float:
    """Degrees by which to turn shapes to their right: more for long ones, as horses.

    Args:
        bodies: points of each shape in its frame.
    """
    # By the spread: an arm that points to the viewer is not a long body.
    across, _, depth = np.mean([body.std(0) for body in bodies], 0)
    share = float(np.clip(depth / max(across, 1e-9) - _LONG, 0, 1))
    return _TURN + (_FROM_SIDE - _TURN) * share


def points_of(vertices: ArrayLike) -> Float[np.ndarray, "n 3"]:
    """Vertices as float64.

    Raises:
        ValueError: they are not finite points.
    """
    points = np.asarray(vertices, float)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise ValueError(f"draw: vertices are (n, 3) and n > 0; got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("draw: some vertices are not finite")
    return points


def checked_mask(matched: ArrayLike, n: int) -> Bool[np.ndarray, " n"]:
    """`Match.matched_x` or `matched_y` as numpy.

    Raises:
        ValueError: it is not one truth value for each of n vertices.
    """
    matched = np.asarray(matched)
    if matched.shape != (n,) or matched.dtype != bool:
        raise ValueError(
            f"draw: the shape has {n} vertices, what is matched is {matched.dtype} of "
            f"shape {matched.shape}; give one truth value a vertex"
        )
    return matched
