"""Shapes of several connected pieces, matched piece to piece.

Read in this order:

- `_split`: the pieces that can be matched, and what is left out
- `_assign`: which pairs are worth a match, and the best assignment
- `_match`: `match_components`, and one map of all pieces
- `_write`: its result as a file
"""

from jfsf.apps.pieces._assign import candidates
from jfsf.apps.pieces._match import MatchedComponents, cost, match_components
from jfsf.apps.pieces._write import write_components

__all__ = [
    "MatchedComponents",
    "candidates",
    "cost",
    "match_components",
    "write_components",
]
