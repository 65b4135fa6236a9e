"""Texts and pictures of pages: one frame, with a body, scripts and a record.

A page needs no network. Its body, `page/NAME.html`, has empty places that the scripts
fill from the record.

The list of many matches is one: a row a pair, linked to the page of the pair.
"""

import base64
import io
import json
import os
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from jfsf.apps.plot._panels import picture_of
from jfsf.apps.report._words import level, verdict
from jfsf.storage._atomic import write_atomically, write_text
from jfsf.types import ArrayLike

# Of each page, in this order; before those of the viewer goes three.js.
_SCRIPTS = {
    "report": ("viewer", "report"),
    "model": ("viewer", "model"),
    "index": ("index",),
    "collection": ("index", "collection"),
}
# Pages with a viewer load nothing; lists show pictures from files beside them.
_POLICY = (
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
    "img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'\">"
)


def page(name: str, record: dict[str, Any]) -> str:
    """The text of a page.

    Args:
        name: "report", "model", "index" or "collection".
        record: plain values, which the scripts read; its title is the page's.
    """
    folder = files("jfsf.apps.report") / "page"
    read = lambda file: (folder / file).read_text(encoding="utf-8")
    # Letters as they are: `write_text` mends those of names that the locale lacks.
    form = {"separators": (",", ":"), "allow_nan": False, "ensure_ascii": False}
    scripts = [read(f"{script}.js") for script in _SCRIPTS[name]]
    viewer = "viewer" in _SCRIPTS[name]
    if viewer:
        licence = f"/*\n{read('three.LICENSE.txt')}*/\n"
        scripts.insert(0, licence + read("three.min.js"))
    parts = {
        "title": record["title"].translate({ord(c): f"&#{ord(c)};" for c in "<>&\"'"}),
        "policy": _POLICY if viewer else "",
        "style": read("style.css"),
        "body": read(f"{name}.html"),
        # No text ends a script, whatever the names of files.
        "record": json.dumps(record, **form).replace("<", "\\u003c"),
        "scripts": "\n".join(f"<script>\n{text}\n</script>" for text in scripts),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda slot: parts[slot[1]], read("page.html"))


def data_url(figure: Any, dpi: float) -> str:
    """A figure of `jfsf.apps.plot` as the address of an image that needs no file."""
    from matplotlib.image import imsave

    imsave(file := io.BytesIO(), picture_of(figure, dpi), format="png")
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def thumbnail(address: str, path: str | os.PathLike[str]) -> None:
    """Write a picture of `data_url` as a PNG file."""
    data = base64.b64decode(address.partition(",")[2])
    write_atomically(Path(path), lambda file: file.write(data))


def packed(array: ArrayLike, dtype: str) -> str:
    """An array in whole numbers of this type, little endian, in base64."""
    array = np.rint(np.asarray(array)).astype(dtype)
    return base64.b64encode(array.tobytes()).decode()


class Row(NamedTuple):
    """A pair, or a shape of a collection, in a list.

    name: of the pair or the shape.
    page: path of its own page relative to the list, with "/"; None if there is none.
    picture: path of its picture relative to the list; None if there is none.
    confidence: of its certificate; nan if it is not known.
    lines: what to say of it, such as its warnings.
    failed: there is no match; the lines say why.
    """

    name: str
    page: str | None
    picture: str | None
    confidence: float
    lines: Sequence[str]
    failed: bool = False


def write_index(
    path: str | os.PathLike[str],
    rows: Sequence[Row],
) -> None:
    """Write a page with a row for each pair, failed and least confident ones first.

    Args:
        path: the page, written completely or not at all.
        rows: the pairs, in any order.
    """
    failed = sum(row.failed for row in rows)
    counts = f"{len(rows)} pairs, {len(rows) - failed} matched"
    if failed:
        counts += f", {failed} failed"
    record = {"title": "Pairs by confidence", "counts": counts, "rows": listed(rows)}
    write_text(path, page("index", record))


def listed(rows: Sequence[Row], failed: str = "failed") -> list[dict[str, Any]]:
    """Rows as plain values for JSON, in the order in which to look at them.

    Failed ones come first, then the least confident, at last those without confidence.

    Args:
        rows: in any order.
        failed: what to call those that failed.
    """

    def place(row: Row):
        unknown = row.confidence != row.confidence
        return not row.failed, unknown, 0 if unknown else row.confidence

    def verdict_of(row: Row) -> str:
        if row.failed or row.confidence != row.confidence:
            return failed if row.failed else "unknown"
        return f"{verdict(row.confidence)}, {row.confidence:.0%}"

    return [
        {
            "name": row.name,
            "page": _address(row.page),
            "picture": _address(row.picture),
            "lines": list(row.lines),
            "verdict": verdict_of(row),
            "level": "failed" if row.failed else level(row.confidence),
        }
        for row in sorted(rows, key=place)
    ]


def _address(path: str | None) -> str | None:
    """A path as an address, where #, ? and % mean something else."""
    return path and quote(path, errors="surrogateescape")
