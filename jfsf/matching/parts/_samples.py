"""Mesh -> PartSamples: what survives a cut, read at samples. Host side (numpy).

A cut changes the spectrum everywhere. Geodesics inside the part, directions along the
surface and the surface within a distance smaller than that of the cut stay. So samples
are compared by the geodesic balls around them, and by descriptors that a caller gives.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.geometry import GeodesicSolver
from jfsf.mesh._geometry import (
    boundary_edges,
    face_normals,
    farthest_vertices,
    vertex_areas,
    vertex_normals,
)
from jfsf.types import ArrayLike, Mesh

# Vertices on the boundary, at most, from which the distance to it is measured.
BOUNDARY_SAMPLES = 80
# A shortest path between two samples may run along the cut, and so be shorter in the
# whole, if a path by the boundary is at most this factor as long and this length, in
# sqrt(area of the whole), longer.
ALONG_CUT_FACTOR, ALONG_CUT_SLACK = 1.02, 0.01
# Radii of the geodesic balls around a sample, in sqrt(area of the whole), ascending.
BALL_RADII = 0.05, 0.08, 0.12, 0.17, 0.23, 0.3
# Of the soft border of a ball: a vertex at r (1 + 1 / BALL_STEEPNESS) has weight 0.27.
BALL_STEEPNESS = 12.0
BALL_REACH = 1.2  # in greatest radii: beyond this distance a vertex has no weight
COLUMNS = 5  # numbers that describe the ball of one radius
MAX_DIFFERENCE = 3.0  # in standard deviations; a greater difference counts as this
DIFFERENCE_UNIT = 1.5  # standard deviations that count as 1
UNREAD_DIFFERENCE = 0.5  # in standard deviations: of all samples, if none are compared


class PartSamples(NamedTuple):
    """A shape at samples, lengths in the unit that both shapes share.

    mesh: in that unit, wound outward.
    at: (s,) vertices, each far from those before it.
    distance: (s, n) geodesics from these.
    direction: (s, s) complex; entry (i, j) is the unit direction at sample i towards
        sample j, in a tangent frame of i whose third axis is the outward normal.
    normal: (n, 3) outward unit normals.
    mass: (n,) vertex areas.
    to_boundary: (n,) geodesic distance to the boundary; inf if there is none.
    around: (s, s) length of the shortest path between two samples by the boundary.
    landmarks: (l,) the samples at landmarks, which come last, in their order.
    descriptors: (s, d) those that were given, at the samples; None without any.
    """

    mesh: Mesh
    at: ArrayLike
    distance: ArrayLike
    direction: ArrayLike
    normal: ArrayLike
    mass: ArrayLike
    to_boundary: ArrayLike
    around: ArrayLike
    landmarks: ArrayLike = np.zeros(0, np.int64)
    descriptors: ArrayLike | None = None

    @property
    def between(self) -> np.ndarray:
        """(s, s) distances between samples, symmetric."""
        between = self.distance[:, self.at]
        return (between + between.T) / 2


def part_samples(
    mesh: Mesh,
    num: int,
    *,
    landmarks: ArrayLike = (),
    descriptors: ArrayLike | None = None,
) -> PartSamples:
    """`num` samples of a connected mesh, wound outward; fewer vertices, fewer samples.

    Args:
        mesh: in the common unit.
        num: samples, those at landmarks not counted.
        landmarks: (l,) vertices.
        descriptors: (n, d), a row for each vertex.
    """
    n, solver = len(mesh.vertices), GeodesicSolver(mesh)
    edge = np.unique(boundary_edges(mesh.faces))
    to_boundary, from_edge = np.full(n, np.inf), np.zeros((0, n))
    if len(edge):
        step = -(-len(edge) // BOUNDARY_SAMPLES)
        from_edge = solver.rows(edge[::step])
        to_boundary = from_edge.min(0)
        to_boundary[edge] = 0
    extremity = int(farthest_vertices(mesh, 2)[1])
    at = farthest_vertices(mesh, min(num, n), start=extremity)
    known = len(at) + np.arange(len(landmarks))
    at = np.concatenate([at, np.asarray(landmarks, at.dtype)])
    distance = solver.rows(at)
    normal, mass = vertex_normals(*mesh), vertex_areas(*mesh)
    direction = _directions(mesh, at, distance, normal)
    around = np.full((len(at), len(at)), np.inf)
    for row in from_edge[:, at]:
        around = np.minimum(around, row[:, None] + row[None])
    given = None if descriptors is None else np.asarray(descriptors, float)[at]
    return PartSamples(
        *(mesh, at, distance, direction, normal, mass, to_boundary, around),
        *(known, given),
    )


def along_cut(around, between) -> np.ndarray:
    """Whether shortest paths run along a cut: in the whole they may be shorter.

    Args:
        around, between: of `PartSamples`, or rows and columns of these.
    """
    return around < ALONG_CUT_FACTOR * between + ALONG_CUT_SLACK


def ball_descriptors(samples: PartSamples, which, scale: float = 1.0) -> np.ndarray:
    """Area, curvature and extent of the geodesic balls around samples.

    Args:
        samples: the shape.
        which: (a,) samples.
        scale: factor that brings the shape to the size of the other.

    Returns:
        (a, radii, columns); nan where the ball meets the boundary.
    """
    points, mass = samples.mesh.vertices * scale, samples.mass * scale**2
    out = np.full((len(which), len(BALL_RADII), COLUMNS), np.nan)
    distance = samples.distance[which] * scale
    free = samples.to_boundary[samples.at[which]] * scale
    for row, (i, far) in enumerate(zip(which, distance, strict=True)):
        near = np.flatnonzero(far < BALL_RADII[-1] * BALL_REACH)
        centre = samples.at[i]
        apart = points[near] - points[centre]
        for col, radius in enumerate(BALL_RADII):
            if free[row] < radius:
                continue
            # A soft border: few vertices lie in a small ball.
            weight = mass[near] / (
                1 + np.exp(BALL_STEEPNESS * (far[near] / radius - 1))
            )
            total = weight.sum()
            middle = weight @ apart / total
            spread = (apart - middle).T @ ((apart - middle) * weight[:, None]) / total
            extent = np.sqrt(np.maximum(np.linalg.eigvalsh(spread), 0)) / radius
            rise = middle @ samples.normal[centre] / radius
            out[row, col] = np.log(total / radius**2), 2 * rise, *(2 * extent)
    return out


def ball_difference(balls_x: np.ndarray, balls_y: np.ndarray) -> np.ndarray:
    """(a, b) mean difference of the balls around two samples, in `DIFFERENCE_UNIT`.

    Where nothing can be compared it is the mean of all that can.
    """
    flat = balls_y.reshape(-1, *balls_y.shape[1:])
    # By hand: `nanstd` warns of a radius at which every ball meets the boundary.
    count = np.maximum((~np.isnan(flat)).sum(0), 1)
    middle = np.nansum(flat, 0) / count
    width = np.sqrt(np.nansum((flat - middle) ** 2, 0) / count) + 1e-6
    apart = np.abs(balls_x[:, None] - balls_y[None]) / width
    both = ~np.isnan(apart)
    total = np.where(both, np.minimum(apart, MAX_DIFFERENCE), 0).sum((2, 3))
    count = both.sum((2, 3))
    mean = total / np.maximum(count, 1)
    usual = mean[count > 0].mean() if (count > 0).any() else UNREAD_DIFFERENCE
    return np.where(count > 0, mean, usual) / DIFFERENCE_UNIT


def descriptor_difference(given_x: np.ndarray, given_y: np.ndarray) -> np.ndarray:
    """(a, b) mean squared difference of descriptors in `DIFFERENCE_UNIT`.

    Standard deviations are those over `given_y`.

    Args:
        given_x, given_y: (a, d) and (b, d), column i of one like column i of the other.
    """
    width = given_y.std(0)
    unit = DIFFERENCE_UNIT * np.where(width > 0, width, 1)
    most = MAX_DIFFERENCE / DIFFERENCE_UNIT
    total = np.zeros((len(given_x), len(given_y)))
    # Column by column: there may be hundreds.
    for x, y in zip((given_x / unit).T, (given_y / unit).T, strict=True):
        total += np.minimum(np.abs(x[:, None] - y[None]), most) ** 2
    return total / given_x.shape[1]


def _directions(mesh: Mesh, at, distance, normal) -> np.ndarray:
    """See `PartSamples.direction`."""
    vertices, faces = mesh
    n, place = len(vertices), np.full(len(vertices), -1)
    place[at] = np.arange(len(at))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = face_normals(vertices, faces)
    twice = np.linalg.norm(across, axis=1, keepdims=True)
    unit = across / np.where(twice > 0, twice, 1)
    # Gradient of a linear function, times twice the area: sum of value x turned edge.
    turned = [np.cross(unit, edge) for edge in (c - b, a - c, b - a)]
    rows, cols, values = [], [], []
    for corner in range(3):
        owner = place[faces[:, corner]]
        for source in range(3):
            kept = owner >= 0
            for axis in range(3):
                rows.append(3 * owner[kept] + axis)
                cols.append(faces[kept, source])
                values.append(turned[source][kept, axis])
    shape = 3 * len(at), n
    entries = np.concatenate(rows), np.concatenate(cols)
    gradient = sp.csr_matrix((np.concatenate(values), entries), shape=shape)
    slope = -(gradient @ distance.T).reshape(len(at), 3, len(at))  # i, axis, j
    third = normal[at]
    other = np.where(np.abs(third[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(third, other)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    second = np.cross(third, first)
    towards = np.einsum("iaj,ia->ij", slope, first) + 1j * np.einsum(
        "iaj,ia->ij", slope, second
    )
    # A vertex may be a sample twice, as a landmark too: only the last has faces above.
    towards = towards[place[at]]
    size = np.abs(towards)
    return towards / np.where(size > 0, size, 1)
