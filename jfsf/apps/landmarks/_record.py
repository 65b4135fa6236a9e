"""The record of landmarks, and what all of its readers and writers share."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from jfsf.storage._text import find_separator
from jfsf.types import ArrayLike

# What no name holds, in any format: it is one line of text that XML can hold.
_NOT_IN_NAMES = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]+")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile("[0-9]{1,18}")


class Landmarks(NamedTuple):
    """Named points of one shape: coordinates, or vertices of its mesh.

    names: the name of each landmark; "" for one without a name.
    points: (l, 3) float64 positions in the coordinates and units of the file; None if
        the file holds vertices.
    vertices: (l,) int64 vertices of the mesh's file, from 0; None if the file holds
        points.
    system: what the file says of its axes: "LPS" (x to the left, y to the back), "RAS"
        (x to the right, y to the front), or None if it says nothing.
    said: sentences on what the reader noticed, such as points that were skipped.
    """

    names: tuple[str, ...]
    points: ArrayLike | None = None
    vertices: ArrayLike | None = None
    system: str | None = None
    said: tuple[str, ...] = ()


def collected(
    rows: Iterable[tuple[str, Sequence[float] | int | None]],
    path: object,
    system: str | None = None,
) -> Landmarks:
    """The landmarks of a file, but those without a position, which `said` names.

    Args:
        rows: name, and the point or the vertex; None for a landmark without a position.
        path: opens the message.
        system: of the file.

    Raises:
        ValueError: none has a position.
    """
    names, places, without = [], [], []
    for name, place in rows:
        # One line, without control characters and blanks around it.
        name = _NOT_IN_NAMES.sub(" ", name).strip()
        if place is None:
            without.append(repr(name) if name else "one without a name")
        else:
            names.append(name)
            places.append(place)
    if not names:
        raise ValueError(f"{path}: has no landmark with a position; place some")
    said = ()
    if without:
        one = len(without) == 1
        have, were = ("landmark has", "was") if one else ("landmarks have", "were")
        left_out = f"{have} no position and {were} left out: {', '.join(without)}"
        said = (f"{len(without)} {left_out}",)
    points, vertices = np.array(places), None
    if points.ndim == 1:
        points, vertices = None, points.astype(np.int64)
    return Landmarks(tuple(names), points, vertices, system, said)


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


def check_names(landmarks: Landmarks, path: object) -> None:
    """ValueError if a name would not be the same when it is read."""
    for name in landmarks.names:
        if _NOT_IN_NAMES.sub(" ", name).strip() != name:
            raise ValueError(
                f"{path}: the name {name!r} has line ends, control characters or "
                "blanks around it; rename that landmark"
            )


def titled(names: tuple[str, ...], at: int) -> str:
    """A landmark in a message: its name, or its number from 1 on."""
    return f"landmark {names[at]!r}" if names[at] else f"landmark {at + 1}"


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """The lines that hold something, and their numbers from 1.

    A tab before the first word stays: the cell before it is empty. Not `splitlines`,
    which also splits at rarer characters that names may hold.
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return [(i, line.strip(" ")) for i, line in enumerate(lines, 1) if line.strip()]


def is_number(cell: str) -> bool:
    """Whether a cell holds a number; float() would take 1_0 for 10, and nan."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def to_point(cells: Sequence[str]) -> list[float] | None:
    """The point in three cells; None if they are no finite numbers."""
    if len(cells) != 3 or not all(map(is_number, cells)):
        return None
    point = [float(cell) for cell in cells]
    return point if np.isfinite(point).all() else None


def to_vertex(cell: str) -> int | None:
    """The vertex in a cell, counted from 0; None if it holds another thing."""
    cell = cell.strip()
    return int(cell) if _WHOLE.fullmatch(cell) else None


def cells_of(line: str, separator: str, path: object) -> list[str]:
    """The cells of a line of a table.

    Raises:
        ValueError: its quotes do not end, or it is too long; `path` opens the message.
    """
    try:
        (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"{path}: {error}; save it again as .csv") from None
    return cells


def table_rows(
    text: str, path: object, otherwise: str = ","
) -> list[tuple[int, list[str]]]:
    """The number of each line of a table, and its cells without blanks around them.

    Args:
        text: of the table. Tabs, semicolons or commas stand between the cells.
        path: opens the message.
        otherwise: stands between the cells if the first line has none of these.

    Raises:
        ValueError: as `cells_of`.
    """
    lines = numbered_lines(text)
    mark, said = find_separator([line for _, line in lines], "\t;,")
    rows = ((i, cells_of(line, mark or otherwise, path)) for i, line in lines[said:])
    return [(i, [cell.strip() for cell in cells]) for i, cells in rows]


def csv_text(
    titles: Sequence[str], rows: Iterable[Sequence], missing: str = "NA"
) -> str:
    """A table with titles, and what stands for nan: NA, as R reads it."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(titles)
    table.writerows([missing if x != x else x for x in row] for row in rows)
    return text.getvalue()


def titles_of(names: Sequence[str]) -> list[str]:
    """Names of landmarks, and numbers from 1 on for those without."""
    return [name or str(i) for i, name in enumerate(names, 1)]


def quoted(name: str) -> str:
    """A name as a cell of a table."""
    if re.search(r'[,;"#\t]', name):
        return '"' + name.replace('"', '""') + '"'
    return name
