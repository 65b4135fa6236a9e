"""What a scanner adds to a point cloud: single points in the air, a floor or a wall.

Outliers are told by their distances to their neighbours (as in LOF: Breunig et al.,
2000). A floor is a plane that holds many points, has all others on one side, and ends
where no other points are: the flat base of a solid ends at its walls.
"""

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError

from jfsf.mesh._geometry import in_unit_box
from jfsf.types import ArrayLike, Mesh

FEWEST = 100  # points, below which nothing is told
NEIGHBOURS = 8
# A point is an outlier if its mean distance to its neighbours is this many times the
# median of theirs, and also this many times the quantile of all; or, among outliers,
# if it is FAR times the quantile. Of 169 shapes (people, animals, objects) without
# outliers none has such a point; of uniform ones around them that are 8 spacings or
# more from the shape, 1 % or 5 % of the points, all are found on nine shapes of ten.
ALONE, SPREAD, FAR = 2.5, 2.0, 4.5
QUANTILE = 0.9
ROUNDS = 5  # outliers beside each other are seen one after the other
MOST_OUTLIERS = 0.2  # more are no outliers, but how the cloud is sampled
# A floor: share of the points that it holds at least, and that are left beside it.
LEAST_FLOOR = 0.08
LEAST_REST = 0.15
# Share of the points that are not on its other side, at least.
ONE_SIDE = 0.98
# In the distance of neighbours: how far from the plane its points are, and how far from
# its rim no other points are where it is free.
THICKNESS = 1.5
FREE = 4.0
DEVIATIONS = 4.0  # of the noise of a plane, up to which a point belongs to it
LEAST_FREE = 0.6  # share of the rim; a wall may stand on another part of it
# Share of the other points that are above it, and not beside it as by a flat wing; and
# the median height of its own points, which are no curved or doubled sheet. By these
# none of the 169 shapes has a floor; the wings of two birds come next, at 0.5.
LEAST_ABOVE = 0.6
FLATNESS = 0.4
LEAST_FILLED = 0.5  # share of the convex hull of a floor that has points
PLANES = 3  # floors and walls that are looked for
SEEDS = 100  # places where a plane is tried
ENOUGH = 20_000  # points among which planes are tried
LOCAL = 30  # points of the first plane of a place
REFITS = 6


def outliers(cloud: Mesh) -> ArrayLike:
    """Whether each point (n,) is far from all others, compared with these.

    Args:
        cloud: n finite points in any unit. A mesh with faces has no outliers.
    """
    points = np.asarray(cloud.vertices, np.float64)
    found = np.zeros(len(points), bool)
    if len(points) < FEWEST or len(cloud.faces):
        return found
    points = in_unit_box(points)
    for _ in range(ROUNDS):
        left = np.flatnonzero(~found)
        found_near = KDTree(points[left]).query(points[left], k=NEIGHBOURS + 1)
        distance, near = map(np.asarray, found_near)
        # The mean of the nearest neighbours; the first is the point itself.
        own = distance[:, 1:].mean(1)
        around = np.median(own[near[:, 1:]], axis=1)
        usual = np.quantile(own, QUANTILE)
        far = (own > ALONE * around) & (own > SPREAD * usual) | (own > FAR * usual)
        if not far.any():
            break
        found[left[far]] = True
        if found.mean() > MOST_OUTLIERS:
            return np.zeros(len(points), bool)
    return found


def floor_points(cloud: Mesh) -> ArrayLike:
    """Whether each point (n,) belongs to a floor or a wall that the shape stands at.

    Args:
        cloud: n finite points in any unit, without outliers. A mesh with faces has
            no floor.

    Returns:
        The points of planes, and those behind them. The same for the same points: the
        places that are tried are drawn from a fixed seed.
    """
    points = np.asarray(cloud.vertices, np.float64)
    found = np.zeros(len(points), bool)
    if len(points) < FEWEST or len(cloud.faces):
        return found
    points = in_unit_box(points)
    for _ in range(PLANES):
        left = np.flatnonzero(~found)
        floor = _floor(points[left]) if len(left) >= FEWEST else None
        if floor is None:
            break
        found[left[floor]] = True
    return found


def _floor(points):
    """The points (n,) of the largest floor, None if there is none."""
    n, rng = len(points), np.random.default_rng(0)
    thickness = THICKNESS * _spacing(points, KDTree(points))
    if thickness == 0:
        return None
    some = points if n <= ENOUGH else points[rng.choice(n, ENOUGH, replace=False)]
    tree = KDTree(some)
    best, most = None, LEAST_FLOOR * len(some)
    for seed in rng.choice(len(some), min(len(some), SEEDS), replace=False).tolist():
        near = tree.query(some[seed], k=min(LOCAL, len(some)))[1]
        centre, normal = _refitted(some, near, thickness)
        height = (some - centre) @ normal
        on = np.abs(height) <= thickness
        if on.sum() <= most:
            continue
        # The other points are above.
        if (height > 0).sum() < (height < 0).sum():
            height, normal = -height, -normal
        below = height < -thickness
        if below.mean() > 1 - ONE_SIDE or (height > thickness).mean() < LEAST_REST:
            continue
        flat = np.median(np.abs(height[on]))
        if flat > FLATNESS / THICKNESS * thickness:
            continue
        if _ends_free(some, on, _spacing(some, tree)):
            # A floor with less noise takes less of what stands on it.
            limit = min(thickness, DEVIATIONS * flat / 0.6745)  # as of normal noise
            best, most = (points - centre) @ normal <= limit, on.sum()
    return best


def _spacing(points, tree):
    return np.median(tree.query(points, k=2)[0][:, 1])


def _refitted(points, near, thickness):
    """Centre and normal of the plane that grows from these points."""
    count, plane = 0, _plane(points[near])
    for _ in range(REFITS):
        near = np.flatnonzero(np.abs((points - plane[0]) @ plane[1]) <= thickness)
        if len(near) <= max(count, 3):
            break
        count, plane = len(near), _plane(points[near])
    return plane


def _plane(points):
    """Centre and normal."""
    centre = points.mean(0)
    away = points - centre
    return centre, np.linalg.eigh(away.T @ away)[1][:, 0]


def _ends_free(points, on, spacing) -> bool:
    """Whether a plane's points fill a region below the others, with a free rim."""
    away = points - points[on].mean(0)
    across = np.linalg.eigh(away[on].T @ away[on])[1][:, 1:]
    flat, rest = away[on] @ across, away[~on] @ across
    try:
        hull = ConvexHull(flat)
    except QhullError:
        return False
    inside = (rest @ hull.equations[:, :2].T <= -hull.equations[:, 2]).all(1)
    if inside.mean() < LEAST_ABOVE:
        return False
    distance = KDTree(points[~on]).query(points[on][hull.vertices])[0]
    if (distance > FREE * spacing).mean() < LEAST_FREE:
        return False
    cell = 3 * spacing
    filled = len(np.unique(np.floor(flat / cell), axis=0)) * cell**2
    return filled >= LEAST_FILLED * hull.volume  # in the plane, its area
