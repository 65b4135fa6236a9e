"""What one shape has, carried to another along a map: values, labels, textures, points.

`overlay` lays X over Y by a map; the others carry from Y to X.

Read in this order:

- `_overlay`: two meshes laid over each other
- `_nearest`: points of one of them to points of the other
- `_carry`: values, labels and landmarks
- `_texture`: textures: a place in an image for each face, and the image
- `_parts`: parts of vertices in JSON
- `_files`: values, labels and images in files
"""

from jfsf.apps.transfer._carry import labels, landmarks, values
from jfsf.apps.transfer._overlay import overlay
from jfsf.apps.transfer._texture import atlas, texture

__all__ = [
    "atlas",
    "labels",
    "landmarks",
    "overlay",
    "texture",
    "values",
]
