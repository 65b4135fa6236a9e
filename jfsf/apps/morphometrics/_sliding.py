"""Semilandmarks slid along curves and surfaces, so that their spacing does not count.

Bookstein (Landmark methods for forms without landmarks, 1997); Gunz, Mitteroecker and
Bookstein (Semilandmarks in three dimensions, 2005). A semilandmark i of a shape y moves
by sum_a t_a d_a along its directions: the tangent of its curve, or two of its surface.
Over t, the shape comes as near to the mean m as it can, in one of two senses:

    bending:     the energy of the spline from m, (y - m)^T (I_3 x L) (y - m), is least
    procrustes:  |y - m|^2 is least, along each direction by itself

where L is the block of landmarks of the inverse of the spline's matrix
[[K, Q], [Q^T, 0]], with K_ij = |m_i - m_j| and rows (1, m_i) in Q.

Directions are those of `geomorph::gpagen`: of a curve, the difference of the two
neighbours; of a surface, the first two principal axes of the semilandmark and the four
landmarks nearest to it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

from jfsf.apps.morphometrics._checks import PointsError, check_numbers, check_once
from jfsf.types import ArrayLike

NEAREST = 5  # landmarks of a tangent plane, with the one that slides: geomorph's


class Sliders(NamedTuple):
    """Which landmarks slide; numbers from 0.

    curves: landmark before, the one that slides, and the one after.
    surfaces: those that slide on a surface.
    """

    curves: Int[np.ndarray, "c 3"]
    surfaces: Int[np.ndarray, " p"]


def check_sliders(
    curves: ArrayLike | None, surfaces: ArrayLike | None, landmarks: int
) -> Sliders:
    """Sliders of so many landmarks.

    Raises:
        ValueError: no numbers of landmarks, a landmark that slides twice, or too few
            landmarks for a plane.
    """
    name = "procrustes"
    slid = check_numbers(name, "curves", curves, 3, landmarks)
    planes = check_numbers(name, "surfaces", surfaces, 1, landmarks)[:, 0]
    check_once(name, "curves", slid[:, 1])
    check_once(name, "surfaces", planes)
    check_once(name, "curves and surfaces", np.concatenate([slid[:, 1], planes]))
    if len(planes) and landmarks < NEAREST:
        words = f"there are {landmarks} landmarks; a surface needs {NEAREST}"
        raise PointsError(name, words)
    return Sliders(slid, planes)


def slide(
    shapes: Float[np.ndarray, "s l 3"],
    mean: Float[np.ndarray, "l 3"],
    sliders: Sliders,
    energy: Float[np.ndarray, "l l"] | None,
) -> Float[np.ndarray, "s l 3"]:
    """Shapes whose semilandmarks have slid once towards a mean.

    Args:
        shapes: superimposed on the mean.
        mean: where they slide to.
        sliders: which of the landmarks slide.
        energy: L of the mean (`bending_energy`); None slides by Procrustes distance.

    Raises:
        ValueError: the neighbours of a semilandmark are at one place, or the positions
            of least energy are not unique.
    """
    at, ways = _directions(shapes, sliders)
    off = shapes - mean
    if energy is None:
        along = np.einsum("sad,sad->sa", off[:, at], ways)
    else:
        pulls = np.einsum("al,sld->sad", energy[at], off)
        forces = np.einsum("sad,sad->sa", pulls, ways)
        own = energy[at][:, at]
        try:
            # One by one: of a thousand semilandmarks a matrix has 30 MB.
            solved = [
                np.linalg.solve(own * (way @ way.T), force)
                for way, force in zip(ways, forces, strict=True)
            ]
            along = np.array(solved)
        except np.linalg.LinAlgError:
            words = (
                "the semilandmarks have no unique positions of least bending energy; "
                'slide fewer, or by slide="procrustes"'
            )
            raise PointsError("procrustes", words) from None
    c, p = len(sliders.curves), len(sliders.surfaces)
    tangent, first, second = np.split(along[..., None] * ways, [c, c + p], axis=1)
    moved = shapes.copy()
    moved[:, at[:c]] -= tangent
    moved[:, at[c : c + p]] -= first + second
    return moved


def bending_energy(mean: Float[np.ndarray, "l 3"]) -> Float[np.ndarray, "l l"]:
    """L of a mean that does not lie in a plane, up to its sign.

    Raises:
        ValueError: two landmarks of the mean are at one place.
    """
    away = cdist(mean, mean)
    if len(twice := np.argwhere(np.triu(away == 0, 1))):
        words = (
            "landmark {landmarks[0]} and landmark {landmarks[1]} are at one place; "
            "leave one out"
        )
        raise PointsError("procrustes", words, landmarks=twice[0])
    affine = np.column_stack([np.ones(len(mean)), mean])
    matrix = np.block([[away, affine], [affine.T, np.zeros((4, 4))]])
    return np.linalg.inv(matrix)[: len(mean), : len(mean)]


def _directions(shapes, sliders):
    """The landmark of each direction (a,), and unit vectors (s, a, 3)."""
    before, slid, after = sliders.curves.T
    tangents = shapes[:, after] - shapes[:, before]
    length = np.linalg.norm(tangents, axis=2, keepdims=True)
    if not length.all():
        specimen, row = np.argwhere(length[..., 0] == 0)[0]
        words = (
            "landmark {landmarks[0]} and landmark {landmarks[1]} of specimen "
            "{specimen} are at one place, so the one between them cannot slide"
        )
        ends = before[row], after[row]
        raise PointsError("procrustes", words, specimen=specimen, landmarks=ends)
    surfaces = sliders.surfaces
    planes = np.zeros((len(shapes), len(surfaces), 2, 3))
    for i, shape in enumerate(shapes if len(surfaces) else ()):
        away = cdist(shape[surfaces], shape)
        near = shape[np.argsort(away, axis=1, kind="stable")[:, :NEAREST]]
        axes = np.linalg.svd(near - near.mean(1, keepdims=True))[2]
        planes[i] = axes[:, :2]
    at = np.concatenate([slid, surfaces, surfaces])
    ways = [tangents / length, planes[:, :, 0], planes[:, :, 1]]
    return at, np.concatenate(ways, axis=1)
