"""Distances, normals and cotangents: what many stages read of a surface.

Read in this order:

- `_geodesics`: distances on a mesh, by the heat method or exact, on the host
- `_surface`: normals, stretches, edges, cotangents and sums at corners, traced

Areas, normals and edges in numpy are in `jfsf.mesh`.
"""

from jfsf.geometry._geodesics import GeodesicSolver, geodesics, pair_distances
from jfsf.geometry._surface import normals

__all__ = ["GeodesicSolver", "geodesics", "normals", "pair_distances"]
