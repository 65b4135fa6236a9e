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

from jfsf.apps.transfer._atlas import atlas
from jfsf.apps.transfer._files import read_labels, read_values
from jfsf.apps.transfer._labels import labels
from jfsf.apps.transfer._laid import lay
from jfsf.apps.transfer._landmarks import landmarks
from jfsf.apps.transfer._texture import texture
from jfsf.apps.transfer._values import values

__all__ = [
    "atlas",
    "labels",
    "landmarks",
    "lay",
    "read_labels",
    "read_values",
    "texture",
    "values",
]
