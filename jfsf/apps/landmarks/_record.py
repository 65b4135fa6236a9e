"""The record of landmarks, and what all of its readers and writers share."""

import codecs
import re
from typing import NamedTuple

import numpy as np

from jfsf.types import ArrayLike

# Of a name in every format: one line of text that XML can hold.
_NOT_IN_NAMES = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]+")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile("[0-9]{1,18}")
_SYSTEMS = {"lps": "LPS", "1": "LPS", "ras": "RAS", "0": "RAS"}
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


class Landmarks(NamedTuple):
    """Named points of one shape: coordinates, or vertices of its mesh.

    names: a string each; "" for one without a name.
    points: (l, 3) float64 in the coordinates and units of the file; None if the file
        holds vertices.
    vertices: (l,) int64, counted from 0 in the file of the mesh; None if the file holds
        points.
    system: what the file says of its axes: "LPS" (x to the left, y to the back), "RAS"
        (x to the right, y to the front), or None if it says nothing.
    said: what its reader noticed, a sentence each: points that were skipped.
    """

    names: tuple[str, ...]
    points: ArrayLike | None = None
    vertices: ArrayLike | None = None
    system: str | None = None
    said: tuple[str, ...] = ()


def checked(landmarks: Landmarks, function: str) -> Landmarks:
    """Landmarks in numpy arrays.

    Raises:
        ValueError: neither points nor vertices or both, wrong shapes or types, not as
            many as names, points that are not finite, or another system; `function`
            opens the message.
    """
    names, points, vertices, system, said = landmarks
    if (points is None) == (vertices is None):
        raise ValueError(f"{function}: landmarks have points or vertices, one of both")
    if system not in (None, "LPS", "RAS"):
        raise ValueError(f'{function}: system is {system!r}; "LPS", "RAS" or None')
    names, shape = tuple(names), (len(names), 3)
    if strange := [name for name in names if not isinstance(name, str)]:
        raise ValueError(f"{function}: a name is {strange[0]!r}; pass text, or ''")
    if points is not None:
        points = np.asarray(points)
        if points.shape != shape or points.dtype.kind not in "fiu":
            raise ValueError(
                f"{function}: points are {points.dtype} {points.shape} for "
                f"{len(names)} names; pass {shape} real"
            )
        points = points.astype(np.float64)
        if len(lost := np.flatnonzero(~np.isfinite(points).all(1))):
            raise ValueError(
                f"{function}: {titled(names, lost[0])} is at {points[lost[0]]}; leave "
                "out landmarks without a position"
            )
        return Landmarks(names, points, None, system, said)
    vertices = np.asarray(vertices)
    if vertices.shape != shape[:1] or vertices.dtype.kind not in "iu":
        raise ValueError(
            f"{function}: vertices are {vertices.dtype} {vertices.shape} for "
            f"{len(names)} names; pass {shape[:1]} whole numbers"
        )
    return Landmarks(names, None, vertices.astype(np.int64), system, said)


def titled(names: tuple[str, ...], at: int) -> str:
    """A landmark in a message: its name, or its number from 1 on."""
    return f"landmark {names[at]!r}" if names[at] else f"landmark {at + 1}"


def clean_name(name: str) -> str:
    """A name on one line, without control characters and blanks around it."""
    return _NOT_IN_NAMES.sub(" ", name).strip()


def decoded(data: bytes) -> str:
    """Text of a file: UTF-8, UTF-16 with its mark, or else that of old Windows."""
    for mark, codec in _MARKS.items():
        if data.startswith(mark):
            return data.decode(codec, errors="replace")
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """The lines that hold something, and their numbers from 1.

    A tab before the first word stays: the cell before it is empty. Not `splitlines`,
    which also splits at rarer characters that names may hold.
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return [(i, line.strip(" ")) for i, line in enumerate(lines, 1) if line.strip()]


def to_number(cell: str, decimal_comma: bool = False) -> float | None:
    """The number in a cell, which may be infinite; None if it holds another thing."""
    cell = cell.strip()
    if decimal_comma:
        cell = cell.replace(",", ".")
    # float() takes 1_0 for 10.
    return float(cell) if _NUMBER.fullmatch(cell) else None


def to_vertex(cell: str) -> int | None:
    """The vertex in a cell, counted from 0; None if it holds another thing."""
    cell = cell.strip()
    return int(cell) if _WHOLE.fullmatch(cell) else None


def to_system(word: str, path: object) -> str:
    """ "LPS" or "RAS" of a file's own word for its axes.

    Raises:
        ValueError: another system.
    """
    found = _SYSTEMS.get(word.strip().lower())
    if found is None:
        raise ValueError(
            f"{path}: its coordinate system is {word.strip()[:20]!r}; save the "
            "landmarks in LPS or RAS"
        )
    return found


def skipped(names: list[str]) -> tuple[str, ...]:
    """What to say of landmarks without a position."""
    if not names:
        return ()
    words = ", ".join(repr(name) if name else "one without a name" for name in names)
    have = "landmark has" if len(names) == 1 else "landmarks have"
    return (f"{len(names)} {have} no position and were left out: {words}",)


def quoted(name: str) -> str:
    """A name as a cell of a table."""
    if re.search(r'[,;"#\t]', name):
        return '"' + name.replace('"', '""') + '"'
    return name
