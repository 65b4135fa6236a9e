"""Landmarks in a table of text, of spreadsheets and scripts (.csv, .tsv, .txt).

A line holds name, x, y and z; or x, y and z; or a name and a vertex; or a vertex. A
line of titles may say in which columns these are. Between them stand tabs, semicolons,
commas or blanks. ShapeWorks' .particles hold x, y and z.
"""

import csv
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from jfsf.apps.landmarks._record import (
    Landmarks,
    collected,
    is_number,
    numbered_lines,
    quoted,
    to_point,
    to_vertex,
)
from jfsf.storage._text import find_separator, plain_numbers

EXPECTED = (
    "a line holds name,x,y,z or x,y,z or name,vertex or a vertex counted from 0, and "
    "the first may hold their titles"
)
_COMMENT = re.compile(r"\s*#(?!\d)")  # but #1 is the name of a landmark
# Titles in small letters, without units in brackets; the first of a list that is there.
_NAMES = ["name", "label", "landmark", "id", ""]
_VERTICES = ["vertex", "index"]
_AXES = {"xyz": None, "ras": "RAS", "lps": "LPS"}  # Slicer's table has the last two
_MISSING = {"", "na", "nan", "-nan"}


class _Columns(NamedTuple):
    """Which columns of a table hold what.

    name: the column of the name; -1 if there is none.
    numbers: those of x, y and z, or of the vertex.
    defined: that of Slicer's mark for a position; -1 if there is none.
    system: "LPS" or "RAS", if the titles say so.
    """

    name: int
    numbers: list[int]
    defined: int = -1
    system: str | None = None


# Without titles, by the number of cells in the first line.
_BY_WIDTH = {
    1: _Columns(-1, [0]),
    2: _Columns(0, [1]),
    3: _Columns(-1, [0, 1, 2]),
    4: _Columns(0, [1, 2, 3]),
}


def read_table(text: str, path: object) -> Landmarks:
    """The landmarks of a table, but those without a position. # begins a comment line.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: a line of another form, or no landmark.
    """
    lines = [row for row in numbered_lines(text) if not _COMMENT.match(row[1])]
    separator, said = find_separator([line for _, line in lines], "\t;,")
    separator, lines = separator or " ", lines[said:]
    if not lines:
        raise ValueError(f"{path}: holds no landmark; {EXPECTED}")
    rows = [_cells(line, separator, f"{path}: line {n}") for n, line in lines]
    if (columns := _titles(rows[0])) is not None:
        lines, rows = lines[1:], rows[1:]
    else:
        # A separator may end a line.
        blank = len(rows[0]) > 1 and not rows[0][-1].strip()
        columns = _BY_WIDTH.get(len(rows[0]) - blank)
        width = 0 if columns is None else max(columns.numbers) + 1
        rows = [[] if any(map(str.strip, row[width:])) else row for row in rows]
    system = columns.system if columns else None
    return collected(_rows(lines, rows, columns, path), path, system)


def _rows(lines, rows, columns: _Columns | None, path) -> Iterator[tuple[str, Any]]:
    for (number, line), cells in zip(lines, rows, strict=True):
        wrong = ValueError(f"{path}: line {number} is {line[:60]!r}; {EXPECTED}")
        if columns is None or max(columns.numbers) >= len(cells):
            raise wrong
        cell = lambda at, cells=cells: cells[at] if 0 <= at < len(cells) else ""
        numbers = [cells[at] for at in columns.numbers]
        missing = all(map(_is_missing, numbers))
        if missing or cell(columns.defined).strip() == "0":
            yield cell(columns.name), None
            continue
        place = to_vertex(numbers[0]) if len(numbers) == 1 else to_point(numbers)
        if place is None:
            raise wrong
        yield cell(columns.name), place


def table_text(landmarks: Landmarks, separator: str) -> str:
    """What `read_table` reads: titles, then a line each. In LPS and RAS they say so.

    Args:
        landmarks: with points or vertices.
        separator: a comma or a tab.
    """
    if landmarks.points is None:
        titles = ["vertex"]
        rows = [[v] for v in np.asarray(landmarks.vertices).tolist()]
    else:
        titles = list((landmarks.system or "xyz").lower())
        rows = np.asarray(landmarks.points).tolist()
    lines = [separator.join(["label" if landmarks.system else "name", *titles])]
    for name, row in zip(landmarks.names, rows, strict=True):
        lines.append(separator.join([quoted(name), *map(repr, row)]))
    return "\n".join([*lines, ""])


def particles_text(landmarks: Landmarks) -> str:
    """Points as ShapeWorks reads them: x, y and z a line, without names.

    Args:
        landmarks: with points.
    """
    points = np.asarray(landmarks.points).tolist()
    return "".join(" ".join(map(repr, point)) + "\n" for point in points)


def _cells(line: str, separator: str, where: str) -> list[str]:
    try:
        (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"{where}: {error}; {EXPECTED}") from None
    if separator == " " and len(cells) > 4:  # a name of several words
        return [" ".join(cells[:-3]), *cells[-3:]]
    return cells


def _is_missing(cell: str) -> bool:
    return plain_numbers(cell).strip().lower() in _MISSING


def _titles(cells: list[str]) -> _Columns | None:
    """The columns, if the cells are titles."""
    if any(map(is_number, cells)):
        return None
    titles = [re.sub(r"[\[(].*", "", cell).strip().lower() for cell in cells]
    place = lambda words: next((titles.index(t) for t in words if t in titles), -1)
    name, defined = place(_NAMES), place(["defined"])
    for axes, system in _AXES.items():
        if set(axes) <= set(titles):
            return _Columns(name, [titles.index(a) for a in axes], defined, system)
    vertex = place(_VERTICES)
    return None if vertex < 0 else _Columns(name, [vertex], defined)
