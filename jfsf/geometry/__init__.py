"""Distances, normals and cotangents: what many stages read of a surface.

Read in this order:

- `_geodesics`: distances on a mesh, by the heat method or exact, on the host
- `_normals`: normals of vertices, traced
- `_stretches`: how a deformation stretches each triangle, traced
- `_surface`: edges, cotangents and sums over faces of a mesh at rest, traced

Areas, normals and edges in numpy are in `jfsf.mesh`.
"""

from jfsf.geometry._geodesics import (
    GeodesicSolver,
    Progress,
    geodesics,
    pair_distances,
    vertex_indices,
)
from jfsf.geometry._normals import normals
from jfsf.geometry._stretches import log_stretches, root
from jfsf.geometry._surface import (
    STIFFNESS_RANGE,
    Surface,
    corner_sides,
    divergence,
    next_corners,
    opposite_edges,
    sum_at_vertices,
    surface,
)

__all__ = [
    "STIFFNESS_RANGE",
    "GeodesicSolver",
    "Progress",
    "Surface",
    "corner_sides",
    "divergence",
    "geodesics",
    "log_stretches",
    "next_corners",
    "normals",
    "opposite_edges",
    "pair_distances",
    "root",
    "sum_at_vertices",
    "surface",
    "vertex_indices",
]
