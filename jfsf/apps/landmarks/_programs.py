"""Landmarks of 3D Slicer (.mrk.json and .fcsv) and MeshLab (.pp).

- `.mrk.json` is described in Slicer's manual (Markups, developer guide) and its JSON
  schema. A file holds one or more lists of control points. Without a word on the
  coordinate system it is LPS.
- `.fcsv` is comma separated text, written by Slicer 3 (label,x,y,z,sel,vis) and 4 (an
  id first, the label in column 12). The system is a number up to 4.10, a word from 4.11
  on; without either it is RAS. Slicer 5 adds two columns without a title: the status of
  the position (2: it is defined), and whether Slicer made the point itself.
- `.pp` is XML, without a coordinate system. MeshLab writes the attributes of a point in
  any order, and active="0" for a point of the template that was not placed.
"""

import csv
import json
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from jfsf.apps.landmarks._record import (
    Landmarks,
    collected,
    numbered_lines,
    quoted,
    to_point,
)

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
    "Resources/Schema/markups-schema-v1.0.3.json#"
)
_SYSTEMS = {"lps": "LPS", "1": "LPS", "ras": "RAS", "0": "RAS"}
_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
_OLD_COLUMNS = "label,x,y,z,sel,vis"
_STATUS, _UNDEFINED = 14, {"0", "1", "3"}  # not placed, not yet, and missing
_VERSION = "Markups fiducial file version"
_ROOT = "PickedPoints"


def read_markups(text: str, path: object) -> Landmarks:
    """The control points of all lists of a .mrk.json, but those without a position.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: no JSON, or another layout.
    """
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is not JSON ({error}); save it again") from None
    lists: Any = tree.get("markups") if isinstance(tree, dict) else None
    if not _is_list_of_dicts(lists):
        raise ValueError(
            f"{path}: has no list of markups, as 3D Slicer's .mrk.json has; save "
            "points of other programs as a table (.csv) with name,x,y,z on each line"
        )
    controls, systems = [], set()
    for markups in lists:
        points = markups.get("controlPoints", [])
        if not _is_list_of_dicts(points):
            raise ValueError(
                f"{path}: controlPoints is no list of points; save it again"
            )
        controls += points
        if points:
            systems.add(_system(str(markups.get("coordinateSystem", "LPS")), path))
    if len(systems) > 1:
        raise ValueError(
            f"{path}: has lists in LPS and in RAS; save them as files of their own"
        )
    return collected(_controls(controls, path), path, *systems)


def _is_list_of_dicts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, dict) for item in value)


def _controls(controls: list[dict], path: object) -> Iterator[tuple[str, Any]]:
    for control in controls:
        name = "" if control.get("label") is None else str(control["label"])
        point = None
        if control.get("positionStatus", "defined") == "defined":
            position = control.get("position")
            cells = map(repr, position) if isinstance(position, list) else ()
            point = _point(list(cells), str(position), name, path)
        yield name, point


def _point(cells: list[str], shown: str, name: str, path: object) -> list[float]:
    if (point := to_point(cells)) is None:
        raise ValueError(
            f"{path}: the position of landmark {name!r} is {shown[:60]!r}, expected "
            "three numbers; save it again"
        )
    return point


def _system(word: str, path: object) -> str:
    """ "LPS" or "RAS", of a file's own word for its axes."""
    if (system := _SYSTEMS.get(word.strip().lower())) is None:
        raise ValueError(
            f"{path}: its coordinate system is {word.strip()[:20]!r}; save the "
            "landmarks in LPS or RAS"
        )
    return system


def markups_text(landmarks: Landmarks) -> str:
    """What `read_markups` reads. Without a system it says LPS, as Slicer's meshes are.

    Args:
        landmarks: with points.
    """
    points = np.asarray(landmarks.points).tolist()
    controls = [
        {"id": str(i), "label": name, "position": point, "positionStatus": "defined"}
        for i, (name, point) in enumerate(zip(landmarks.names, points, strict=True), 1)
    ]
    markups = {
        "type": "Fiducial",
        "coordinateSystem": landmarks.system or "LPS",
        "controlPoints": controls,
    }
    tree = {"@schema": _SCHEMA, "markups": [markups]}
    return json.dumps(tree, indent=4, ensure_ascii=False) + "\n"


