"""Shapes of several connected pieces, matched piece to piece.

Read in this order:

- `_split`: the pieces that can be matched, and what is left out
- `_assign`: which pairs are worth a match, and the best assignment
- `_match`: `match_components`, and one map of all pieces
- `_write`: its result as a file
"""

from jfsf.pieces._assign import (
    TIE,
    Assignment,
    assign,
    candidates,
    places_apart,
)
from jfsf.pieces._match import MatchedComponents, PiecePair, cost, match_components
from jfsf.pieces._split import LeftOut, Piece, Pieces, pieces_of
from jfsf.pieces._write import write_components

__all__ = [
    "TIE",
    "Assignment",
    "LeftOut",
    "MatchedComponents",
    "Piece",
    "PiecePair",
    "Pieces",
    "assign",
    "candidates",
    "cost",
    "match_components",
    "pieces_of",
    "places_apart",
    "write_components",
]
