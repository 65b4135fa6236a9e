"""The thin-plate spline in space: a smooth map that takes landmarks to landmarks.

Bookstein (Principal warps, IEEE PAMI 1989), with the kernel r of three dimensions:

    f(x) = a + B x + sum_i c_i |x - x_i|,   f(x_i) = y_i,

of least bending energy. `scipy.interpolate.RBFInterpolator` solves it.
"""

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RBFInterpolator

from jfsf.apps.morphometrics._checks import PointsError, check_points, is_flat
from jfsf.apps.morphometrics._procrustes import procrustes
from jfsf.types import ArrayLike


def warp(
    points: Float[ArrayLike, "n 3"],
    landmarks: Float[ArrayLike, "l 3"],
    targets: Float[ArrayLike, "l 3"],
) -> Float[np.ndarray, "n 3"]:
    """Points moved by the thin-plate spline that takes landmarks to targets.

    Args:
        points: such as the vertices of a mesh.
        landmarks: in the coordinates of the points.
        targets: where each landmark goes.

    Raises:
        ValueError: wrong shapes, values that are not finite, landmarks that lie in a
            plane, or two at one place.
    """
    given = points, landmarks, targets
    points, landmarks, targets = (np.asarray(one, float) for one in given)
    l = len(landmarks) if landmarks.ndim else 0
    fits = points.shape[1:] == (3,) and landmarks.shape == targets.shape == (l, 3)
    if not fits or not all(np.isfinite(one).all() for one in (landmarks, targets)):
        raise ValueError(
            f"warp: points are {points.shape}, landmarks {landmarks.shape} and targets "
            f"{targets.shape}; pass finite (n, 3), (l, 3) and (l, 3)"
        )
    if is_flat(landmarks):
        words = f"the {l} landmarks lie in a plane; the spline needs four that do not"
        raise PointsError("warp", words)
    if len(np.unique(landmarks, axis=0)) < l:
        raise PointsError("warp", "two landmarks are at one place; leave one out")
    return RBFInterpolator(landmarks, targets, kernel="linear", degree=1)(points)


def estimate_missing(
    points: Float[ArrayLike, "s l 3"],
) -> Float[np.ndarray, "s l 3"]:
    """Landmarks of specimens, those that are missing estimated from the others.

    The mean of the specimens that have all landmarks, at their sizes, is warped onto
    each other specimen by those that it has (`warp`); so its missing ones are where a
    specimen that bends as little as possible would have them (Gunz et al., J. Hum.
    Evol. 2009; `geomorph::estimate.missing`, method "TPS").

    Args:
        points: nan where a specimen lacks a landmark.

    Raises:
        ValueError: fewer than two specimens have all landmarks, or one has fewer than
            four, or has them in a plane.
    """
    points = check_points("estimate_missing", points, missing=True)
    lost = np.isnan(points).all(2)
    if not lost.any():
        return points
    whole = points[~lost.any(1)]
    if len(whole) < 2:
        often = np.argsort(-lost.sum(0), kind="stable")[:2]
        first, second = lost[:, often].sum(0)
        words = (
            f"{len(whole)} of {len(points)} specimens have all landmarks, two are "
            f"needed; most often landmark {{landmarks[0]}} (in {first}) and landmark "
            f"{{landmarks[1]}} (in {second}) is missing: leave landmarks or specimens "
            "out"
        )
        raise PointsError("estimate_missing", words, landmarks=often)
    aligned = procrustes(whole)
    mean = (aligned.shapes * aligned.sizes[:, None, None]).mean(0)
    estimated = points.copy()
    for i in np.flatnonzero(lost.any(1)):
        have = ~lost[i]
        if is_flat(points[i, have]) or is_flat(mean[have]):
            words = (
                f"specimen {{specimen}} has {have.sum()} of {len(have)} landmarks, "
                "fewer than four or all in a plane; leave it out"
            )
            raise PointsError("estimate_missing", words, specimen=i)
        estimated[i, ~have] = warp(mean[~have], mean[have], points[i, have])
    return estimated
