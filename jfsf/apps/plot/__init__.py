"""Pictures of maps and charts of figures, drawn by matplotlib (the extra `viz`).

Shapes stand and face the viewer whatever the axes of their files, as far as their
geometry tells (`Frame`). Read in this order:

- `_colours`: colours of vertices: by place, through a map, of errors, of a texture
- `_cues`: what in the geometry of a body tells its up and its front
- `_upright`: the right, up and front of a shape, and of a pair
- `_page`: the look that all pictures share; PNG files
- `_shading`: shapes as the viewer sees them, turned and lit
- `_layout`: shapes beside each other on one page
- `_pictures`: shapes and maps by colour, by texture and by error
- `_charts`: error curves, convergence, reliability, a functional map as a matrix
"""

from jfsf.apps.plot._charts import (
    draw_convergence,
    draw_error_curves,
    draw_functional_map,
)
from jfsf.apps.plot._colours import coordinate_colours, error_colours, pull_back
from jfsf.apps.plot._pictures import draw_errors, draw_pair, draw_shape, draw_texture

__all__ = [
    "coordinate_colours",
    "draw_convergence",
    "draw_error_curves",
    "draw_errors",
    "draw_functional_map",
    "draw_pair",
    "draw_shape",
    "draw_texture",
    "error_colours",
    "pull_back",
]
