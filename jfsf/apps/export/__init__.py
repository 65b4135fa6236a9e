"""Meshes in the colours of a map, as files for other programs: PLY, OBJ and GLB.

X gets the colours of Y through the map: those of Y's file, or colours that are laid on
it as `jfsf.apps.plot.find_frame` sees it. Where the map is right, corresponding parts
have equal colours in MeshLab, Blender and the like. A checker that is laid on Y and
carried to X shows where the map stretches. Vertices and faces keep their numbers.

Read in this order:

- `_paint`: what a file has beside the shape: colours, texture coordinates, confidence
- `_texture`: the checker, as a PNG
- `_ply`: PLY
- `_obj`: OBJ
- `_glb`: GLB, binary glTF
- `_export`: write a mesh, or a map, in the format of the suffix
- `_textured`: write a mesh with an image on it
"""

from jfsf.apps.export._export import export_map, export_mesh
from jfsf.apps.export._textured import export_textured

__all__ = ["export_map", "export_mesh", "export_textured"]
