"""Semilandmarks: points along curves of a surface, and spread over parts of it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.apps.landmarks._outlines import Outline
from jfsf.apps.landmarks._patches import spread
from jfsf.apps.landmarks._paths import Paths, at_shares, length_of
from jfsf.apps.landmarks._place import nearest, on_surface
from jfsf.apps.landmarks._record import Landmarks
from jfsf.mesh import surface_area
from jfsf.types import ArrayLike, Mesh

# A control point of Slicer is the landmark that is so near, in sqrt(area): by hand, the
# distance between two clicks on one place. Two points in one place cannot be slid.
_SAME = 0.01


class Semilandmarks(NamedTuple):
    """Points of the template, which follow on its landmarks.

    names: of each point.
    points: on the surface.
    slide: for each point of a curve that slides, the point before it, its own, and the
        one after it; numbers of landmarks and semilandmarks together, from 0.
    surface: numbers of the points of patches, after those of the landmarks.
    """

    names: tuple[str, ...]
    points: Float[np.ndarray, "p 3"]
    slide: Int[np.ndarray, "c 3"]
    surface: Int[np.ndarray, " q"]


def semilandmarks(
    mesh: Mesh, landmarks: Float[ArrayLike, "l 3"], outlines: Sequence[Outline]
) -> Semilandmarks:
    """Points on the curves and patches of a template.

    The points of a curve are spread over the paths between the landmarks on it so that
    the largest gap is least, and equally along each. A closed curve without landmarks
    has them equally spaced from its first control point on. Those of a patch lie on the
    smaller of the two parts that its rim makes, each the farthest from the rim and
    those before it.

    Args:
        mesh: the template, of one piece.
        landmarks: on its surface.
        outlines: of `read_outlines`.

    Raises:
        ValueError: the mesh is no manifold, a curve is far from it, or no surface is
            within a rim.
    """
    landmarks = np.asarray(landmarks, float).reshape(-1, 3)
    same = _SAME * float(np.sqrt(surface_area(mesh)))
    anchors = [_anchors(one, mesh, landmarks, same) for one in outlines]
    paths = Paths(mesh, np.concatenate([landmarks, *(own for own, _ in anchors)]))
    first = next_number = len(landmarks)
    names, points, slide, surface = [], [], [], []
    for one, (own, known) in zip(outlines, anchors, strict=True):
        at = np.where(known < 0, first + np.arange(len(own)), known)
        first += len(own)
        closed = one.kind != "curve"
        legs = zip(at, np.append(at[1:], at[:1]) if closed else at[1:], strict=False)
        lines = [paths.between(a, b) for a, b in legs]
        if one.kind == "patch":
            new = spread(mesh, np.concatenate(lines), one)
            surface += range(next_number, next_number + len(new))
        else:
            new, order = _along(lines, known, one.number, next_number)
            slide += order
        names += [f"{one.name}_{i}" for i in range(1, len(new) + 1)]
        points.append(new)
        next_number += len(new)
    together = np.concatenate([np.zeros((0, 3)), *points])
    return Semilandmarks(
        tuple(names),
        nearest(mesh, together).points if len(together) else together,
        np.array(slide, int).reshape(-1, 3),
        np.array(surface, int),
    )


def _anchors(one: Outline, mesh: Mesh, landmarks, same: float):
    """Points that an outline passes beside landmarks; of all, the landmark or -1."""
    if one.controls is None:
        known = np.array(one.landmarks, int)
        return landmarks[known], known
    controls = np.asarray(one.controls, float)
    called = tuple(f"{one.name}, point {i}" for i in range(1, len(controls) + 1))
    own = np.array(on_surface(Landmarks(called, controls), mesh).points)
    if not len(landmarks):
        return own, np.full(len(own), -1)
    away, near = KDTree(landmarks).query(own)
    known = np.where(away < same, near, -1)
    return np.where(away[:, None] < same, landmarks[near], own), known


def _along(lines, known, number: int, first: int):
    """Points of a curve between the landmarks on it, and their neighbours.

    Args:
        lines: the path from each point that it passes to the next; as many as there are
            points if it is closed.
        known: the landmark, from 0, that each of these points is, or -1. An end that is
            none is a point of the curve too, which does not slide.
        number: of points that slide.
        first: the number of the first new point.
    """
    if len(lines) == len(known):
        start = int((known >= 0).argmax())
        if known[start] < 0:
            order = list(range(first, first + number))
            points = at_shares(np.concatenate(lines), np.arange(number) / number)
            return points, _neighbours([order[-1], *order, order[0]])
        lines = lines[start:] + lines[:start]
        known = np.append(np.roll(known, -start), known[start])
    cuts = np.flatnonzero(known >= 0)
    cuts = np.unique([0, *cuts, len(lines)]).tolist()
    spans = [np.concatenate(lines[a:b]) for a, b in zip(cuts, cuts[1:], strict=False)]
    length = np.array([length_of(span) for span in spans])
    counts = np.zeros(len(spans), int)
    for _ in range(number):
        counts[np.argmax(length / (counts + 1))] += 1
    points, slide, before = [], [], int(known[0])
    if known[0] < 0:
        points, before, first = [spans[0][:1]], first, first + 1
    for cut, span, count in zip(cuts[1:], spans, counts, strict=True):
        points.append(at_shares(span, np.arange(1, count + 1) / (count + 1)))
        order, first = list(range(first, first + count)), first + count
        after = int(known[cut])
        if known[cut] < 0:
            after = first
            points.append(span[-1:])
        slide += _neighbours([before, *order, after])
        before = after
    return np.concatenate(points), slide


def _neighbours(order: list[int]) -> list[list[int]]:
    """The point before each but the ends, itself, and the one after it."""
    return [list(three) for three in zip(order, order[1:], order[2:], strict=False)]
