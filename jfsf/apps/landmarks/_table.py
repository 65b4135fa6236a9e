"""Landmarks in a table of text, of spreadsheets and scripts (.csv, .tsv, .txt).

A line holds name, x, y and z; or x, y and z; or a name and a vertex; or a vertex. A
line of titles may say in which columns these are. Between them stand tabs, semicolons,
commas or blanks; where it is no comma, numbers may have a decimal comma. ShapeWorks'
.particles hold x, y and z.
"""

import csv
import re
from typing import NamedTuple

import numpy as np

from jfsf.apps.landmarks._record import (
    Landmarks,
    clean_name,
    numbered_lines,
    quoted,
    skipped,
    to_number,
    to_vertex,
)

EXPECTED = (
    "a line holds name,x,y,z or x,y,z or name,vertex or a vertex counted from 0, and "
    "the first may hold their titles"
)
_COMMENT = re.compile(r"\s*#(?!\d)")  # but #1 is the name of a landmark
_QUOTED = re.compile(r'"(?:[^"]|"")*"')
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?", re.ASCII)
# Titles in small letters, without units in brackets; the first of a list that is there.
_NAMES = [
    "name",
    "label",
    "landmark",
    "landmarks",
    "point",
    "title",
    "id",
    "no",
    "nr",
    "",
]
_AXES = {"xyz": None, "ras": "RAS", "lps": "LPS"}  # Slicer's table has the last two
# As ParaView names the coordinates.
_AXES_OF_PARAVIEW = {
    f"points{mark}{i}": axis for mark in ":_" for i, axis in enumerate("xyz")
}
_VERTICES = ["vertex", "vertices", "vertex_id", "vertex id", "index", "idx", "v"]
_MISSING = {"", "na", "n/a", "nan", "none", "null"}


class _Columns(NamedTuple):
    """Where a row has what: its name, its numbers, its mark for a position; -1: not."""

    name: int
    numbers: list[int]
    defined: int = -1
    system: str | None = None


def read_table(text: str, path: object) -> Landmarks:
    """The landmarks of a table, but those without a position. # begins a comment line.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: a line of another form, or no landmark.
    """
    lines = [row for row in numbered_lines(text) if not _COMMENT.match(row[1])]
    if not lines:
        raise ValueError(f"{path}: holds no landmark; {EXPECTED}")
    separator = _separator(lines[0][1])
    rows = [_cells(line, separator, f"{path}: line {n}") for n, line in lines]
    columns = _titles(rows[0])
    if columns is not None:
        rows, lines = rows[1:], lines[1:]
    elif separator == " ":
        rows = [_joined(cells) for cells in rows]
    names, values, without = [], [], []
    for (number, line), cells in zip(lines, rows, strict=True):
        at = columns or _by_width(cells, rows[0])
        if at is None or max(at.numbers) >= len(cells):
            raise ValueError(f"{path}: line {number} is {line[:60]!r}; {EXPECTED}")
        has_name = 0 <= at.name < len(cells)
        name = clean_name(cells[at.name]) if has_name else ""
        found = [cells[i].strip() for i in at.numbers]
        undefined = 0 <= at.defined < len(cells) and cells[at.defined].strip() == "0"
        if undefined or all(cell.lower() in _MISSING for cell in found):
            without.append(name)
            continue
        if len(found) == 1:
            value = [to_vertex(found[0])]
        else:
            value = [to_number(cell, separator != ",") for cell in found]
        if None in value or not np.isfinite(value).all():  # type: ignore
            raise ValueError(f"{path}: line {number} is {line[:60]!r}; {EXPECTED}")
        names.append(name)
        values.append(value)
    if not names:
        raise ValueError(f"{path}: has no landmark with a position; {EXPECTED}")
    said = skipped(without)
    if len(values[0]) == 1:
        return Landmarks(
            tuple(names), None, np.array(values, np.int64)[:, 0], said=said
        )
    system = None if columns is None else columns.system
    return Landmarks(tuple(names), np.array(values, np.float64), None, system, said)


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


def _separator(line: str) -> str:
    line = _QUOTED.sub('""', line)
    for separator in "\t;":
        if separator in line:
            return separator
    words = line.split()
    # As in: nose 1,5 2 3,5
    commas_in_numbers = len(words) > 2 and all(
        map(_DECIMAL_COMMA.fullmatch, words[-3:])
    )
    return "," if "," in line and not commas_in_numbers else " "


def _cells(line: str, separator: str, where: str) -> list[str]:
    try:
        (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"{where}: {error}; {EXPECTED}") from None
    return cells


def _titles(cells: list[str]) -> _Columns | None:
    """The columns, if the cells are titles."""
    if any(to_number(cell, True) is not None for cell in cells):
        return None
    titles = [re.sub(r"[\[(].*", "", cell).strip().lower() for cell in cells]
    titles = [_AXES_OF_PARAVIEW.get(title, title) for title in titles]
    place = lambda known: next((titles.index(t) for t in known if t in titles), -1)
    name, defined = place(_NAMES), place(["defined"])
    for axes, system in _AXES.items():
        if set(axes) <= set(titles):
            return _Columns(name, [titles.index(a) for a in axes], defined, system)
    vertex = place(_VERTICES)
    return None if vertex < 0 else _Columns(name, [vertex], defined)


def _joined(cells: list[str]) -> list[str]:
    """A name of several words as one cell."""
    if len(cells) > 4 and any(to_number(cell, True) is None for cell in cells[:-3]):
        return [" ".join(cells[:-3]), *cells[-3:]]
    return cells


def _by_width(cells: list[str], first: list[str]) -> _Columns | None:
    """The columns without titles: as the first row has them."""
    width = len(first) - (len(first) > 1 and not first[-1].strip())
    # A separator may end a line.
    if len(cells) < width or any(cell.strip() for cell in cells[width:]):
        return None
    numbers = [to_number(cell, True) is not None for cell in first]
    if width == 4 and numbers[:4] == [True, True, True, False]:
        return _Columns(3, [0, 1, 2])
    by_width = {
        1: _Columns(-1, [0]),
        2: _Columns(0, [1]),
        3: _Columns(-1, [0, 1, 2]),
        4: _Columns(0, [1, 2, 3]),
    }
    return by_width.get(width)
