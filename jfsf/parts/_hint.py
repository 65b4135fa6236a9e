"""Whether a pair looks as if one shape were a part of the other."""

import numpy as np

from jfsf.mesh import components, surface_area
from jfsf.parts._shape import boundary_edges
from jfsf.types import Mesh

# In sqrt(area): a neck or an upper arm that was cut through has about 0.35.
LONG_LOOP = 0.3


def looks_partial(mesh_x: Mesh, mesh_y: Mesh) -> bool:
    """Whether one of them has a longer boundary loop than the other, by far.

    Args:
        mesh_x, mesh_y: with faces; a point cloud has no boundary.
    """
    return abs(longest_loop(mesh_x) - longest_loop(mesh_y)) > LONG_LOOP


def longest_loop(mesh: Mesh) -> float:
    """Length of the longest piece of the boundary, in sqrt(area)."""
    ends = boundary_edges(mesh)
    if len(ends) == 0:
        return 0.0
    vertices = np.asarray(mesh.vertices, float)
    piece = components(len(vertices), ends[:, 0], ends[:, 1])[ends[:, 0]]
    length = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    area = surface_area(mesh)
    return float(np.bincount(piece, length).max() / np.sqrt(area)) if area > 0 else 0.0
