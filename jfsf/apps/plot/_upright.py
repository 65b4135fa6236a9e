"""Cues -> frames: the right, up and front of a shape, found from its geometry.

up and front are those of the highest score, a weighted sum of the cues of both. The
weights are fitted to bodies whose axes are known (`experiments/upright.py`).

A sheet, such as a scan of a face or a mask, is seen along its mean normal, from the
side on which it bulges: from elsewhere a turn about that normal could not be seen.

It finds how people and animals stand, walk, kick or sit, in any axes and unit. It
cannot know what the geometry does not tell:

- a shape without feet or face (pliers, glasses, a hand) is drawn in some position, the
  same however its file is turned;
- a body that lies or jumps is likely to be stood up on its feet or its limbs;
- one whose limbs have no symmetric partner, such as half a scan, may face anywhere;
- a shape that is its own mirror image in several planes (a ball, a cube) is drawn at
  random, and not the same after each turn.

`Frame.margin` says how sure it is.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.apps.plot._cues import Cues, apart, area_shares, cues, front_cues, up_cues
from jfsf.matching.parts import likely_part
from jfsf.types import ArrayLike, Mesh

# By experiments/upright.py on people and animals. Rounds of it differ by a tenth.
UP_WEIGHTS = np.array([-13.16, 1.91, -6.52, 11.14, -3.38, -1.19, 1.33])
FRONT_WEIGHTS = np.array([-11.39, -16.78, 25.34, -5.67, -5.19, -1.37])
# The rotation between two shapes that a map relates, if it explains so much of them.
_ALIGNED = 0.6
# Degrees by which the frame of a shape itself may differ from its partner's, carried
# over. Within, each stands on its own feet.
_AGREES = 35.0
# A margin from which a shape keeps its own frame even if its partner's says otherwise:
# the map is then likely to be wrong, and shows it best between two upright shapes.
_SURE = 1.0
# How far a point of the trunk may be from where a rotation puts it, where 1 is the size
# of the shape.
_STAYS = 0.2
_ROUNDS = 30
# Length of the mean normal, by area, from which a shape is a sheet: 1 for a plane, 0.5
# for half a sphere, 0.28 to 0.36 for crowns of teeth, 0.37 for the face of an embedded
# body, 0.06 at most for all of it.
_SHEET = 0.2
# Cosine of the angle between its mean normal and an up that is known: beyond, it lies.
_LIES = 0.9
TRIED = 16  # directions whose fronts are looked at, 8 degrees apart
FRONTS = 24
# Degrees around a direction in which the good ones settle where it is.
_UP_WITHIN, _FRONT_WITHIN = 8.0, 16.0
_SHIFTS = 8


class Frame(NamedTuple):
    """How to look at a shape.

    axes: (3, 3), columns right, up and towards the viewer, a rotation.
    margin: score above that of the best frame that differs by more than 45 degrees; a
        logit. Below about 1 the frame is a guess.
    sheet: whether the front is the mean normal of a sheet.
    """

    axes: Float[np.ndarray, "3 3"]
    margin: float
    sheet: bool = False


def find_frame(mesh: Mesh, up: Float[np.ndarray, " 3"] | None = None) -> Frame:
    """The frame in which a shape stands and faces the viewer.

    Args:
        mesh: a mesh or point cloud; of several pieces the largest counts.
        up: a direction that is known to be up. Then only the front is found.
    """
    return frame_from(cues(mesh), up)


def frame_from(seen: Cues, up: Float[np.ndarray, " 3"] | None = None) -> Frame:
    """`find_frame` from the cues."""
    facing = seen.weight @ seen.normals
    if np.linalg.norm(facing) >= _SHEET:
        facing = facing / np.linalg.norm(facing)
        if up is None:
            return _sheet(seen, facing)
        if abs(facing @ up) < _LIES * np.linalg.norm(up):
            axes = frame_of(np.array(up, float) / np.linalg.norm(up), facing)
            return Frame(axes, np.inf, True)
    if up is None:
        scores = up_cues(seen, seen.ups) @ UP_WEIGHTS
        order = np.argsort(-scores, kind="stable")
        ups = apart(seen.ups[order], 8.0, TRIED)
    else:
        ups = np.array([up], float)
    frames, scores = zip(*(_fronts(seen, this) for this in ups), strict=True)
    frames, scores = np.concatenate(frames), np.concatenate(scores)
    best = frames[scores.argmax()]
    turn = (np.einsum("ij,kij->k", best, frames) - 1) / 2
    other = scores[turn < np.cos(np.radians(45))]
    margin = float(scores.max() - other.max()) if len(other) else np.inf
    return Frame(_settled(seen, best, up is None), margin)


def _sheet(seen: Cues, facing) -> Frame:
    """The frame of a sheet that faces the viewer: which way it stands."""
    ups = circle(facing, 120)
    scores = up_cues(seen, ups) @ UP_WEIGHTS
    best = ups[scores.argmax()]
    other = scores[ups @ best < np.cos(np.radians(45))]
    up = _middle(ups, scores, best, _UP_WITHIN)
    up = up - (up @ facing) * facing
    axes = frame_of(up / np.linalg.norm(up), facing)
    return Frame(axes, float(scores.max() - other.max()), True)


def find_frames(
    mesh_x: Mesh, mesh_y: Mesh, T_xy: Int[ArrayLike, " n_x"]
) -> tuple[Frame, Frame]:
    """Frames of a pair, so that corresponding parts are seen from the same side.

    The surer of both frames is carried to the other shape, unless that is sure too, by
    the rotation that brings most of X's trunk to its image (robust Procrustes). A part,
    whose boundary is long, is never the surer one. A map that exchanges left and right
    carries up and front only, so that both shapes face the viewer.

    Args:
        mesh_x, mesh_y: as `find_frame`.
        T_xy: the vertex of Y for each vertex of X.

    Returns:
        Frames of X and Y. Where no rotation relates the shapes, since the map is wrong,
        each has its own.
    """
    own_x, own_y = find_frame(mesh_x), find_frame(mesh_y)
    turn = _alignment(mesh_x, mesh_y, np.asarray(T_xy))
    if turn is None:
        return own_x, own_y
    # A part need not stand on its own as the whole does.
    match likely_part(mesh_x, mesh_y):
        case "x":
            own_x = own_x._replace(margin=-np.inf)
        case "y":
            own_y = own_y._replace(margin=-np.inf)
    if own_x.margin >= own_y.margin:
        return own_x, _carried(own_x, own_y, turn)
    return _carried(own_y, own_x, turn.T), own_y


def _alignment(mesh_x, mesh_y, T_xy):
    """(3, 3) orthogonal, by which the directions of X go to Y; None if none fits."""
    points = np.asarray(mesh_x.vertices, float)
    area = area_shares(points, np.asarray(mesh_x.faces).reshape(-1, 3))[0]
    image = np.asarray(mesh_y.vertices, float)[T_xy]
    points, image = (_of_size_one(p, area) for p in (points, image))
    if np.linalg.norm((points * area[:, None]).T @ image, "nuc") < _ALIGNED:
        return None
    keeps, kept = _trunk_turn(points, image, area, 1)
    mirrors, mirrored = _trunk_turn(points, image, area, -1)
    # On embedded pairs the second is 1.09 of the first or more, and of mirrored maps
    # 0.92 or less.
    return mirrors if mirrored < kept else keeps


def _trunk_turn(points, image, area, sign):
    """The orthogonal matrix of this determinant, and the misfit, 1 if nothing fits.

    Limbs move: what stays where the matrix puts it counts more and more.
    """
    weight, turn, gap = area, np.eye(3), area
    for _ in range(_ROUNDS):
        points, image = _centred(points, weight), _centred(image, weight)
        left, _, right = np.linalg.svd((points * weight[:, None]).T @ image)
        if np.linalg.det(left @ right) * sign < 0:
            left[:, 2] *= -1
        turn = left @ right
        gap = ((points @ turn - image) ** 2).sum(1) / _STAYS**2
        weight = area / (1 + gap) ** 2
    return turn, area @ (gap / (1 + gap))


def _of_size_one(points, weight):
    points = _centred(points, weight)
    return points / (np.sqrt(weight @ (points**2).sum(1)) or 1)


def _centred(points, weight):
    return points - weight @ points / weight.sum()


def _carried(sure: Frame, own: Frame, turn) -> Frame:
    up, front = sure.axes[:, 1] @ turn, sure.axes[:, 2] @ turn
    if own.sheet and sure.sheet:
        # Each faces the viewer: the map tells how it stands only.
        front = own.axes[:, 2]
        up = up - (up @ front) * front
        if (length := np.linalg.norm(up)) < 1e-6:
            return own
        up = up / length
    carried = frame_of(up, front)
    agrees = (np.einsum("ij,ij->", carried, own.axes) - 1) / 2
    if own.margin > _SURE or agrees > np.cos(np.radians(_AGREES)):
        return own
    return Frame(carried, sure.margin, own.sheet)


def _fronts(seen: Cues, up):
    """Frames (f, 3, 3) with this direction up, and their scores."""
    fronts = circle(up, FRONTS)
    score = up_cues(seen, up[None]) @ UP_WEIGHTS
    score = score + front_cues(seen, up, fronts) @ FRONT_WEIGHTS
    return np.stack([frame_of(up, front) for front in fronts]), score


def _settled(seen: Cues, frame, free: bool):
    """The frame moved to the middle of the good ones around (mean shift)."""
    _, up, front = frame.T
    if free:
        up = _middle(seen.ups, up_cues(seen, seen.ups) @ UP_WEIGHTS, up, _UP_WITHIN)
        front = frame_of(up, front)[:, 2]
    ring = circle(up, 120)
    scores = front_cues(seen, up, ring) @ FRONT_WEIGHTS
    front = _middle(ring, scores, front, _FRONT_WITHIN)
    return frame_of(up, front)


def _middle(directions, scores, start, within):
    weight = np.exp(scores - scores.max())
    for _ in range(_SHIFTS):
        near = np.exp((directions @ start - 1) / (1 - np.cos(np.radians(within))))
        total = (weight * near) @ directions
        start = total / np.linalg.norm(total)
    return start


def frame_of(
    up: Float[np.ndarray, " 3"], front: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "3 3"]:
    """Columns right, up and front; the front is brought to a right angle with up."""
    front = front - (front @ up) * up
    front = front / np.linalg.norm(front)
    return np.stack([np.cross(up, front), up, front], 1)


def circle(up: Float[np.ndarray, " 3"], n: int) -> Float[np.ndarray, "n 3"]:
    """n directions at right angles to `up`, evenly spread."""
    side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    side = side / np.linalg.norm(side)
    angle = np.arange(n) * 2 * np.pi / n
    return np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(up, side)
