"""The thin-plate spline in space: a smooth map that takes landmarks to landmarks.

Bookstein (Principal warps, IEEE PAMI 1989), with the kernel r of three dimensions:

    f(x) = a + B x + sum_i c_i |x - x_i|,   f(x_i) = y_i,

of least bending energy. `scipy.interpolate.RBFInterpolator` solves it.
"""

import numpy as np
from jaxtyping import Float
from scipy.interpolate import RBFInterpolator

from jfsf.apps.morphometrics._checks import check_points, is_flat
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
    points = np.asarray(points, float)
    landmarks, targets = check_points("warp", [landmarks, targets])
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"warp: points are {points.shape}; pass (n, 3)")
    if is_flat(landmarks):
        raise ValueError(
            f"warp: the {len(landmarks)} landmarks lie in a plane; the spline needs "
            "four or more that do not"
        )
    if len(np.unique(landmarks, axis=0)) < len(landmarks):
        raise ValueError("warp: two landmarks are at one place; leave one out")
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
        counts = [f"landmark {i} (in {lost[:, i].sum()})" for i in often]
        raise ValueError(
            f"estimate_missing: {len(whole)} of {len(points)} specimens have all "
            f"landmarks, two are needed; most often {' and '.join(counts)} is missing: "
            "leave landmarks or specimens out"
        )
    aligned = procrustes(whole)
    mean = (aligned.shapes * aligned.sizes[:, None, None]).mean(0)
    estimated = points.copy()
    for i in np.flatnonzero(lost.any(1)):
        have = ~lost[i]
        if is_flat(points[i, have]) or is_flat(mean[have]):
            raise ValueError(
                f"estimate_missing: specimen {i} has {have.sum()} of {len(have)} "
                "landmarks, fewer than four or all in a plane; leave it out"
            )
        estimated[i, ~have] = warp(mean[~have], mean[have], points[i, have])
    return estimated
