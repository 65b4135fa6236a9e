"""Shapes of which one is a part of the other, or that overlap. Host side.

Read in this order:

- `_shape`: what survives a cut, read at samples
- `_hint`: whether a pair looks partial
- `_looks`: what a point sees within some distances
- `_beam`: assignments of a few samples
- `_region`: bend one shape onto the other; which part of it that covers
- `_evidence`: how well it fits
- `_match`: the region that both share, and the maps
"""

from jfsf.parts._hint import longest_loop, looks_partial
from jfsf.parts._match import Parts, match_parts
from jfsf.parts._region import cut
from jfsf.parts._shape import boundary_edges, boundary_vertices, vertex_normals

__all__ = [
    "Parts",
    "boundary_edges",
    "boundary_vertices",
    "cut",
    "longest_loop",
    "looks_partial",
    "match_parts",
    "vertex_normals",
]
