"""Distances, normals and cotangents: what many stages read of a surface.

Read in this order:

- `_geodesics`: distances on a mesh, by the heat method or exact, on the host
- `_normals`: normals of vertices, traced
- `_stretches`: how a deformation stretches each triangle, traced
- `_surface`: edges, cotangents and sums over faces of a mesh at rest, traced

Areas, normals and edges in numpy are in `jfsf.mesh`.
"""

from jfsf.geometry._geodesics import GeodesicSolver, geodesics, pair_distances
from jfsf.geometry._normals import normals

__all__ = ["GeodesicSolver", "geodesics", "normals", "pair_distances"]
