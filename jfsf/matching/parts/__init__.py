"""Shapes of which one is a part of the other, or that overlap. Host side.

Read in this order:

- `_settings`: the tuned numbers
- `_shape`: what survives a cut, read at samples
- `_hint`: whether a pair looks partial
- `_ball_descriptors`: what a point sees within some distances
- `_curvature`: how the surface curves
- `_beam`: assignments of a few samples
- `_register`: a coarse copy of the whole, drawn onto the part from a start far off
- `_region`: the whole itself drawn onto the part; which part of it that covers
- `_membership`: how clearly a vertex is in that region
- `_sides`: both shapes in one unit, and coarse copies of them
- `_alignments`: rigid motions that lay one copy on the other
- `_starts`: a copy drawn by each assignment and each motion, ranked
- `_match`: the region that both share, and the maps
"""

from jfsf.matching.parts._hint import likely_part
from jfsf.matching.parts._region import cut
from jfsf.matching.parts._settings import PartSettings, RegisterWeights

__all__ = ["PartSettings", "RegisterWeights", "cut", "likely_part"]
