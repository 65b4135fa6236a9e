"""Noise, spikes and rounding: measured on the mesh itself, noise taken from positions.

A clean surface is smooth where noise is not: the height of a vertex above its
neighbours resembles their heights, while that of a noisy one is independent of them.
So noise is told from detail whatever its size. Clean meshes are left as they are.

Coordinates may be rounded too coarsely for their own mesh. A float32 holds 24 bits:
5.6 million metres from the origin, as in the coordinates of a country's survey,
neighbouring values are 0.5 m apart. Text of six digits is coarser. The shape is lost in
the file, so nothing here mends it.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import cg

from jfsf.mesh._geometry import edges, face_areas, vertex_normals
from jfsf.mesh._values import mesh_arrays
from jfsf.types import ArrayLike, Mesh

# Distance from the origin over the size of the shape, below which six digits do.
FAR = 10.0
# A step of this much or more of the distance is no rounding, but how the shape is made,
# of cubes for instance. Text of six digits has 1e-5 at most.
COARSEST = 1.01e-5
# Step over the mean edge length from which on the rounding is worth a word: noise of a
# uniform error of this size is 0.03 of it.
NOTED = 0.1
# Quantile of the gaps between different values that is taken for the step. That of
# values that are not rounded is far smaller than any edge.
QUANTILE = 0.05


class Rounding(NamedTuple):
    """How coarsely the coordinates of a mesh were rounded.

    step: between neighbouring values on the worst axis, in units of the mesh.
    edge: mean length of its edges; of a cloud the longest side of its box over sqrt(n).
    distance: largest coordinate on that axis.
    """

    step: float
    edge: float
    distance: float

    def __str__(self) -> str:
        share = self.step / self.edge
        return (
            f"its coordinates are rounded to {self.step:.2g}, {share:.0%} of the length"
            f" of an edge, because they are up to {self.distance:.3g}; subtract the "
            "centre before the export, or store them as doubles"
        )


def rounding(mesh: Mesh) -> Rounding | None:
    """The rounding of the coordinates, if it harms the shape; None if it does not.

    Args:
        mesh: n finite vertices, m faces whose indices are in range, or a cloud.
    """
    vertices, faces = mesh_arrays(mesh)
    # Halves, and in units of the size below: nothing overflows.
    low, high = vertices.min(0) / 2, vertices.max(0) / 2
    far, size = np.maximum(np.abs(low), np.abs(high)), (high - low).max()
    # Nearly all meshes end here.
    if not far.max() / FAR > size > 0:
        return None
    placed = (vertices / 2 - low) / size
    edge = 1 / np.sqrt(len(vertices))
    if len(faces):
        ends = placed[edges(faces).ends]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        edge = lengths.mean() if lengths.any() else edge
    worst = None
    for axis in np.flatnonzero(far / FAR > size):
        gaps = np.asarray(np.diff(np.unique(placed[:, axis])), np.float64)
        step = float(np.quantile(gaps, QUANTILE)) if len(gaps) > 1 else 0.0
        if NOTED * edge < step < COARSEST * (far[axis] / size):
            if worst is None or 2 * step * size > worst.step:
                found = 2 * step * size, 2 * edge * size, 2 * far[axis]
                worst = Rounding(*map(float, found))
    return worst


# Height of a spike over the size of the ring around it, or over a common edge. Of 470
# clean meshes of people, animals and objects, 7 have a vertex or two between 3 and 8,
# and the map is worse without; all other vertices are below 2.7.
SPIKE = 10.0
SPIKE_ROUNDS = 5  # neighbouring spikes are seen one after the other
# Correlation of heights with those of the neighbours. It is 0.3 to 0.97 on these
# meshes, and below -0.1 with noise of a third of the spacing of vertices.
MIN_CORRELATION = 0.1
# Noise in the spacing of vertices below which it does no harm.
MIN_NOISE = 0.1
# Root mean square by which noisy vertices are moved, over that of the noise: what
# remains of the noise is the rest. More evens out the spacing of vertices, which spoils
# their areas and the map to a clean shape; after less a right map seems doubtful.
MOVED = 0.85
# Averages over neighbours before normals are read.
NORMAL_STEPS = 3
# Bisections of the logarithm of the smoothing, between these bounds.
STEPS, LEAST, MOST = 10, 1e-2, 1e4
TOLERANCE = 1e-3  # relative residual of a linear solve


def denoised(mesh: Mesh) -> Mesh:
    """The mesh without spikes, and smoothed as far as its noise asks for.

    The vertices are moved by as much as the noise that `noise` measures, those of
    spikes between their neighbours.

    Args:
        mesh: n vertices, m faces; indices in range, coordinates finite.

    Returns:
        The same mesh if it has neither, and for a point cloud; else one with other
        vertices and the same faces. Vertices keep their numbers.
    """
    flat = without_spikes(mesh)
    size = noise(flat)
    return flat if size == 0 else Mesh(_smoothed(flat, size), flat.faces)


def spikes(mesh: Mesh) -> Any:
    """Whether each vertex (n,) sticks out far beyond the ring of its neighbours."""
    vertices, faces = mesh_arrays(mesh)
    vertices = vertices.astype(np.float64)
    if len(faces) == 0:
        return np.zeros(len(vertices), bool)
    after = np.roll(faces, -1, 1)
    length = np.linalg.norm(vertices[after] - vertices[faces], axis=2)
    edge = np.median(length)
    # From the median of its neighbours no vertex is further than this, so clean meshes
    # are done here.
    far = np.sqrt(3) * length > SPIKE * edge
    suspect = np.zeros(len(vertices), bool)
    suspect[faces[far]] = suspect[after[far]] = True
    around = faces[suspect[faces].any(1)]
    _, height, ring = _heights(vertices, around)
    return suspect & (height > SPIKE * np.maximum(ring, edge))


def without_spikes(mesh: Mesh) -> Mesh:
    """The mesh with each of its `spikes` moved to the median of its neighbours."""
    vertices, faces = mesh_arrays(mesh)
    for _ in range(SPIKE_ROUNDS):
        at = spikes(Mesh(vertices, faces))
        if not at.any():
            break
        centre = _heights(np.asarray(vertices, np.float64), faces)[0]
        vertices = np.where(at[:, None], centre, vertices)
    return mesh if vertices is mesh.vertices else Mesh(vertices, faces)


def noise(mesh: Mesh) -> float:
    """Deviation of the noise of each coordinate, in units of the mesh.

    Args:
        mesh: as `denoised`.

    Returns:
        0 where heights of neighbouring vertices are alike, as on a clean surface; where
        noise is less than a tenth of the spacing of vertices; and for a point cloud.
    """
    vertices, faces = mesh_arrays(mesh)
    vertices = vertices.astype(np.float64)
    if len(faces) == 0:
        return 0.0
    n = len(vertices)
    average = _average(faces, n)
    smooth = vertices
    for _ in range(NORMAL_STEPS):
        smooth = average @ smooth
    normal = vertex_normals(smooth, faces)
    once = sp.identity(n) - average
    joined = once.diagonal() > 0  # not so a vertex without a face, whose height is 0
    height = ((vertices - average @ vertices) * normal).sum(1)
    # Detail outweighs noise in few vertices, so they are cut off.
    limit = 3 * np.median(np.abs(height[joined]))
    height = np.clip(height, -limit, limit)
    square = (height**2).sum()
    if square == 0 or height @ (average @ height) > MIN_CORRELATION * square:
        return 0.0
    twice = (once @ once).tocsr()
    # Second differences: what is left of a smooth surface is of fourth order.
    factor = np.sqrt(np.asarray(twice.multiply(twice).sum(1)).ravel())
    rough = np.abs(((twice @ vertices) * normal).sum(1))[joined] / factor[joined]
    size = float(np.median(rough)) / 0.6745  # of a normal distribution
    spacing = np.sqrt(face_areas(smooth, faces).sum() / joined.sum())
    return size if size > MIN_NOISE * spacing else 0.0


def _smoothed(mesh: Mesh, size: float) -> Any:
    """Positions with small second differences, at this distance from the old.

    The distance is the discrepancy principle's: as far as noise of `size` has moved
    them. All neighbours count alike, since noise spoils all lengths.
    """
    vertices, faces = mesh_arrays(mesh)
    vertices = vertices.astype(np.float64)
    n = len(vertices)
    average = _average(faces, n)
    degree = sp.diags(_degree(faces, n))
    once = sp.identity(n) - average
    bend = (once.T @ degree @ once).tocsr()
    target = MOVED * size * np.sqrt(3)
    low, high = np.log(LEAST), np.log(MOST)
    positions = vertices
    for _ in range(STEPS):
        middle = (low + high) / 2
        matrix = (degree + np.exp(middle) * bend).tocsr()
        smooth = partial(_solve, matrix, degree)
        positions = smooth(vertices)
        # What is left out is smoothed too, and given back: a long wave is kept better.
        positions = positions + smooth(vertices - positions)
        moved = np.sqrt(((positions - vertices) ** 2).sum(1).mean())
        low, high = (low, middle) if moved > target else (middle, high)
    return positions


def _solve(matrix, degree, values):
    scale = sp.diags(1 / matrix.diagonal())
    solved = [cg(matrix, degree @ c, rtol=TOLERANCE, M=scale)[0] for c in values.T]
    return np.stack(solved, axis=1)


def _degree(faces: ArrayLike, n: int) -> Any:
    """Neighbours of each vertex; 1 for a vertex without any."""
    count = np.bincount(edges(faces).ends.ravel(), minlength=n)
    return np.maximum(count, 1).astype(float)


def _average(faces: ArrayLike, n: int) -> Any:
    """The matrix (n, n) of means over neighbours, which count alike."""
    one, two = edges(faces).ends.T
    pairs = np.concatenate([one, two]), np.concatenate([two, one])
    joined = sp.csr_array((np.ones(2 * len(one)), pairs), (n, n))
    count = np.bincount(pairs[0], minlength=n)
    joined = joined + sp.diags_array((count == 0).astype(float))
    return sp.csr_array(sp.diags_array(1 / np.maximum(count, 1)) @ joined)


def _heights(vertices: ArrayLike, faces: ArrayLike) -> tuple[Any, Any, Any]:
    """The median of each vertex's neighbours, its distance from there, and theirs.

    Medians, so that one neighbour that is a spike does not count.
    """
    one, two = edges(faces).ends.T
    owner, near = np.concatenate([one, two]), np.concatenate([two, one])
    n = len(vertices)
    centre = np.stack([_medians(owner, x[near], n) for x in vertices.T], axis=1)
    away = np.linalg.norm(vertices[near] - centre[owner], axis=1)
    height = np.linalg.norm(vertices - centre, axis=1)
    lonely = np.bincount(owner, minlength=n) == 0
    return centre, np.where(lonely, 0, height), _medians(owner, away, n)


def _medians(owner: ArrayLike, values: ArrayLike, n: int) -> Any:
    """The median (n,) of the values of each owner; 0 where it has none."""
    ordered = values[np.lexsort((values, owner))]
    count = np.bincount(owner, minlength=n)
    first = np.cumsum(count) - count
    low, high = first + (count - 1) // 2, first + count // 2
    padded = np.concatenate([ordered, [0.0]])
    middle = (padded[np.minimum(low, len(ordered))] + padded[high]) / 2
    return np.where(count > 0, middle, 0)
