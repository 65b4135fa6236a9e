"""Landmark files of other programs: read, written, paired, carried.

They are those of 3D Slicer, MeshLab and ShapeWorks, and tables of text. A file holds
named points of one shape. On a mesh they become vertices or points of the surface. Two
shapes' landmarks are paired by name or by order, and a map carries those of one shape
to another.

Read in this order:

- `_record`: landmarks, and what all readers and writers share
- `_markups`: 3D Slicer's .mrk.json
- `_fcsv`: 3D Slicer's .fcsv
- `_meshlab`: MeshLab's .pp
- `_table`: tables of text, .csv, .tsv and .txt, and ShapeWorks' .particles
- `_read`: read a file of any of these formats
- `_write`: write one
- `_vertex_pairs`: pairs of vertices of two shapes in a file of text
- `_nearest`: the nearest point of a surface
- `_place`: landmarks on a mesh
- `_pair`: which landmarks of two shapes belong together
- `_carry`: landmarks of one shape on another
"""

from jfsf.apps.landmarks._carry import carry_landmarks
from jfsf.apps.landmarks._pair import pair_landmarks
from jfsf.apps.landmarks._place import OnSurface, to_vertices
from jfsf.apps.landmarks._read import read_landmarks
from jfsf.apps.landmarks._record import Landmarks
from jfsf.apps.landmarks._vertex_pairs import read_vertex_pairs
from jfsf.apps.landmarks._write import write_landmarks

__all__ = [
    "Landmarks",
    "OnSurface",
    "carry_landmarks",
    "pair_landmarks",
    "read_landmarks",
    "read_vertex_pairs",
    "to_vertices",
    "write_landmarks",
]
