"""Texts and pictures of pages: a template of `page` with its scripts and a record."""

import base64
import json
import os
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.apps.report._words import DOUBTFUL, LIKELY
from jfsf.storage._atomic import write_atomically

# Of each page, in this order; with those of the viewer goes three.js.
_SCRIPTS = {
    "report": ("viewer", "report"),
    "model": ("viewer", "model"),
    "index": ("index",),
    "collection": ("index", "collection"),
}


def page(name: str, record: dict[str, Any]) -> str:
    """The text of a page: its template with the style, scripts and record put in.

    Args:
        name: "report", "model", "index" or "collection": the template NAME.html, and
            its scripts.
        record: plain values, which the script reads.
    """
    folder = files("jfsf.apps.report") / "page"
    # No text ends a script, whatever the names of files.
    form = {"separators": (",", ":"), "allow_nan": False}
    # Letters as they are: `write_text` mends those of names that the locale lacks.
    data = json.dumps(record, ensure_ascii=False, **form)
    parts = {
        "title": record["title"].translate({ord(c): f"&#{ord(c)};" for c in "<>&\"'"}),
        "style": (folder / "style.css").read_text(encoding="utf-8"),
        "record": data.replace("<", "\\u003c"),
        "script": "\n".join(
            (folder / f"{s}.js").read_text(encoding="utf-8") for s in _SCRIPTS[name]
        ),
    }
    if "viewer" in _SCRIPTS[name]:
        licence = (folder / "three.LICENSE.txt").read_text(encoding="utf-8")
        three = (folder / "three.min.js").read_text(encoding="utf-8")
        parts["three"] = f"/*\n{licence}*/\n{three}"
    template = (folder / f"{name}.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda slot: parts[slot[1]], template)


def level(confidence: float) -> str:
    """The colour of a confidence: good, fair, poor or unknown."""
    if np.isnan(confidence):
        return "unknown"
    if confidence >= LIKELY:
        return "good"
    return "fair" if confidence >= DOUBTFUL else "poor"


def thumbnail(found: str, path: str | os.PathLike[str]) -> None:
    """Write a picture that `write_report` returned as a PNG file."""
    data = base64.b64decode(found.partition(",")[2])
    write_atomically(Path(path), lambda file: file.write(data))
