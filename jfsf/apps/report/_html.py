"""Texts and pictures of pages: one frame, with a body, scripts and a record.

A page needs no network. Its body, `page/NAME.html`, has empty places that the scripts
fill from the record.
"""

import base64
import io
import json
import os
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.apps.plot._page import picture_of
from jfsf.storage._atomic import write_atomically
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
