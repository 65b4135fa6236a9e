"""How well a bent part fits: stretch, curvature, distances and what is left apart."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jfsf.mesh import vertex_normals
from jfsf.parts._region import Bent
from jfsf.parts._settings import PartSettings
from jfsf.parts._shape import PartSamples, along_cut
from jfsf.spectral import operators
from jfsf.types import Mesh


class Evidence(NamedTuple):
    """Small is good.

    stretch: mean size of the logarithms of the principal stretches.
    curvature: mean difference of curvature, in standard deviations.
    distance: mean difference of geodesics, relative to these.
    residual: mean distance of the bent part from Y, along Y's normals.
    """

    stretch: float
    curvature: float
    distance: float
    residual: float


def evidence(
    x: PartSamples,
    y: PartSamples,
    curved_x: np.ndarray,
    curved_y: np.ndarray,
    bent: Bent,
    scale: float,
    *,
    settings: PartSettings = PartSettings(),
) -> tuple[Evidence, float]:
    """Evidence for a map, and the factor by which its distances would change the scale.

    Args:
        x, y: both shapes in the common unit.
        curved_x, curved_y: `curvatures` of both.
        bent: X bent onto Y. Its vertices that Y covers count.
        scale: factor of X's lengths.
        settings: what is read, and the bounds of it.
    """
    moved, T_xy, matched = bent
    mass = x.mass * matched
    mass = mass / max(mass.sum(), 1e-12)
    total = weights = 0.0
    for i, length in enumerate(settings.curvature_lengths):
        weight = mass * (x.to_boundary * scale > settings.boundary_lengths * length)
        spread = np.sqrt(y.mass @ curved_y[i] ** 2 / y.mass.sum())
        away = np.abs(curved_x[i] - curved_y[i][T_xy]) / spread
        total += weight @ np.minimum(away, settings.max_curvature_difference)
        weights += weight.sum()
    curvature = total / weights if weights > 0 else settings.unread_curvature
    apart = np.abs(np.sum((moved - y.mesh.vertices[T_xy]) * y.normal[T_xy], 1))
    distance, ratio = _distances(x, y, T_xy, matched, scale, settings)
    stretch = _stretch(x.mesh, moved, matched, scale, settings)
    return Evidence(stretch, float(curvature), distance, float(mass @ apart)), ratio


def curvatures(
    mesh: Mesh, scale: float = 1.0, *, settings: PartSettings = PartSettings()
) -> np.ndarray:
    """(lengths, n) signed motion of a vertex as its surroundings are smoothed.

    Args:
        mesh: wound outward.
        scale: factor that brings it to the common unit.
        settings: the lengths over which it is smoothed.
    """
    stiff, mass = operators(mesh)
    normal = vertex_normals(*mesh)
    out = []
    for length in (wide / scale for wide in settings.curvature_lengths):
        solve = splu((sp.diags(mass) + length**2 * stiff).tocsc()).solve
        smooth = solve(mass[:, None] * mesh.vertices)
        out.append(np.sum((smooth - mesh.vertices) * normal, 1) / length)
    return np.stack(out)


def _stretch(mesh: Mesh, moved, matched, scale, settings: PartSettings) -> float:
    def frame(points):
        a, b, c = (points[mesh.faces[:, i]] for i in range(3))
        u, v = b - a, c - a
        e = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
        ve = np.sum(v * e, 1)
        h = np.linalg.norm(np.cross(u, v), axis=1) / np.maximum(
            np.linalg.norm(u, axis=1), 1e-12
        )
        return np.linalg.norm(u, axis=1), ve, h

    l0, v0, h0 = (scale * f for f in frame(mesh.vertices))
    l1, v1, h1 = frame(moved)
    area = l0 * h0 * matched[mesh.faces].all(1)
    # In the frames of their first edges both triangles are upper triangular.
    a, d = l1 / np.maximum(l0, 1e-12), h1 / np.maximum(h0, 1e-12)
    b = (v1 - a * v0) / np.maximum(h0, 1e-12)
    half, det = a**2 + b**2 + d**2, a * d
    root = np.sqrt(np.maximum(half**2 / 4 - det**2, 0))
    big = np.sqrt(np.maximum(half / 2 + root, 1e-6))
    small = np.maximum(det / big, 1e-3)
    size = np.sqrt(np.log(big) ** 2 + np.log(small) ** 2)
    size = np.minimum(size, settings.max_stretch)
    return float(area @ size / max(area.sum(), 1e-12))


def _distances(
    x: PartSamples, y: PartSamples, T_xy, matched, scale, settings: PartSettings
):
    at = x.at[: settings.distance_samples]
    num = len(at)
    there = matched[at]
    far_y = y.solver.rows(T_xy[at])[:, T_xy[at]]
    far_y = (far_y + far_y.T) / 2
    far_x = x.between[:num, :num] * scale
    around = x.around[:num, :num] * scale
    free = ~along_cut(around, far_x, settings) & (far_x > settings.min_distance)
    free &= there[:, None] & there[None] & (far_y > 0)
    if not free.any():
        return settings.unread_distance, 1.0
    ratio = far_y[free] / far_x[free]
    middle = float(np.median(ratio))
    away = np.abs(np.log(ratio + settings.distance_ratio_offset))
    away = np.minimum(away, settings.max_distance_difference)
    return float(np.mean(away)), middle
