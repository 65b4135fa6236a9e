"""Landmark files of other programs: read, written, paired.

They are those of 3D Slicer, MeshLab, ShapeWorks and morphometrics, and tables of text.
A file holds named points of one shape. On a mesh they become vertices or points of the
surface. Two shapes' landmarks are paired by name or by order. `jfsf.apps.transfer`
carries those of one shape to another.

Read in this order:

- `_record`: landmarks, and what all readers and writers share
- `_programs`: 3D Slicer's .mrk.json and .fcsv, MeshLab's .pp
- `_morphometrics`: .tps and .pts, and the landmarks of many specimens
- `_table`: tables of text, .csv, .tsv and .txt, and ShapeWorks' .particles
- `_files`: read and write a file of any of these formats; read pairs of vertices
- `_place`: landmarks on a mesh
- `_pairs`: which landmarks of two shapes belong together
- `_outlines`: files of curves and patches
- `_paths`: geodesics between points of a mesh
- `_patches`: points spread within a rim
- `_semilandmarks`: points along the curves and over the patches of a template
- `_symmetric`: which landmarks are left and right of each other
"""

from jfsf.apps.landmarks._files import read_landmarks, write_landmarks
from jfsf.apps.landmarks._morphometrics import read_specimens
from jfsf.apps.landmarks._pairs import pair_landmarks
from jfsf.apps.landmarks._place import to_vertices
from jfsf.apps.landmarks._record import Landmarks

__all__ = [
    "Landmarks",
    "pair_landmarks",
    "read_landmarks",
    "read_specimens",
    "to_vertices",
    "write_landmarks",
]
