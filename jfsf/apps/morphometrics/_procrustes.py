"""Specimens superimposed: generalised Procrustes analysis, with sliding semilandmarks.

Gower (Psychometrika 1975), Rohlf and Slice (Syst. Zool. 1990). The landmarks of each
specimen are moved to centroid 0, scaled to centroid size 1, and turned onto the mean,
which is then taken anew, until it rests. Last they are projected onto the tangent space
at the mean m of size 1 (Rohlf, J. Classif. 1999): x - (x . m) m + m.

Every step, and when it stops, is that of `geomorph::gpagen` (4.0.9) with its defaults,
so that the numbers agree. `jfsf.apps.model.align`, for the vertices of meshes, keeps
their unit, weighs them by area, iterates to the rounding, and is traced by jax in the
precision of the session.
"""

from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from jfsf.apps.morphometrics._checks import PointsError, check_points, is_flat
from jfsf.apps.morphometrics._sliding import bending_energy, check_sliders, slide
from jfsf.types import ArrayLike

Slide = Literal["bending", "procrustes"]

# As gpagen: it ends where the sum of squares changes by no more than this,
TOLERANCE = 1e-4
TURNS = 5  # or after so many superpositions,
SLIDES = 9  # with semilandmarks after sliding so often.


class Superimposed(NamedTuple):
    """Specimens superimposed on their mean.

    shapes: (s, l, 3) landmarks in the tangent space at the mean, of centroid size near
        1, with the principal axes of the mean as x, y and z.
    sizes: (s,) centroid size of each specimen, before any sliding: the root of the
        summed squared distances from the centroid, in the unit of the landmarks.
    mean: (l, 3) of the shapes.
    distances: (s,) of each shape from the mean, |x - m|: the Procrustes distance in
        tangent space.
    rested: whether they came to rest before the last step that is made.
    """

    shapes: Float[np.ndarray, "s l 3"]
    sizes: Float[np.ndarray, " s"]
    mean: Float[np.ndarray, "l 3"]
    distances: Float[np.ndarray, " s"]
    rested: bool


def procrustes(
    points: Float[ArrayLike, "s l 3"],
    *,
    curves: ArrayLike | None = None,
    surfaces: ArrayLike | None = None,
    slide: Slide = "bending",
) -> Superimposed:
    """Superimpose specimens by their landmarks, and slide semilandmarks.

    Nothing is mirrored. All landmarks count alike, those that slide too. The result is
    that of `geomorph::gpagen(A, curves, surfaces, ProcD = slide == "procrustes")`;
    only where its axes (PrinAxes) would mirror all specimens, z has the other sign.

    Args:
        points: (s, l, 3) landmarks, each specimen in its own place and size.
        curves: (c, 3) landmarks before, sliding and after, from 0: each slides along
            the line between its neighbours. None slides none.
        surfaces: landmarks that slide on a surface, from 0.
        slide: by least bending energy of the thin-plate spline, or least Procrustes
            distance.

    Raises:
        ValueError: fewer than two specimens, fewer than three landmarks, or values that
            are not finite; a landmark that slides twice, or cannot; landmarks in a
            plane, for bending energy; another `slide`.
    """
    points = check_points("procrustes", points)
    sliders = check_sliders(curves, surfaces, points.shape[1])
    if slide not in get_args(Slide):
        raise ValueError(f'procrustes: slide is {slide!r}; "bending" or "procrustes"')
    centred = points - points.mean(1, keepdims=True)
    sizes = centroid_size(points)
    shapes = centred / sizes[:, None, None]
    shapes = turned(shapes, shapes[0])
    if len(sliders.curves) + len(sliders.surfaces):
        shapes, rested = _slid(shapes, sliders, slide == "bending")
    else:
        shapes, rested = _turned(shapes)
    shapes = _in_tangent_space(shapes @ _axes(shapes.mean(0)))
    mean = shapes.mean(0)
    distances = np.linalg.norm(shapes - mean, axis=(1, 2))
    return Superimposed(shapes, sizes, mean, distances, rested)


def centroid_size(points: Float[np.ndarray, "*s l 3"]) -> Float[np.ndarray, "*s"]:
    """The root of the summed squared distances from the centroid.

    Of the landmarks that are there; nan without one.
    """
    known = np.ma.masked_invalid(points)
    squares = (known - known.mean(-2, keepdims=True)) ** 2
    return np.ma.filled(np.sqrt(squares.sum((-2, -1))), np.nan)


def similarity(
    points: Float[np.ndarray, "l 3"], onto: Float[np.ndarray, "l 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Scale s, rotation R and shift t by which s x R + t is nearest to others.

    In root mean square distance (Umeyama, IEEE PAMI 1991, without reflection).
    """
    centred, goal = points - points.mean(0), onto - onto.mean(0)
    turn = rotations(goal, centred[None])[0].T
    scale = float((centred @ turn * goal).sum() / (centred**2).sum())
    return scale, turn, onto.mean(0) - scale * points.mean(0) @ turn


def turned(
    shapes: Float[np.ndarray, "s l 3"], onto: Float[np.ndarray, "l 3"]
) -> Float[np.ndarray, "s l 3"]:
    """Shapes turned about the origin onto one."""
    return shapes @ np.swapaxes(rotations(onto, shapes), 1, 2)


def rotations(
    onto: Float[np.ndarray, "l 3"], shapes: Float[np.ndarray, "s l 3"]
) -> Float[np.ndarray, "s 3 3"]:
    """The rotation of each shape onto one, shape @ R.T; no reflection (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(np.einsum("la,slb->sab", onto, shapes))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return u @ vt


def _turned(shapes):
    """Shapes turned onto their mean until it rests, and whether it does."""
    spread = lambda: len(shapes) * (1 - (shapes.mean(0) ** 2).sum())
    before, number = spread(), 1
    change = before
    while change > TOLERANCE and number < TURNS:
        shapes = turned(shapes, shapes.mean(0))
        change, before = abs(before - spread()), spread()
        number += 1
    return shapes, bool(change <= TOLERANCE)


def _slid(shapes, sliders, bending):
    """Shapes slid towards their mean, and turned onto it, until it rests; and whether.

    As in gpagen they are neither centred nor scaled again, and the first mean has the
    size that it has.
    """
    mean = shapes.mean(0)
    before = change = len(shapes) * (mean**2).sum()
    number = 0
    while change > TOLERANCE and number < SLIDES:
        if bending and is_flat(mean):
            words = (
                "the landmarks lie in a plane, where the spline in space is not "
                'defined; slide="procrustes"'
            )
            raise PointsError("procrustes", words)
        energy = bending_energy(mean) if bending else None
        shapes = slide(shapes, mean, sliders, energy)
        now = len(shapes) * (shapes.mean(0) ** 2).sum()
        change, before = abs(before - now), now
        shapes = turned(shapes, mean)
        mean = shapes.mean(0)
        mean = mean / np.linalg.norm(mean - mean.mean(0))
        number += 1
    return shapes, bool(change <= TOLERANCE)


def _axes(mean):
    """The principal axes of a mean as columns, a rotation; see `procrustes`."""
    axes = np.linalg.svd(mean - mean.mean(0))[2].T
    axes = axes * np.where(np.diag(axes) > 0, 1, -1)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return axes


def _in_tangent_space(shapes):
    mean = shapes.mean(0) - shapes.mean((0, 1))
    mean /= np.linalg.norm(mean)
    along = np.einsum("slc,lc->s", shapes, mean)
    return shapes + (1 - along)[:, None, None] * mean
