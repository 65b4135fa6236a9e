"""Pages to look at a match in a browser, without a network (the extra `viz`).

A page shows both shapes by three.js, whose parts it uses are bundled in `page`: turned
together, coloured or checkered through the map, with the image of each point clicked;
and says how sure the map is, why, and what to try. Read in this order:

- `_words`: a certificate in words: how sure, why, and what to try
- `_html`: texts and pictures of pages
- `_candidates`: the candidates of the search as maps of points
- `_measured`: figures of a map, and a number for each vertex
- `_scene`: what the viewer shows, as plain values
- `_page`: a match as one page
- `_index`: many matches as one page, linked to theirs
- `_model`: a shape model as one page, with sliders
- `_graph`: where the shapes of a graph of pairs are drawn
- `_collection`: a collection as one page: its shapes, its pairs, its triangles
"""

from jfsf.report._candidates import Considered, considered
from jfsf.report._collection import (
    ShapeRow,
    shape_picture,
    write_collection_page,
)
from jfsf.report._html import thumbnail
from jfsf.report._index import Row, write_index
from jfsf.report._measured import Measured, measure
from jfsf.report._model import write_model_page
from jfsf.report._page import Side, versions, write_report
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
    "ShapeRow",
    "Side",
    "attempts",
    "considered",
    "findings",
    "measure",
    "readings",
    "reasons",
    "shape_picture",
    "thumbnail",
    "verdict",
    "versions",
    "warnings_of",
    "write_collection_page",
    "write_index",
    "write_model_page",
    "write_report",
]
