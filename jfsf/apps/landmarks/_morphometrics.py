"""Landmarks of geometric morphometrics: .tps and .pts, and tables of many specimens.

- `.tps` (Rohlf; tpsDig, geomorph): `LM3=` and a number, so many lines of x, y and z,
  then `ID=`, `IMAGE=`, `SCALE=` and others. Coordinates are multiplied by the scale, as
  `geomorph::readland.tps` does, which has NA for a missing one. There are no names of
  landmarks.
- `.pts` (IDAV Landmark, Stratovan Checkpoint; `Morpho::read.pts`): `Version 1.0`, a
  number, and so many lines of a name, x, y and z; 9999 is a missing one.
"""

import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.apps.landmarks._record import (
    Landmarks,
    collected,
    csv_text,
    is_number,
    numbered_lines,
    table_rows,
    titles_of,
    to_point,
)
from jfsf.storage._text import read_text
from jfsf.types import ArrayLike

TABLES = ".csv", ".tsv", ".txt"
_MISSING = "NA"
_NO_POINT = 9999.0  # of .pts


class Specimens(NamedTuple):
    """Landmarks of many specimens, the same of each.

    specimens: their names, none twice.
    landmarks: names of the landmarks; "" for one without a name.
    points: in the unit of the file; nan where a specimen lacks a landmark.
    """

    specimens: tuple[str, ...]
    landmarks: tuple[str, ...]
    points: Float[np.ndarray, "s l 3"]


class _Block(NamedTuple):
    """A specimen of a .tps: its points, None for a missing one, and its keys."""

    points: list[list[float] | None]
    keys: dict[str, str]


def read_tps(text: str, path: object) -> Landmarks:
    """The landmarks of a .tps of one specimen, but those that are missing.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: two coordinates a landmark, several specimens, or another layout.
    """
    blocks = _blocks(text, path)
    if len(blocks) != 1:
        many = "no specimen" if not blocks else f"{len(blocks)} specimens"
        raise ValueError(f"{path}: has {many} (LM3=); give a file of one, the template")
    return collected([("", point) for point in blocks[0].points], path)


def read_specimens(path: str | os.PathLike[str]) -> Specimens:
    """Read the landmarks of many specimens, as `jfsf collection` writes them.

    Args:
        path: .tps, with the names of specimens as ID (or else IMAGE, or else their
            numbers); or .csv, .tsv or .txt: a row a specimen, its name, x, y and z of
            the first landmark, and on, under titles that end in x, y and z.

    Returns:
        All of them, in the order of the file; a landmark of NA, nan or an empty cell is
        missing.

    Raises:
        ValueError: another format or layout, specimens of different numbers of
            landmarks, or two of one name; it names the file and the line.
        OSError: the file cannot be read.
    """
    path = Path(path)
    readers = {".tps": _tps_specimens} | dict.fromkeys(TABLES, _table_specimens)
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"{path}: landmarks of many specimens are .tps, or a table "
            f"({', '.join(TABLES)})"
        )
    specimens, landmarks, rows = reader(read_text(path), path)
    if twice := [name for name in specimens if specimens.count(name) > 1]:
        raise ValueError(
            f"{path}: {len(twice)} specimens have names that others have, such as "
            f"{twice[0]!r}; give each a name of its own"
        )
    lost = 3 * [np.nan]
    points = np.array([[point or lost for point in row] for row in rows], float)
    return Specimens(tuple(specimens), tuple(landmarks), points)


def _tps_specimens(text, path):
    blocks = _blocks(text, path)
    if not blocks:
        raise ValueError(f"{path}: has no specimen (LM3=); save it again")
    names = []
    for i, (points, keys) in enumerate(blocks, 1):
        names.append(keys.get("ID") or keys.get("IMAGE") or str(i))
        if len(points) != len(blocks[0].points):
            raise ValueError(
                f"{path}: specimen {names[-1]!r} has {len(points)} landmarks, the "
                f"first {len(blocks[0].points)}; write NA NA NA for a missing one"
            )
    landmarks = [""] * len(blocks[0].points)
    return names, landmarks, [block.points for block in blocks]


