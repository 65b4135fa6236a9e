"""Which shape of a pair looks like a part of the other."""

from typing import Literal

import numpy as np

from jfsf.mesh import surface_area
from jfsf.mesh._geometry import boundary_edges, components
from jfsf.types import Mesh

# In sqrt(area): a neck or an upper arm that was cut through has about 0.35.
LONG_LOOP = 0.3


def likely_part(mesh_x: Mesh, mesh_y: Mesh) -> Literal["x", "y"] | None:
    """The shape whose longest boundary loop is longer than the other's, by far.

    Args:
        mesh_x, mesh_y: a point cloud has no boundary.
    """
    more = longest_loop(mesh_x) - longest_loop(mesh_y)
    if abs(more) <= LONG_LOOP:
        return None
    return "x" if more > 0 else "y"


def longest_loop(mesh: Mesh) -> float:
    """Length of the longest piece of the boundary, in sqrt(area)."""
    ends = boundary_edges(mesh.faces)
    if len(ends) == 0:
        return 0.0
    vertices = np.asarray(mesh.vertices, float)
    piece = components(len(vertices), ends[:, 0], ends[:, 1])[ends[:, 0]]
    length = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    area = surface_area(mesh)
    return float(np.bincount(piece, length).max() / np.sqrt(area)) if area > 0 else 0.0
