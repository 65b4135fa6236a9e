"""Parts of a mesh in JSON, {name: vertices}, as SMPL's smpl_vert_segmentation.json.

A vertex in several parts has the first of them, one in none the name "".
"""

import json
from pathlib import Path

import numpy as np

from jfsf.storage._text import read_text
from jfsf.types import ArrayLike

_EXPECTED = "expected a list of vertices, counted from 0, for the name of each part"
_NO_PART = "", -1  # where there is no surface to take a label from


def read_parts(path: Path, n: int) -> np.ndarray:
    """The part of each of the n vertices of a mesh, (n,) str; "" for none.

    Raises:
        ValueError: no JSON of this form, or vertices that the mesh does not have.
        OSError: the file cannot be read.
    """
    try:
        parts = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: is no JSON ({error}); export it again") from None
    if not isinstance(parts, dict) or not parts:
        raise ValueError(f"{path}: {_EXPECTED}")
    labels = np.zeros(n, f"U{max(1, *map(len, parts))}")
    for name, vertices in parts.items():
        known = isinstance(vertices, list) and all(type(v) is int for v in vertices)
        if not known:
            raise ValueError(f"{path}: part {name!r} is no list; {_EXPECTED}")
        at = np.array(vertices, np.int64)
        if (wrong := (at < 0) | (at >= n)).any():
            raise ValueError(
                f"{path}: part {name!r} has vertex {at[wrong][0]}, and the mesh has "
                f"{n}, from 0 on; give the file of this mesh"
            )
        labels[at[labels[at] == ""]] = name
    return labels


def parts_text(labels: ArrayLike) -> str:
    """What `read_parts` reads, of labels (n,) of vertices, "" and -1 left out."""
    parts = {
        str(name): np.flatnonzero(labels == name).tolist()
        for name in np.unique(labels)
        if name not in _NO_PART
    }
    return json.dumps(parts, ensure_ascii=False) + "\n"