def _table_specimens(text, path):
    rows = table_rows(text, path, " ")
    titles = rows[0][1][1:] if rows else []
    ends = "".join(title[-1:].lower() for title in titles)
    if len(rows) < 2 or not ends or ends != "xyz" * (len(ends) // 3):
        raise ValueError(
            f"{path}: is no table of specimens; its first line holds titles, "
            "specimen,NAME_x,NAME_y,NAME_z for each landmark, and each other line a "
            "specimen, as `jfsf collection` writes landmarks.csv"
        )
    landmarks = [re.sub("[_. ]?.$", "", title) for title in titles[::3]]
    points = []
    for number, (_, *cells) in rows[1:]:
        if len(cells) != len(titles):
            raise ValueError(
                f"{path}: line {number} has {len(cells) + 1} cells, the first "
                f"{len(titles) + 1}"
            )
        triples = zip(*[(cell or _MISSING for cell in cells)] * 3, strict=True)
        line = ",".join(cells)
        points.append([_point(three, number, line, path) for three in triples])
    return [cells[0] for _, cells in rows[1:]], landmarks, points


def _blocks(text: str, path: object) -> list[_Block]:
    """The specimens of a .tps; ValueError for another layout, or two coordinates."""
    lines = numbered_lines(text)
    heads = [re.match(r"(?i)LM(3?)=\s*(\d+)\s*$", line) for _, line in lines]
    at = [i for i, head in enumerate(heads) if head]
    blocks = []
    for start, end in pairwise([*at, len(lines)]):
        head = heads[start]
        if head is None or not head[1]:
            raise ValueError(
                f"{path}: its landmarks are in a plane (LM=); LM3= is needed"
            )
        number = int(head[2])
        rows = lines[start + 1 : min(start + 1 + number, end)]
        points = [_point(line.split(), n, line, path) for n, line in rows]
        if len(points) < number:
            raise ValueError(
                f"{path}: ends before its {number} landmarks; save it again"
            )
        pairs = (line.split("=", 1) for _, line in lines[start:end] if "=" in line)
        keys = {key.strip().upper(): value.strip() for key, value in pairs}
        factor = keys.get("SCALE", "1")
        if not is_number(factor):
            raise ValueError(f"{path}: SCALE is {factor[:20]!r}; give a number")
        scaled = [p and [float(factor) * x for x in p] for p in points]
        blocks.append(_Block(scaled, keys))
    return blocks


def read_pts(text: str, path: object) -> Landmarks:
    """The landmarks of a .pts, but those that are missing.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: another layout.
    """
    lines = numbered_lines(text)
    if len(lines) > 1 and lines[0][1].lower().startswith("version"):
        lines = lines[2:]
    rows = []
    for number, line in lines:
        name, *cells = re.split(r"\s+", line.strip())
        rows.append((name, _point(cells, number, line, path)))
    return collected(rows, path)


def _point(cells: Sequence[str], number: int, line: str, path) -> list[float] | None:
    if len(cells) == 3 and all(cell.upper() in (_MISSING, "NAN") for cell in cells):
        return None
    point = to_point(cells)
    if point is None:
        raise ValueError(
            f"{path}: line {number} is {line[:60]!r}, without the numbers x, y and z"
        )
    return None if point == 3 * [_NO_POINT] else point


def tps_text(landmarks: Landmarks) -> str:
    """What `read_tps` reads."""
    return specimens_tps([""], np.asarray(landmarks.points)[None])


def pts_text(landmarks: Landmarks) -> str:
    """What `read_pts` reads; blanks in names become low lines."""
    names = [
        re.sub(r"\s+", "_", name) or f"S{i:04d}"
        for i, name in enumerate(landmarks.names)
    ]
    lines = ["Version 1.0", str(len(names))]
    for name, point in zip(names, np.asarray(landmarks.points).tolist(), strict=True):
        lines.append(" ".join([name, *map(repr, point)]))
    return "\n".join([*lines, ""])


def specimens_tps(specimens: Sequence[str], points: Float[ArrayLike, "s l 3"]) -> str:
    """Many specimens as .tps, for `geomorph::readland.tps(file, specID = "ID")`.

    Args:
        specimens: their names.
        points: nan where a specimen lacks a landmark; NA is written.
    """
    lines = []
    for name, rows in zip(specimens, np.asarray(points, float), strict=True):
        lines.append(f"LM3={len(rows)}")
        lines += [
            " ".join(_MISSING if x != x else repr(x) for x in row)
            for row in rows.tolist()
        ]
        lines.append(f"ID={name}")
    return "\n".join([*lines, ""])


def specimens_csv(
    specimens: Sequence[str], names: Sequence[str], points: Float[ArrayLike, "s l 3"]
) -> str:
    """Many specimens as a table: a row each, x, y and z of the first landmark, and on.

    In R it is `geomorph::arrayspecs(read.csv(file, row.names = 1), l, 3)`, the array of
    landmarks, coordinates and specimens that geomorph and Morpho take.

    Args:
        specimens: their names.
        names: of the landmarks; numbers from 1 on for those without.
        points: as in `specimens_tps`.
    """
    titles = ["specimen", *(f"{name}_{c}" for name in titles_of(names) for c in "xyz")]
    rows = np.reshape(points, (len(specimens), -1)).tolist()
    return csv_text(titles, [[n, *own] for n, own in zip(specimens, rows, strict=True)])
