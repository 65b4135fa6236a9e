"""Meshes in the colours of a map, as files for other programs: PLY, OBJ and GLB.

X gets the colours of Y through the map: those of Y's file, or colours by place, as it
stands in its file. Where the map is right, corresponding parts have equal colours in
MeshLab, Blender and the like. A checker that is laid on Y and carried to X shows where
the map stretches. Vertices and faces keep their numbers.

Read in this order:

- `_formats`: what a file has beside the shape, checked; PLY, OBJ and GLB
- `_export`: write a mesh, a map or an image on a mesh, in the format of the suffix
"""

from jfsf.apps.export._export import export_map, export_mesh, export_textured

__all__ = ["export_map", "export_mesh", "export_textured"]
