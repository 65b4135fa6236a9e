"""Triangle meshes and point clouds: read, check, edit and measure them, in numpy.

Read in this order:

- `_values`: check the arrays of a mesh
- `_polygons`: split polygons into triangles
- `_geometry`: areas, normals, edges, components
- `_closest`: the point of a surface nearest to each of many points
- `_paths`: shortest paths along edges
- `_rounding`: coordinates rounded far from the origin
- `_check`: report what is wrong with a mesh, or refuse it
- `_denoise`: noise and spikes, measured and taken away
- `_doubled`: faces with the same vertices as others, and which to keep
- `_links`: pairs of neighbouring faces
- `_winding`: wind a mesh outward, and say where that is unclear
- `_edit`: the components of a mesh, its mirror image, its seams welded
- `_holes`: close small holes
- `_reconstruct`: the oriented surface of a point cloud
- `_partners`: leave out vertices, and keep track of the others
- `_repair`: mend a mesh
- `_coarsen`: keep some of its vertices, for display
- `_decimate`: fewer vertices, a surface like it
- `_formats`: OFF, OBJ and STL
- `_ply`: PLY
- `_gltf`: glTF and GLB
- `_points`: text with a point a line, and arrays of numpy
- `_others`: VTK and GIFTI, through their libraries
- `_read`: read a mesh file of any of these formats
- `_colours`: the colours of its vertices
- `_uv`: the texture coordinates of a file
"""

from jfsf.mesh._check import Report, check, validate
from jfsf.mesh._closest import OnSurface, closest
from jfsf.mesh._coarsen import coarsen
from jfsf.mesh._colours import vertex_colours
from jfsf.mesh._decimate import decimate
from jfsf.mesh._denoise import denoised
from jfsf.mesh._edit import largest_component, mirror_image, weld
from jfsf.mesh._geometry import face_normals, surface_area, vertex_areas, vertex_normals
from jfsf.mesh._holes import without_holes
from jfsf.mesh._partners import Repaired, without_strays
from jfsf.mesh._paths import farthest_vertices
from jfsf.mesh._read import Reading, read, read_noted
from jfsf.mesh._reconstruct import Reconstruction, reconstruct
from jfsf.mesh._repair import repair
from jfsf.mesh._rounding import rounding
from jfsf.mesh._uv import read_uv
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
    "face_normals",
    "farthest_vertices",
    "largest_component",
    "mirror_image",
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
    "vertex_areas",
    "vertex_colours",
    "vertex_normals",
    "weld",
    "without_holes",
    "without_strays",
]
