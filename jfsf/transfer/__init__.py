"""What one shape has, carried to another along a map: values, labels, textures, points.

`lay` lays X on Y by a map; the others carry from Y to X. `lay_template` does so with a
template that was registered to a scan, and `extended` takes whole files for what was
kept of them.

Read in this order:

- `_laid`: two meshes laid on each other
- `_points`: points of one of them to points of the other
- `_values`: values of vertices
- `_labels`: labels of vertices and faces
- `_landmarks`: landmarks
- `_atlas`: a place in an image for each face
- `_texture`: textures
- `_image`: images in files
- `_files`: values and labels in files
"""

from jfsf.transfer._atlas import Atlas, atlas, check_size
from jfsf.transfer._files import (
    FORMATS,
    Column,
    check_format,
    read_labels,
    read_values,
    write_column,
)
from jfsf.transfer._image import png_of, read_image
from jfsf.transfer._labels import labels
from jfsf.transfer._laid import Laid, extended, lay, lay_template
from jfsf.transfer._landmarks import landmarks
from jfsf.transfer._texture import Baked, look_up, texture
from jfsf.transfer._values import values

__all__ = [
    "FORMATS",
    "Atlas",
    "Baked",
    "Column",
    "Laid",
    "atlas",
    "check_format",
    "check_size",
    "extended",
    "labels",
    "landmarks",
    "lay",
    "lay_template",
    "look_up",
    "png_of",
    "read_image",
    "read_labels",
    "read_values",
    "texture",
    "values",
    "write_column",
]
