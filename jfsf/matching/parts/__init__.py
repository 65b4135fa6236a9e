"""Shapes of which one is a part of the other, or that overlap. Host side.

Read in this order:

- `_settings`: what one may set of the search
- `_surfaces`: cuts and rims, and which shape of a pair looks like a part
- `_samples`: what survives a cut, read at samples
- `_beam`: assignments of a few samples
- `_register`: a coarse copy of the whole, drawn onto the part from a start far off
- `_region`: the whole itself drawn onto the part; which part of it that covers
- `_sides`: both shapes in one unit, coarse copies of them, and how these curve
- `_alignments`: rigid motions that lay one copy on the other
- `_starts`: a copy drawn by each assignment and each motion, ranked
- `_match`: the region that both share, and the maps
"""

from jfsf.matching.parts._settings import PartSettings
from jfsf.matching.parts._surfaces import cut

__all__ = ["PartSettings", "cut"]
