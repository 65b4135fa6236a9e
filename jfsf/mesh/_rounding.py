"""Coordinates that were rounded far from the origin: too coarse for their own mesh.

A float32 holds 24 bits: 5.6 million metres from the origin, as in the coordinates of a
country's survey, neighbouring values are 0.5 m apart. Text of six digits is coarser.
The shape is lost in the file, so nothing here mends it.
"""

from typing import NamedTuple

import numpy as np

from jfsf.mesh._geometry import edges
from jfsf.mesh._values import mesh_arrays
from jfsf.types import Mesh

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
