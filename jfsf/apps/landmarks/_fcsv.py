"""Landmarks of 3D Slicer as comma separated text (.fcsv).

Written by Slicer 3 (label,x,y,z,sel,vis) and 4 (an id first, the label in column 12);
the system is a number up to 4.10, a word from 4.11 on. Slicer 5 adds two columns
without a title: the status of the position (2: it is defined), and whether Slicer made
the point itself. Without a word on the coordinate system it is RAS, as in Slicer 3 and
the first of 4.
"""

import csv

import numpy as np

from jfsf.apps.landmarks._record import (
    Landmarks,
    clean_name,
    numbered_lines,
    quoted,
    skipped,
    to_number,
    to_system,
)

_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
_OLD_COLUMNS = "label,x,y,z,sel,vis"
_STATUS, _UNDEFINED = 14, {"0", "1", "3"}  # not placed, not yet, and missing
_VERSION = "Markups fiducial file version"


def read_fcsv(text: str, path: object) -> Landmarks:
    """The points of a file, but those without a position.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: a line without three coordinates, or no point.
    """
    lines = numbered_lines(text)
    header = _header([line for _, line in lines if line.startswith("#")])
    system = to_system(header.get("CoordinateSystem", "RAS"), path)
    usual = _COLUMNS if _VERSION in header else _OLD_COLUMNS
    titles = header.get("columns", usual).split(",")
    titles = [title.strip().lower() for title in titles]
    if not {"x", "y", "z"} <= set(titles):
        raise ValueError(
            f"{path}: its columns are {','.join(titles)[:60]!r}, without x, y and z; "
            "save the landmarks again"
        )
    places = [titles.index(axis) for axis in "xyz"]
    label = titles.index("label") if "label" in titles else -1
    names, points, without = [], [], []
    for number, line in lines:
        if line.startswith("#"):
            continue
        try:
            (cells,) = csv.reader([line])
        except csv.Error as error:
            raise ValueError(f"{path}: line {number}: {error}") from None
        name = clean_name(cells[label] if 0 <= label < len(cells) else "")
        found = [cells[at].strip() for at in places if at < len(cells)]
        # NaN is what older ones write for a point without a position.
        status = cells[_STATUS].strip() if len(cells) > _STATUS == len(titles) else ""
        if status in _UNDEFINED or [cell.lower() for cell in found] == ["nan"] * 3:
            without.append(name)
            continue
        point = [to_number(cell) for cell in found]
        if len(point) < 3 or None in point or not np.isfinite(point).all():  # type: ignore
            raise ValueError(
                f"{path}: line {number} is {line[:60]!r}, without the numbers x, y and "
                "z; save the landmarks again"
            )
        names.append(name)
        points.append(point)
    if not names:
        raise ValueError(f"{path}: has no point with a position; place some")
    return Landmarks(tuple(names), np.array(points), None, system, skipped(without))


def fcsv_text(landmarks: Landmarks) -> str:
    """What `read_fcsv` and Slicer 4.11 and later read. Without a system it says LPS.

    Args:
        landmarks: with points.
    """
    lines = [
        f"# {_VERSION} = 4.13",
        f"# CoordinateSystem = {landmarks.system or 'LPS'}",
        f"# columns = {_COLUMNS}",
    ]
    points = np.asarray(landmarks.points).tolist()
    for i, (name, point) in enumerate(zip(landmarks.names, points, strict=True), 1):
        xyz = ",".join(map(repr, point))
        lines.append(f"{i},{xyz},0,0,0,1,1,1,0,{quoted(name)},,")
    return "\n".join([*lines, ""])


def _header(comments: list[str]) -> dict[str, str]:
    pairs = (line.lstrip("#").partition("=") for line in comments)
    return {key.strip(): value.strip() for key, sign, value in pairs if sign}
