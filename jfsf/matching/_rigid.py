"""Shapes that nearly coincide after a similarity: faces, teeth. Host side (numpy).

A map read from eigenfunctions slides along the surface, and bending does not undo all
of it. Where a similarity (a rigid motion and a scale), fitted to the map, lays X on Y
everywhere, nearest points slide less.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.mesh import closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import vertex_normals
from jfsf.refine._rest import closest_rotations
from jfsf.types import Mesh, Spectrum

# All set by hand. Root mean square between moved points and their images, in
# sqrt(area), above which nothing more is tried: the shapes are in different poses.
FAR = 0.12
SAMPLES = 500
# Distance at which an image or a nearest point counts half, and a third.
REACH = 0.05
REWEIGHTED, NEAREST = 5, 20  # motions by the images, and by nearest points
NORMAL_WEIGHT = 0.1  # distance that normals at an angle of 1 count for


class Moved(NamedTuple):
    """X laid on Y by a similarity.

    T_xy: the vertex of Y nearest to each vertex of X there, whose normal is alike.
    apart: mean distance of either surface from the other, the larger of both, in
        sqrt(area).
    """

    T_xy: Int[np.ndarray, " n_x"]
    apart: float


def moved_by_map(
    spec_x: Spectrum, spec_y: Spectrum, T_xy: Int[np.ndarray, " n"], *, mirrors: bool
) -> Moved | None:
    """Lay X on Y as a map has it on the whole. Padding is left out.

    First by the images of some vertices, those that fit the others counting more, then
    by nearest points on tangent planes (Chen and Medioni, 1992).

    Args:
        spec_x, spec_y: vertices, faces and mass are read.
        T_xy: the map, padding included.
        mirrors: whether the map swaps left and right.

    Returns:
        None of clouds, and where the images are far from a motion of X.
    """
    x, y = (surface_of(spec) for spec in (spec_x, spec_y))
    if not (len(x.faces) and len(y.faces)):
        return None
    at_x, at_y = _some(x), _some(y)
    mass = np.asarray(spec_x.mass, float)[at_x]
    points, images = x.vertices[at_x], y.vertices[np.asarray(T_xy)[at_x]]
    move = motion(points, images, mass, mirrors=mirrors, scaled=True)
    away = np.sum((move(points) - images) ** 2, 1)
    if mass @ away > FAR**2 * mass.sum():
        return None
    for _ in range(REWEIGHTED):
        weight = mass / (1 + away / REACH**2)
        move = motion(points, images, weight, mirrors=mirrors, scaled=True)
        away = np.sum((move(points) - images) ** 2, 1)
    tree, normal_y = KDTree(y.vertices), vertex_normals(*y)
    for _ in range(NEAREST):
        there = move(points)
        distance, at = tree.query(there)
        weight = mass * np.exp(-((distance / REACH) ** 2))
        # On the tangent plane: between vertices, so that these do not hold the points.
        height = np.sum((y.vertices[at] - there) * normal_y[at], 1)
        foot = there + height[:, None] * normal_y[at]
        move = motion(points, foot, weight, mirrors=mirrors, scaled=True)
    there = Mesh(move(x.vertices), x.faces)
    apart = max(
        closest(surface_tree(y), there.vertices[at_x]).distance.mean(),
        closest(surface_tree(there), y.vertices[at_y]).distance.mean(),
    )
    side = -1 if mirrors else 1
    normals = side * vertex_normals(*there), normal_y
    both = (
        np.hstack([mesh.vertices, NORMAL_WEIGHT * normal])
        for mesh, normal in zip((there, y), normals, strict=True)
    )
    moved, fixed = both
    return Moved(np.asarray(KDTree(fixed).query(moved)[1]), float(apart))


def motion(
    points: np.ndarray,
    images: np.ndarray,
    weight: np.ndarray,
    *,
    mirrors: bool = False,
    scaled: bool = False,
) -> Callable[[np.ndarray], np.ndarray]:
    """The motion that brings points nearest to their images (Umeyama 1991).

    Args:
        points, images: (n, 3).
        weight: (n,), how much each counts.
        mirrors: whether it swaps left and right.
        scaled: whether it has a scale of its own, or 1.
    """
    weight = weight / weight.sum()
    centre, goal = weight @ points, weight @ images
    flip = np.array([-1 if mirrors else 1, 1, 1])
    rest = (points - centre) * flip
    turn = closest_rotations((rest * weight[:, None]).T @ (images - goal))
    size = 1.0
    if scaled:
        along = weight @ np.sum((rest @ turn) * (images - goal), 1)
        size = along / max(weight @ np.sum(rest**2, 1), 1e-300)
    return lambda p: size * ((p - centre) * flip) @ turn + goal


def surface_of(spec: Spectrum) -> Mesh:
    """The mesh of a spectrum, without padding."""
    n = int(np.sum(np.asarray(spec.mass) > 0))
    faces = np.asarray(spec.faces)
    real = (faces[:, 0] != faces[:, 1]) | (faces[:, 1] != faces[:, 2])
    return Mesh(np.asarray(spec.vertices, float)[:n], faces[real])


def _some(mesh: Mesh) -> Float[np.ndarray, " s"]:
    """Numbers of some vertices."""
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    return order[:SAMPLES]
