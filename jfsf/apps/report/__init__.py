"""Pages to look at a match in a browser, without a network (the extra `viz`).

A page shows both shapes by three.js, whose parts it uses are bundled in `page`: turned
together, coloured or checkered through the map, with the image of each point clicked;
and says how sure the map is, why, and what to try. Read in this order:

- `_words`: a certificate in words: how sure, why, and what to try
- `_html`: texts and pictures of pages; many matches as a list, linked to their pages
- `_candidates`: the candidates of the search as maps of points
- `_measured`: figures of a map, and a number for each vertex
- `_scene`: what the viewer shows, as plain values
- `_page`: a match as one page
- `_model`: a shape model as one page, with sliders
- `_collection`: a collection as one page: its shapes, its pairs, its triangles
"""

from jfsf.apps.report._model import write_model_page
from jfsf.apps.report._page import Side, write_report
from jfsf.apps.report._words import findings, reasons

__all__ = [
    "Side",
    "findings",
    "reasons",
    "write_model_page",
    "write_report",
]
