"""Triangle meshes and point clouds: read, check, edit and measure them, in numpy.

Read in this order:

- `_values`: check the arrays of a mesh
- `_polygons`: split polygons into triangles
- `_geometry`: areas, normals, edges, components, paths along edges
- `_closest`: the point of a surface nearest to each of many points
- `_denoise`: noise, spikes and rounding of coordinates, measured and taken away
- `_check`: report what is wrong with a mesh, or refuse it
- `_faces`: pairs of neighbouring faces, and faces with the same vertices
- `_winding`: wind a mesh outward, and say where that is unclear
- `_edit`: the components of a mesh, its mirror image, seams welded, holes closed
- `_reconstruct`: the oriented surface of a point cloud
- `_partners`: leave out vertices, and keep track of the others
- `_repair`: mend a mesh
- `_decimate`: fewer vertices: some of its own, or a surface like it
- `_formats`: OFF, OBJ, STL, text with a point a line, and arrays of numpy
- `_ply`: PLY
- `_gltf`: glTF and GLB
- `_others`: VTK and GIFTI, through their libraries
- `_read`: read a mesh file of any of these formats
- `_appearance`: its colours, and its texture coordinates
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.mesh._appearance import read_uv, vertex_colours
from jfsf.mesh._check import Report, check, validate
from jfsf.mesh._closest import OnSurface, closest
from jfsf.mesh._decimate import coarsen, decimate
from jfsf.mesh._denoise import denoised, rounding
from jfsf.mesh._edit import largest_component, weld, without_holes
from jfsf.mesh._geometry import surface_area
from jfsf.mesh._partners import Repaired, without_strays
from jfsf.mesh._read import Reading, read, read_noted
from jfsf.mesh._reconstruct import Reconstruction, reconstruct
from jfsf.mesh._repair import repair
from jfsf.mesh._values import MeshError
from jfsf.mesh._winding import orient, unclear_winding

__all__ = [
    "MeshError",
    "OnSurface",
    "Reading",
    "Reconstruction",
    "Repaired",
    "Report",
    "check",
    "closest",
    "coarsen",
    "decimate",
    "denoised",
    "largest_component",
    "orient",
    "read",
    "read_noted",
    "read_uv",
    "reconstruct",
    "repair",
    "rounding",
    "surface_area",
    "unclear_winding",
    "validate",
    "vertex_colours",
    "weld",
    "without_holes",
    "without_strays",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)
