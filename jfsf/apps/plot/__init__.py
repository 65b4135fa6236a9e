"""Pictures of maps and charts of figures, drawn by matplotlib (the extra `viz`).

X stands as its file says (y is up unless `up` names another axis), and Y is turned onto
it by the rotation that fits the map best. Read in this order:

- `_frames`: the axes in which a shape is seen, and both shapes of a pair
- `_colours`: colours of vertices: by place, through a map, of errors
- `_panels`: the look that all pictures share; shapes turned and lit, beside each other
- `_pictures`: shapes and maps by colour and by error
- `_charts`: curves, errors, a functional map as a matrix
"""

from jfsf.apps.plot._colours import coordinate_colours, pull_back
from jfsf.apps.plot._pictures import draw_pair, draw_shape

__all__ = [
    "coordinate_colours",
    "draw_pair",
    "draw_shape",
    "pull_back",
]
