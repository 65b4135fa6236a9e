"""Landmarks of 3D Slicer as JSON (.mrk.json).

The format is described in Slicer's manual (Markups, developer guide) and its JSON
schema. A file holds one or more lists of control points. Without a word on the
coordinate system it is LPS.
"""

import json
from typing import Any

import numpy as np

from jfsf.apps.landmarks._record import (
    Landmarks,
    clean_name,
    skipped,
    titled,
    to_system,
)

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/"
    "Resources/Schema/markups-schema-v1.0.3.json#"
)
# Slicer's orientation of a point in LPS that was not turned; the same matrix in RAS.
_ORIENTATION = {
    "LPS": [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
    "RAS": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
}


def read_markups(text: str, path: object) -> Landmarks:
    """The control points of all lists in a file, but those without a position.

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
    lists = tree.get("markups") if isinstance(tree, dict) else None
    if not isinstance(lists, list) or not all(isinstance(a, dict) for a in lists):
        raise ValueError(
            f"{path}: has no list of markups; save the points as .mrk.json in Slicer"
        )
    names, points, systems, without = [], [], [], []
    for markups in lists:
        found = markups.get("controlPoints", [])
        if not isinstance(found, list) or not all(isinstance(a, dict) for a in found):
            raise ValueError(
                f"{path}: controlPoints is no list of points; save it again"
            )
        if found:
            word = markups.get("coordinateSystem", "LPS")
            systems.append(to_system(str(word), path))
        for control in found:
            name = control.get("label")
            name = clean_name("" if name is None else str(name))
            if control.get("positionStatus", "defined") != "defined":
                without.append(name)
                continue
            names.append(name)
            points.append(_position(control.get("position"), names, path))
    if len(set(systems)) > 1:
        raise ValueError(
            f"{path}: has lists in LPS and in RAS; save them as files of their own"
        )
    if not names:
        raise ValueError(f"{path}: has no point with a position; place some")
    return Landmarks(tuple(names), np.array(points), None, systems[0], skipped(without))


def markups_text(landmarks: Landmarks) -> str:
    """What `read_markups` reads. Without a system it says LPS, as Slicer's meshes are.

    Args:
        landmarks: with points.
    """
    system = landmarks.system or "LPS"
    controls = [
        {
            "id": str(i),
            "label": name,
            "description": "",
            "associatedNodeID": "",
            "position": point,
            "orientation": _ORIENTATION[system],
            "selected": True,
            "locked": False,
            "visibility": True,
            "positionStatus": "defined",
        }
        for i, (name, point) in enumerate(
            zip(landmarks.names, np.asarray(landmarks.points).tolist(), strict=True), 1
        )
    ]
    markups = {
        "type": "Fiducial",
        "coordinateSystem": system,
        "locked": False,
        "labelFormat": "%N-%d",
        "controlPoints": controls,
    }
    tree = {"@schema": _SCHEMA, "markups": [markups]}
    return json.dumps(tree, indent=4, ensure_ascii=False) + "\n"


def _position(value: Any, names: list[str], path) -> list[float]:
    is_number = lambda v: isinstance(v, int | float) and not isinstance(v, bool)
    if isinstance(value, list) and len(value) == 3 and all(map(is_number, value)):
        try:
            point = [float(v) for v in value]
        except OverflowError:
            point = [np.inf]
        if np.isfinite(point).all():
            return point
    raise ValueError(
        f"{path}: the position of {titled(tuple(names), len(names) - 1)} is "
        f"{str(value)[:60]}, expected three numbers; save it again"
    )
