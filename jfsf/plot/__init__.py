"""Pictures of maps by colour transfer, drawn by matplotlib (the extra `viz`).

Read in this order:

- `_colours`: colours of vertices: by coordinates, through a map, of errors
- `_pictures`: pairs and maps, drawn and written as PNG
"""

from jfsf.plot._colours import Up, coordinate_colours, pull_back
from jfsf.plot._pictures import draw_maps, draw_pair

__all__ = ["Up", "coordinate_colours", "draw_maps", "draw_pair", "pull_back"]
