"""Mesh -> Cues: what in the geometry of a body tells its up and its front.

Left and right are the strongest cue, and do not depend on the pose: a point and its
mirror image on the body have equal heat kernel signatures. The directions between such
points say across which plane the body is symmetric. In that plane the others decide: a
broad flat contact with the ground below, little area near the ground, the heavy parts
above the thin ones; toes before the ankles.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, QhullError

from jfsf.mesh import (
    MeshError,
    coarsen,
    largest_component,
    vertex_areas,
    vertex_normals,
)
from jfsf.mesh._geometry import face_areas
from jfsf.spectral import spectrum
from jfsf.types import Mesh

_DETAIL = 6000  # vertices of the mesh that is looked at
_SAMPLES = 1200
_PAIRS = 60  # eigenpairs
_TIMES = 16  # of the heat kernel signature
# Lengths are in units of the shape's own size, the root mean square distance from its
# centre: a standing person is four high.
_APART = 0.25  # of a point from its mirror image; nearer ones are neighbours
_SOLE = 0.1  # height of what stands on the ground
_GROUND = 0.25  # height of what holds the shape up
_ANKLE = (0.13, 0.33)  # heights
_FOOT = 0.3  # distance along the ground between toes and ankle, at most


class Cues(NamedTuple):
    """A shape at s samples, centred, of mean square size 1.

    points: the samples.
    weight: their areas; they sum to 1.
    normals: outward; 0 for a point cloud.
    heavy: centre of the volume seen from that of the surface: towards the thick parts.
    lateral: share of each direction in the vectors between mirror images; trace 1.
    trunk: axis of the part that heat leaves first, without a sign; 0 if unknown. Of a
        person it points up, of a horse forward.
    sharp: how pointed the surface is, by heat that stays; mean 0, mean square 1.
    ups: (u, 3) directions that may be up.
    """

    points: Float[np.ndarray, "s 3"]
    weight: Float[np.ndarray, " s"]
    normals: Float[np.ndarray, "s 3"]
    heavy: Float[np.ndarray, " 3"]
    lateral: Float[np.ndarray, "3 3"]
    trunk: Float[np.ndarray, " 3"]
    sharp: Float[np.ndarray, " s"]
    ups: Float[np.ndarray, "u 3"]


def cues(mesh: Mesh) -> Cues:
    """The cues of a mesh or point cloud; of several pieces the largest counts."""
    part = largest_component(coarsen(mesh, _DETAIL).mesh).mesh
    vertices = np.asarray(part.vertices, float)
    faces = np.asarray(part.faces).reshape(-1, 3)
    area, normals = area_shares(vertices, faces)
    vertices = vertices - area @ vertices
    vertices = vertices / (np.sqrt(area @ (vertices**2).sum(1)) or 1)
    chosen = np.arange(0, len(vertices), -(-len(vertices) // _SAMPLES))
    points, weight = vertices[chosen], area[chosen] / area[chosen].sum()
    points = points - weight @ points
    lateral, trunk, sharp = np.eye(3) / 3, np.zeros(3), np.zeros(len(points))
    if len(vertices) >= 4 * _PAIRS:
        try:
            spec = spectrum(Mesh(vertices, faces), _PAIRS, cache=False)
            heat = _heat(np.asarray(spec.evals), np.asarray(spec.evecs)[chosen], weight)
            lateral = _lateral(points, weight, heat)
            trunk, sharp = _trunk(points, weight, heat), heat[:, -1]
        except MeshError:  # no spectrum: the other cues decide
            pass
    return Cues(
        points,
        weight,
        normals[chosen],
        _centre_of_volume(vertices, faces),
        lateral,
        trunk,
        sharp,
        _directions(vertices, points, weight),
    )


def up_cues(cues: Cues, ups: Float[np.ndarray, "u 3"]) -> Float[np.ndarray, "u c"]:
    """A row of cues for each direction that may be up."""
    points, weight, normals, heavy, lateral, trunk, *_ = cues
    above = points @ ups.T
    above = above - above.min(0)
    share = above / np.maximum(above.max(0), 1e-9)
    flat = np.clip(-normals @ ups.T, 0, 1) ** 2 if normals.any() else 1.0
    contact = weight @ ((above < _SOLE) * flat)
    ground = weight[:, None] * (above < _GROUND)
    ground = (ground.T @ points) / ground.sum(0)[:, None]
    beside = heavy - ground
    beside = beside - (beside * ups).sum(1)[:, None] * ups
    middle = weight[:, None] * (abs(share - 0.5) < 1 / 6)
    across = ((points - heavy) ** 2).sum(1)[:, None] - ((points - heavy) @ ups.T) ** 2
    waist = (middle * across).sum(0) / np.maximum(middle.sum(0), 1e-9)
    return np.stack(
        [
            np.einsum("ui,ij,uj->u", ups, lateral, ups),
            np.log(contact + 0.002),
            weight @ (share < 1 / 3),
            ups @ heavy,
            np.sqrt(np.maximum(waist, 0)),
            np.linalg.norm(beside, axis=1),
            # Along the trunk or across it, rather than in between.
            (2 * (ups @ trunk) ** 2 - 1) ** 2,
        ],
        1,
    )


def front_cues(
    cues: Cues, up: Float[np.ndarray, " 3"], fronts: Float[np.ndarray, "f 3"]
) -> Float[np.ndarray, "f c"]:
    """A row of cues for each direction, at right angles to `up`, that may be front."""
    points, weight, normals, heavy, lateral, _, sharp, _ = cues
    height = points @ up - (points @ up).min()
    along = points @ fronts.T
    facing = normals @ fronts.T
    low = weight * (height < 0.1 * max(height.max(), 1e-9))
    return np.stack(
        [
            np.einsum("fi,ij,fj->f", fronts, lateral, fronts),
            fronts @ heavy,
            fronts @ _toes(points, weight, height),
            (weight * sharp) @ along,
            weight @ (1.0 * (facing > 0.85) - (facing < -0.85)),
            low @ along / max(low.sum(), 1e-9),
        ],
        1,
    )


def _volume_terms(vertices, faces):
    """Of each tetrahedron of a face and the origin: volume and sum of its corners."""
    a, b, c = (vertices[corner] for corner in faces.T)
    return (a * np.cross(b, c)).sum(1) / 6, a + b + c


def _centre_of_volume(vertices, faces):
    volume, corners = _volume_terms(vertices, faces)
    total = volume.sum()
    if abs(total) <= 1e-3 * np.abs(volume).sum() or not total:  # flat, or a cloud
        return np.zeros(3)
    return (volume[:, None] * corners).sum(0) / 4 / total


def _heat(evals, evecs, weight):
    """log of the heat kernel signature, long to short times, each standardised."""
    times = np.geomspace(1 / evals[1], 1 / evals[-1], _TIMES) * 4 * np.log(10)
    decay = np.exp(-np.outer(evals, times))
    heat = np.log(np.maximum(evecs**2 @ decay, 1e-300))
    heat = heat - weight @ heat
    return heat / np.maximum(np.sqrt(weight @ heat**2), 1e-12)


def _lateral(points, weight, heat):
    gap = np.maximum(_squares(heat), 0) / heat.shape[1]
    gap = np.where(_squares(points) > _APART**2, gap, np.inf)
    twin = gap.argmin(1)
    # Of points on the plane itself the twin is some other point, and less alike.
    vote = weight * np.exp(-gap[np.arange(len(gap)), twin] / 0.02)
    across = points - points[twin]
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    tensor = (vote[:, None] * across).T @ across
    return tensor / np.trace(tensor) if vote.any() else np.eye(3) / 3


def _trunk(points, weight, heat):
    left = heat[:, _TIMES // 2]
    chosen = left < np.quantile(left, 0.4)
    points, weight = points[chosen], weight[chosen] / weight[chosen].sum()
    points = points - weight @ points
    return np.linalg.eigh((weight[:, None] * points).T @ points)[1][:, -1]


def _squares(rows):
    """Squared distances between all rows."""
    size = (rows**2).sum(1)
    return size[:, None] + size[None] - 2 * rows @ rows.T


def _toes(points, weight, height):
    """Mean vector along the ground from ankles to soles."""
    sole, ankle = height < _SOLE, (height > _ANKLE[0]) & (height < _ANKLE[1])
    gap = points[sole][:, None] - points[ankle][None]
    rise = height[sole][:, None] - height[ankle][None]
    near = (gap**2).sum(2) - rise**2 < _FOOT**2
    near = near * weight[ankle][None]
    total = near.sum(1)
    ahead = np.einsum("sa,sac->sc", near, gap)[total > 0] / total[total > 0][:, None]
    share = weight[sole][total > 0]
    return share @ ahead / share.sum() if share.any() else np.zeros(3)


def _directions(vertices, points, weight):
    """Those in which the shape can rest on a plane, and some evenly spread."""
    # The spread ones turn with the shape: they are laid out in its principal axes.
    axes = np.linalg.eigh((points * weight[:, None]).T @ points)[1].T
    skew = weight @ (points @ axes.T) ** 3
    axes = axes * np.where(skew < 0, -1, 1)[:, None]
    axes[2] *= np.sign(np.linalg.det(axes)) or 1
    others = [sphere(600) @ axes, axes, -axes]
    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError):  # flat, or a few points
        return np.concatenate(others)
    size = face_areas(vertices, hull.simplices)
    rests = -hull.equations[np.argsort(-size), :3]
    return np.concatenate([apart(rests, 4.0), *others])


def area_shares(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Areas of vertices, which sum to 1, and outward unit normals, 0 for a cloud."""
    n, area = len(vertices), vertex_areas(vertices, faces)
    if not area.any():
        return np.full(n, 1 / n), np.zeros((n, 3))
    normals = vertex_normals(vertices, faces)
    if _volume_terms(vertices - vertices.mean(0), faces)[0].sum() < 0:
        normals = -normals
    return area / area.sum(), normals


def sphere(n: int) -> Float[np.ndarray, "n 3"]:
    """n directions, evenly spread."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], 1)


def apart(
    directions: Float[np.ndarray, "d 3"], degrees: float, most: int | None = None
) -> Float[np.ndarray, "e 3"]:
    """The first direction, and each later one that is not near one taken before."""
    left, near, taken = directions, np.cos(np.radians(degrees)), []
    while len(left) and (most is None or len(taken) < most):
        taken.append(left[0])
        left = left[left @ left[0] < near]
    return np.array(taken).reshape(-1, 3)
