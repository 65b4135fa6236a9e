"""Shapes of several connected pieces, matched piece to piece.

Read in this order:

- `_pieces`: the pieces that can be matched, and the best assignment of two shapes'
- `_match`: `match_components`, one map of all pieces, and its file
"""

from jfsf.apps.pieces._match import MatchedComponents, match_components

__all__ = ["MatchedComponents", "match_components"]
