"""Landmarks of geometric morphometrics: .tps and .pts, and tables of many specimens.

- `.tps` (Rohlf; tpsDig, geomorph): `LM3=` and a number, so many lines of x, y and z,
  then `ID=`, `IMAGE=`, `SCALE=` and others. Coordinates are multiplied by the scale, as
  `geomorph::readland.tps` does, which has NA for a missing one. There are no names of
  landmarks.
- `.pts` (IDAV Landmark, Stratovan Checkpoint; `Morpho::read.pts`): `Version 1.0`, a
  number, and so many lines of a name, x, y and z; 9999 is a missing one.
"""

import csv
import io
import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jfsf.apps.landmarks._record import (
    Landmarks,
    collected,
    is_number,
    numbered_lines,
    to_point,
)
from jfsf.types import ArrayLike

_MISSING = "NA"
_NO_POINT = 9999.0  # of .pts


def read_tps(text: str, path: object) -> Landmarks:
    """The landmarks of a .tps of one specimen, but those that are missing.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: two coordinates a landmark, several specimens, or another layout.
    """
    lines = numbered_lines(text)
    heads = [re.match(r"(?i)LM(3?)=\s*(\d+)\s*$", line) for _, line in lines]
    at = [i for i, head in enumerate(heads) if head]
    if len(at) != 1:
        many = "no specimen" if not at else f"{len(at)} specimens"
        raise ValueError(f"{path}: has {many} (LM3=); give a file of one, the template")
    head = heads[at[0]]
    if head is None or not head[1]:
        raise ValueError(f"{path}: its landmarks are in a plane (LM=); LM3= is needed")
    points = lines[at[0] + 1 : at[0] + 1 + int(head[2])]
    rows = [("", _point(line.split(), n, line, path)) for n, line in points]
    if len(rows) < int(head[2]):
        raise ValueError(f"{path}: ends before its {head[2]} landmarks; save it again")
    keys = dict(line.split("=", 1) for _, line in lines if "=" in line)
    scale = {key.strip().upper(): value.strip() for key, value in keys.items()}
    factor = scale.get("SCALE", "1")
    if not is_number(factor):
        raise ValueError(f"{path}: SCALE is {factor[:20]!r}; give a number")
    scaled = [(name, p and [float(factor) * x for x in p]) for name, p in rows]
    return collected(scaled, path)


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
        lines += [" ".join(map(_number, row)) for row in rows.tolist()]
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
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    named = [name or str(i) for i, name in enumerate(names, 1)]
    table.writerow(["specimen", *(f"{name}_{c}" for name in named for c in "xyz")])
    for specimen, rows in zip(specimens, np.asarray(points, float), strict=True):
        table.writerow([specimen, *map(_number, rows.ravel().tolist())])
    return text.getvalue()


def _number(value: float) -> str:
    return repr(value) if np.isfinite(value) else _MISSING
