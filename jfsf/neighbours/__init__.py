"""The k0 nearest neighbours between two point sets, exhaustively or among candidates.

Read in this order:

- `_settings`: the tuned numbers of the searches
- `_search`: how neighbours are searched, as one value: what converters are handed
- `_exhaustive`: all points compared, one direction
- `_mutual`: all points compared, both directions from one product
- `_tiles`: compact groups of points, made once for each shape
- `_among_tiles`: candidates from nearby tiles, at a cost that grows like n
- `_both_ways`: among tiles when they are given, exhaustively otherwise

In `match`, `jfsf.matching.pair_search` decides whether there are tiles. Where their
recall is below `NeighbourSearch.min_recall`, `tiled_one_way` compares all points. That
is 0 in rounds of a refinement, which therefore never do.
"""

from jfsf.neighbours._exhaustive import neighbours
from jfsf.neighbours._mutual import mutual_neighbours
from jfsf.neighbours._search import NeighbourSearch
from jfsf.neighbours._settings import NeighbourSettings
from jfsf.neighbours._tiles import spectral_tiles

__all__ = [
    "NeighbourSearch",
    "NeighbourSettings",
    "mutual_neighbours",
    "neighbours",
    "spectral_tiles",
]
