"""Polygons -> triangles: fans of convex ones, and ears of others (numpy)."""

from heapq import heapify, heappop, heappush

import numpy as np

from jfsf.mesh._values import MeshError
from jfsf.types import ArrayLike

# Sine of the angle by which a corner may turn inward and still counts as straight:
# coordinates of seven digits bend straight lines by less.
STRAIGHT = 1e-6
# A polygon with more corners stays a fan: the time for its ears grows with the square.
MOST_CORNERS = 2000
_FLAT = 1e-300


def triangulate(
    sizes: ArrayLike, corners: ArrayLike, vertices: ArrayLike | None = None
) -> ArrayLike:
    """Split polygons, in order, into triangles.

    A convex polygon becomes a fan around its first corner. One whose fan would fold
    over is cut ear by ear (Meisters, 1975) in the plane of its Newell normal. One that
    crosses itself there becomes a fan too.

    Args:
        sizes: (p,) corners of each polygon.
        corners: (sum of sizes,) their vertices, one polygon after the other.
        vertices: (n, 3) positions; without them all become fans.

    Returns:
        (m, 3) int64 with m = sum of (sizes - 2); those of a polygon are together.

    Raises:
        MeshError: a polygon with fewer than three corners, or a fractional vertex.
    """
    sizes, whole = np.asarray(sizes, np.int64), np.asarray(corners)
    if (sizes < 3).any():
        face = np.argmax(sizes < 3)
        raise MeshError(
            f"face {face} has {sizes[face]} vertices and splits into no triangle",
            "delete such faces",
        )
    corners = whole.astype(np.int64)
    if (corners != whole).any():
        raise MeshError(
            f"a face names vertex {whole[corners != whole][0]}", "export the mesh again"
        )
    pieces = sizes - 2
    start = np.cumsum(sizes) - sizes
    first = np.repeat(start, pieces)
    before = np.cumsum(pieces) - pieces  # triangles of the polygons before
    step = first + np.arange(len(first)) - np.repeat(before, pieces)
    triangles = np.stack([corners[first], corners[step + 1], corners[step + 2]], axis=1)
    if vertices is None or (sizes == 3).all():
        return triangles
    points = np.asarray(vertices)
    if points.shape[1:] != (3,):
        return triangles
    for polygon, (normal, centre) in _concave(sizes, corners, points):
        ring = corners[start[polygon] : start[polygon] + sizes[polygon]]
        flat = _flat(points[ring], normal, centre)
        if not _is_fan(flat) and (ears := _ears(flat)) is not None:
            at = before[polygon]
            triangles[at : at + len(ears)] = ring[ears]
    return triangles


def _concave(sizes, corners, vertices):
    """(polygon, (its Newell normal, its centre)) of those with a corner turned inward.

    Polygons with vertices out of range or not finite are left to the checks that
    follow, and those without an area have no inside.
    """
    found = []
    start = np.cumsum(sizes) - sizes
    for size in np.unique(sizes[(sizes > 3) & (sizes <= MOST_CORNERS)]).tolist():
        polygons = np.flatnonzero(sizes == size)
        rings = corners[start[polygons][:, None] + np.arange(size)]
        known = ((rings >= 0) & (rings < len(vertices))).all(1)
        polygons, points = polygons[known], vertices[rings[known]].astype(np.float64)
        known = np.isfinite(points).all((1, 2))
        polygons, points = polygons[known], points[known]
        # Centred and scaled, so that no product overflows.
        centre = points.mean(1, keepdims=True)
        points = points - centre
        scale = np.abs(points).max((1, 2), keepdims=True)
        points = points / np.where(scale > 0, scale, 1)
        after = np.roll(points, -1, axis=1)
        normal = np.cross(points, after).sum(1)
        length = np.linalg.norm(normal, axis=1)
        normal = normal / np.where(length > 0, length, 1)[:, None]
        side = after - points
        turn = (np.cross(np.roll(side, 1, axis=1), side) * normal[:, None]).sum(2)
        lengths = np.linalg.norm(side, axis=2)
        inward = turn < -STRAIGHT * lengths * np.roll(lengths, 1, axis=1)
        for i in np.flatnonzero(inward.any(1) & (length > 0)).tolist():
            found.append((int(polygons[i]), (normal[i], centre[i])))
    return found


def _flat(points, normal, centre):
    """The points (n, 2) seen against the normal, counter-clockwise."""
    points = points - centre
    points = points / np.abs(points).max()
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across = across / np.linalg.norm(across)
    return np.stack([points @ across, points @ np.cross(normal, across)], axis=1)


def _is_fan(points) -> bool:
    """Whether the fan around the first corner does not fold over."""
    return bool((_area(points[0], points[1:-1], points[2:]) >= 0).all())


def _ears(points):
    """Triangles (n - 2, 3) of a simple polygon; None if there is no ear at some time.

    Each cut takes the ear with the largest smallest angle among the corners that are
    left, so the triangles are less thin than those of the first ear found.
    """
    n = len(points)
    before, after = np.roll(np.arange(n), 1), np.roll(np.arange(n), -1)
    left, triangles = np.ones(n, bool), []

    def ear(corner):
        return [before[corner], corner, after[corner]]

    quality = [_quality(*points[ear(corner)]) for corner in range(n)]
    heap = [(-value, corner) for corner, value in enumerate(quality)]
    heapify(heap)
    while len(triangles) < n - 3:
        blocked, found = [], None
        while heap and found is None:
            value, corner = heappop(heap)
            if not left[corner] or -value != quality[corner]:
                continue  # it is gone, or stands further up with its new quality
            if value >= 0:
                return None
            if _is_empty(points, ear(corner), left):
                found = corner
            else:
                blocked.append((value, corner))
        if found is None:
            return None
        for item in blocked:
            heappush(heap, item)
        triangles.append(ear(found))
        one, _, two = ear(found)
        left[found], after[one], before[two] = False, two, one
        for near in (one, two):
            quality[near] = _quality(*points[ear(near)])
            heappush(heap, (-quality[near], near))
    return np.array([*triangles, ear(int(np.argmax(left)))])


def _quality(a, b, c) -> float:
    """Sine of the smallest angle of the triangle; below 0 if its corner is no ear.

    A flat one is the last choice.
    """
    sides = sorted(np.linalg.norm([b - a, c - b, a - c], axis=1).tolist())
    whole = sides[1] * sides[2]
    found = float(_area(a, b, c)) / whole if whole else 0.0
    return _FLAT if abs(found) <= STRAIGHT else found


def _is_empty(points, ear, left) -> bool:
    """Whether no other corner that is left lies in the triangle."""
    a, b, c = points[ear]
    others = left.copy()
    others[ear] = False
    others = points[others]
    # A corner in the same place as one of these, as where two rims touch, is outside.
    others = others[~(others[:, None] == points[ear]).all(2).any(1)]
    inside = (
        (_area(a, b, others) >= 0)
        & (_area(b, c, others) >= 0)
        & (_area(c, a, others) >= 0)
    )
    return not inside.any()


def _area(a, b, c):
    """Twice the signed area; `a` is one point, the others may be many."""
    one, two = b - a, c - a
    return one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
