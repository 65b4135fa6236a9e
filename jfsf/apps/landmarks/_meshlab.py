"""Picked points of MeshLab (.pp): XML.

MeshLab writes the attributes of a point in any order, and active="0" for a point of the
template that was not placed. Some versions write decimal commas.
"""

from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from jfsf.apps.landmarks._record import (
    Landmarks,
    clean_name,
    skipped,
    titled,
    to_number,
)

_ROOT = "PickedPoints"


def read_picked_points(text: str, path: object) -> Landmarks:
    """The points of a file, but those that were not placed.

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
    names, points, without = [], [], []
    for point in root.findall("point"):
        name = clean_name(point.get("name", ""))
        if point.get("active", "1").strip().lower() in ("0", "false"):
            without.append(name)
            continue
        words = [point.get(axis, "") for axis in "xyz"]
        xyz = [to_number(word, decimal_comma=True) for word in words]
        names.append(name)
        if None in xyz or not np.isfinite(xyz).all():  # type: ignore
            raise ValueError(
                f"{path}: the position of {titled(tuple(names), len(names) - 1)} is "
                f"{' '.join(words)[:60]!r}, expected three numbers; save it again"
            )
        points.append(xyz)
    if not names:
        raise ValueError(f"{path}: has no point that was placed; pick some")
    return Landmarks(tuple(names), np.array(points), None, None, skipped(without))


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