def read_fcsv(text: str, path: object) -> Landmarks:
    """The points of a .fcsv, but those without a position.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: a line without three coordinates, or no point.
    """
    lines = numbered_lines(text)
    comments = [line.lstrip("#") for _, line in lines if line.startswith("#")]
    header = {
        key.strip(): value.strip()
        for key, sign, value in (comment.partition("=") for comment in comments)
        if sign
    }
    usual = _COLUMNS if _VERSION in header else _OLD_COLUMNS
    titles = header.get("columns", usual).lower().split(",")
    titles = [title.strip() for title in titles]
    if not {"x", "y", "z"} <= set(titles):
        raise ValueError(
            f"{path}: its columns are {','.join(titles)[:60]!r}, without x, y and z; "
            "save the landmarks again"
        )
    rows = [row for row in lines if not row[1].startswith("#")]
    system = _system(header.get("CoordinateSystem", "RAS"), path)
    return collected(_fcsv_rows(rows, titles, path), path, system)


def _fcsv_rows(lines, titles: list[str], path: object) -> Iterator[tuple[str, Any]]:
    axes = [titles.index(axis) for axis in "xyz"]
    label = titles.index("label") if "label" in titles else len(titles)
    for number, line in lines:
        try:
            (cells,) = csv.reader([line])
        except csv.Error as error:
            raise ValueError(f"{path}: line {number}: {error}") from None
        name = cells[label] if label < len(cells) else ""
        cells_xyz = [cells[at] for at in axes if at < len(cells)]
        status = cells[_STATUS].strip() if len(cells) > _STATUS == len(titles) else ""
        # NaN is what older ones write for a point without a position.
        if status in _UNDEFINED or [c.strip().lower() for c in cells_xyz] == 3 * [
            "nan"
        ]:
            yield name, None
        elif (point := to_point(cells_xyz)) is not None:
            yield name, point
        else:
            raise ValueError(
                f"{path}: line {number} is {line[:60]!r}, without the numbers x, y and "
                "z; save the landmarks again"
            )


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


def read_picked_points(text: str, path: object) -> Landmarks:
    """The points of a .pp, but those that were not placed.

    Args:
        text: of the file.
        path: opens the message.

    Raises:
        ValueError: no XML of picked points, a point without three coordinates, or no
            point.
    """
    if "<!ENTITY" in text:  # a short file can hold gigabytes of them
        raise ValueError(f"{path}: defines entities; save it from MeshLab again")
    try:
        # Blanks before the first tag are no XML.
        root = ElementTree.fromstring(text.strip())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ValueError(f"{path}: is not XML ({error}); save it again") from None
    if root.tag != _ROOT:
        raise ValueError(
            f"{path}: holds {root.tag[:40]}, not {_ROOT}; save the points from MeshLab "
            "as .pp"
        )
    return collected(_picked(root.findall("point"), path), path)


def _picked(points: list, path: object) -> Iterator[tuple[str, Any]]:
    for point in points:
        name, cells = point.get("name", ""), [point.get(axis, "") for axis in "xyz"]
        placed = point.get("active", "1").strip().lower() not in ("0", "false")
        yield name, _point(cells, " ".join(cells), name, path) if placed else None


def picked_points_text(landmarks: Landmarks) -> str:
    """What `read_picked_points` and MeshLab read.

    Args:
        landmarks: with points.
    """
    lines = [
        f"<!DOCTYPE {_ROOT}>",
        f"<{_ROOT}>",
        " <DocumentData>",
        '  <DataFileName name=""/>',
        '  <templateName name=""/>',
        " </DocumentData>",
    ]
    points = np.asarray(landmarks.points).tolist()
    for name, (x, y, z) in zip(landmarks.names, points, strict=True):
        place = f'x="{x!r}" y="{y!r}" z="{z!r}"'
        lines.append(f' <point {place} name={quoteattr(name)} active="1"/>')
    return "\n".join([*lines, f"</{_ROOT}>", ""])
