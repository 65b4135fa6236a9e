"""Pages to look at a match in a browser, without a network (the extra `viz`).

A page shows both shapes by three.js, whose parts it uses are bundled in `page`: turned
together, coloured or checkered through the map, with the image of each point clicked;
and says how sure the map is, why, and what to try. Read in this order:

- `_words`: a certificate in words: how sure, why, and what to try
- `_candidates`: the candidates of the search as maps of points
- `_measured`: figures of a map, and a number for each vertex
- `_scene`: what the viewer shows, as plain values
- `_page`: a match as one page
- `_index`: many matches as one page, linked to theirs
"""

from jfsf.report._candidates import Considered, considered
from jfsf.report._index import Row, write_index
from jfsf.report._measured import Measured, measure
from jfsf.report._page import Side, thumbnail, versions, write_report
from jfsf.report._words import (
    LIKELY,
    Finding,
    attempts,
    findings,
    readings,
    reasons,
    verdict,
    warnings_of,
)

__all__ = [
    "LIKELY",
    "Considered",
    "Finding",
    "Measured",
    "Row",
    "Side",
    "attempts",
    "considered",
    "findings",
    "measure",
    "readings",
    "reasons",
    "thumbnail",
    "verdict",
    "versions",
    "warnings_of",
    "write_index",
    "write_report",
]
