"""How well a bent part fits: stretch, curvature, distances and what is left apart."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jfsf.evaluate import geodesics
from jfsf.mesh import vertex_normals
from jfsf.parts._shape import PartSamples
from jfsf.spectral import operators
from jfsf.types import Mesh

# Lengths, in the common unit, over which curvature is read.
LENGTHS = (0.015, 0.03, 0.06)
# Samples between which distances are compared.
DISTANCE_SAMPLES = 30


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
    moved: np.ndarray,
    T_xy: np.ndarray,
    matched: np.ndarray,
    scale: float,
    sign: int = 1,
) -> tuple[Evidence, float]:
    """Evidence for a map, and the factor by which its distances would change the scale.

    Args:
        x, y: both shapes in the common unit.
        curved_x, curved_y: `curvatures` of both.
        moved: vertices of X, bent onto Y.
        T_xy: the vertex of Y below each.
        matched: vertices of X that count.
        scale: factor of X's lengths.
        sign: -1 for a map that mirrors.
    """
    mass = x.mass * matched
    mass = mass / max(mass.sum(), 1e-12)
    total = weights = 0.0
    for i, length in enumerate(LENGTHS):
        weight = mass * (x.to_boundary * scale > 2 * length)
        spread = np.sqrt(y.mass @ curved_y[i] ** 2 / y.mass.sum())
        away = np.abs(curved_x[i] - curved_y[i][T_xy]) / spread
        total += weight @ np.minimum(away, 3)
        weights += weight.sum()
    curvature = total / weights if weights > 0 else 1.0
    apart = np.abs(np.sum((moved - y.mesh.vertices[T_xy]) * y.normal[T_xy], 1))
    distance, ratio = _distances(x, y, T_xy, matched, scale)
    stretch = _stretch(x.mesh, moved, matched, scale)
    return Evidence(stretch, float(curvature), distance, float(mass @ apart)), ratio


def curvatures(mesh: Mesh, scale: float = 1.0) -> np.ndarray:
    """(lengths, n) signed motion of a vertex as its surroundings are smoothed.

    Args:
        mesh: wound outward.
        scale: factor that brings it to the common unit.
    """
    stiff, mass = operators(mesh)
    normal = vertex_normals(*mesh)
    out = []
    for length in (wide / scale for wide in LENGTHS):
        solve = splu((sp.diags(mass) + length**2 * stiff).tocsc()).solve
        smooth = solve(mass[:, None] * mesh.vertices)
        out.append(np.sum((smooth - mesh.vertices) * normal, 1) / length)
    return np.stack(out)


def _stretch(mesh: Mesh, moved, matched, scale) -> float:
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
    return float(area @ np.minimum(size, 2) / max(area.sum(), 1e-12))


def _distances(x: PartSamples, y: PartSamples, T_xy, matched, scale):
    at = x.at[:DISTANCE_SAMPLES]
    num = len(at)
    there = matched[at]
    far_y = geodesics(y.mesh, T_xy[at])[:, T_xy[at]]
    far_y = (far_y + far_y.T) / 2
    far_x = x.between[:num, :num] * scale
    around = x.around[:num, :num] * scale
    free = (around > 1.02 * far_x + 0.01) & (far_x > 0.1)
    free &= there[:, None] & there[None] & (far_y > 0)
    if not free.any():
        return 0.1, 1.0
    ratio = far_y[free] / far_x[free]
    middle = float(np.median(ratio))
    return float(np.mean(np.minimum(np.abs(np.log(ratio + 0.05)), 1))), middle
