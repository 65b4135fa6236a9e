"""The k0 nearest neighbours between two point sets, exhaustively or among candidates.

Read in this order:

- `_search`: how neighbours are searched: what converters are handed
- `_exhaustive`: all points compared, one direction
- `_tiles`: compact groups of points, made once for each shape
- `_among_tiles`: candidates from nearby tiles, at a cost that grows like n
- `_both_ways`: both directions, among tiles or from one product of all points

In `match`, `pair_search` decides whether there are tiles. Where their
recall is below `NeighbourSearch.min_recall`, `tiled_one_way` compares all points. That
is 0 in rounds of a refinement, which therefore never do.
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.neighbours._exhaustive import neighbours
from jfsf.neighbours._search import NeighbourSearch, NeighbourSettings
from jfsf.neighbours._tiles import spectral_tiles

__all__ = [
    "NeighbourSearch",
    "NeighbourSettings",
    "neighbours",
    "spectral_tiles",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)
