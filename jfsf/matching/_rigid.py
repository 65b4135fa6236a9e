"""Shapes that nearly coincide after a similarity: faces, teeth. Host side (numpy).

A map read from eigenfunctions slides along the surface, and bending does not undo all
of it. Where a similarity (a rigid motion and a scale), fitted to the map, lays X on Y
everywhere, a stiff deformation that goes on from it slides less (`_stiff.py`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.matching._stiff import stiffly_onto
from jfsf.mesh import closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import vertex_normals
from jfsf.refine._rest import closest_rotations
from jfsf.runtime._sizes import surface_of
from jfsf.types import Bent, Mesh, Spectrum

# All set by hand. Root mean square between moved points and their images, in
# sqrt(area), above which nothing more is tried: the shapes are in different poses.
FAR = 0.12
# Mean distance of the surfaces after the similarity, above which nothing is tried.
NEAR = 0.05
SAMPLES = 500
# Distance at which an image or a nearest point counts half, and a third.
REACH = 0.05
REWEIGHTED, NEAREST = 5, 20  # motions by the images, and by nearest points


class Moved(NamedTuple):
    """Two shapes laid on each other.

    bent: each by a similarity and a stiff deformation; with the padding of the spectra.
    apart: mean distance of X, laid on Y, and Y from each other, the larger of both
        ways, in sqrt(area).
    """

    bent: Bent
    apart: float


def moved_by_map(
    spec_x: Spectrum, spec_y: Spectrum, T_xy: Int[np.ndarray, " n"], *, mirrors: bool
) -> Moved | None:
    """Lay X on Y, and Y on X, as a map has it on the whole, and deform both stiffly.

    Args:
        spec_x, spec_y: vertices, faces and mass are read.
        T_xy: the map, padding included.
        mirrors: whether the map swaps left and right.

    Returns:
        None of clouds, and where the images or the surfaces are far from a motion of X.
    """
    laid = laid_by_map(spec_x, spec_y, T_xy, mirrors=mirrors)
    if laid is None:
        return None
    x, y = surface_of(spec_x), surface_of(spec_y)
    if _apart(Mesh(laid, x.faces), y) > NEAR:
        return None
    back = motion(laid, x.vertices, np.ones(len(laid)), mirrors=mirrors, scaled=True)
    moved_x = stiffly_onto(x, laid, y, mirrors=mirrors)
    moved_y = stiffly_onto(y, back(y.vertices), x, mirrors=mirrors)
    bent = Bent(_padded(moved_x, spec_x), _padded(moved_y, spec_y))
    return Moved(bent, _apart(Mesh(moved_x, x.faces), y))


def laid_by_map(
    spec_x: Spectrum, spec_y: Spectrum, T_xy: Int[np.ndarray, " n"], *, mirrors: bool
) -> Float[np.ndarray, "n_x 3"] | None:
    """Where the vertices of X lie after the similarity alone. As `moved_by_map`.

    First by the images of some vertices, those that fit the others counting more, then
    by nearest points on tangent planes (Chen and Medioni, 1992).
    """
    x, y = (surface_of(spec) for spec in (spec_x, spec_y))
    if not (len(x.faces) and len(y.faces)):
        return None
    at_x = _some(x)
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
    return move(x.vertices)


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


def _some(mesh: Mesh) -> Float[np.ndarray, " s"]:
    """Numbers of some vertices."""
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    return order[:SAMPLES]


def _apart(one: Mesh, other: Mesh) -> float:
    """Mean distance of either surface from the other, the larger of both."""
    both = (one, other), (other, one)
    ways = (closest(surface_tree(to), of.vertices[_some(of)]) for of, to in both)
    return max(float(found.distance.mean()) for found in ways)


def _padded(points: np.ndarray, spec: Spectrum) -> np.ndarray:
    """The positions of vertices, 0 on the padding of a spectrum."""
    padded = np.zeros_like(np.asarray(spec.vertices))
    padded[: len(points)] = points
    return padded
