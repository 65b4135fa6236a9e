"""What a point sees within some distances: descriptors that no cut beyond changes.

Those that a caller gives are compared beside them.
"""

import numpy as np

from jfsf.matching.parts._settings import PartSettings
from jfsf.matching.parts._shape import PartSamples

# Columns of a radius.
COLUMNS = 5


def ball_descriptors(
    samples: PartSamples,
    which,
    scale: float = 1.0,
    *,
    settings: PartSettings = PartSettings(),
) -> np.ndarray:
    """Area, curvature and extent of the geodesic balls around samples.

    Args:
        samples: the shape.
        which: (a,) samples.
        scale: factor that brings the shape to the size of the other.
        settings: radii and border of the balls.

    Returns:
        (a, radii, columns); nan where the ball meets the boundary.
    """
    points, mass = samples.mesh.vertices * scale, samples.mass * scale**2
    radii, steepness = settings.ball_radii, settings.ball_steepness
    out = np.full((len(which), len(radii), COLUMNS), np.nan)
    distance = samples.distance[which] * scale
    free = samples.to_boundary[samples.at[which]] * scale
    for row, (i, far) in enumerate(zip(which, distance, strict=True)):
        near = np.flatnonzero(far < radii[-1] * settings.ball_reach)
        centre = samples.at[i]
        apart = points[near] - points[centre]
        for col, radius in enumerate(radii):
            if free[row] < radius:
                continue
            # A soft border: few vertices lie in a small ball.
            weight = mass[near] / (1 + np.exp(steepness * (far[near] / radius - 1)))
            total = weight.sum()
            middle = weight @ apart / total
            spread = (apart - middle).T @ ((apart - middle) * weight[:, None]) / total
            extent = np.sqrt(np.maximum(np.linalg.eigvalsh(spread), 0)) / radius
            rise = middle @ samples.normal[centre] / radius
            out[row, col] = np.log(total / radius**2), 2 * rise, *(2 * extent)
    return out


def unlikeness(
    balls_x: np.ndarray,
    balls_y: np.ndarray,
    *,
    settings: PartSettings = PartSettings(),
) -> np.ndarray:
    """(a, b) mean difference of what two points see, in `ball_difference_unit`.

    Where nothing can be compared it is the mean of all that can.
    """
    flat = balls_y.reshape(-1, *balls_y.shape[1:])
    # By hand: `nanstd` warns of a radius at which every ball meets the boundary.
    count = np.maximum((~np.isnan(flat)).sum(0), 1)
    middle = np.nansum(flat, 0) / count
    width = np.sqrt(np.nansum((flat - middle) ** 2, 0) / count) + 1e-6
    apart = np.abs(balls_x[:, None] - balls_y[None]) / width
    known = ~np.isnan(apart)
    total = np.where(known, np.minimum(apart, settings.max_ball_difference), 0).sum(
        (2, 3)
    )
    count = known.sum((2, 3))
    mean = total / np.maximum(count, 1)
    usual = (
        mean[count > 0].mean() if (count > 0).any() else settings.unread_ball_difference
    )
    return np.where(count > 0, mean, usual) / settings.ball_difference_unit


def descriptor_unlikeness(
    given_x: np.ndarray,
    given_y: np.ndarray,
    *,
    settings: PartSettings = PartSettings(),
) -> np.ndarray:
    """(a, b) mean squared difference of descriptors in `ball_difference_unit`.

    Args:
        given_x, given_y: (a, d) and (b, d), column i of one like column i of the other.
        settings: the unit, in standard deviations over `given_y`; differences above
            `max_ball_difference` count as that.
    """
    width = given_y.std(0)
    unit = settings.ball_difference_unit * np.where(width > 0, width, 1)
    most = settings.max_ball_difference / settings.ball_difference_unit
    total = np.zeros((len(given_x), len(given_y)))
    # Column by column: there may be hundreds.
    for x, y in zip((given_x / unit).T, (given_y / unit).T, strict=True):
        total += np.minimum(np.abs(x[:, None] - y[None]), most) ** 2
    return total / given_x.shape[1]
