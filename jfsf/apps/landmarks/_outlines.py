"""Curves and patches on a template, as they are drawn: files of semilandmarks.

- A curve of 3D Slicer (`.mrk.json`, its list of the type Curve or ClosedCurve).
- A table (`.csv`): `curve,NAME,NUMBER,LANDMARK,LANDMARK,...` is a curve from landmark
  to landmark, `patch,NAME,NUMBER,LANDMARK,LANDMARK,LANDMARK,...` a part of the surface
  by its rim, and `curve,NAME,NUMBER` gives a curve of Slicer its number of points.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.apps.landmarks._programs import read_markups
from jfsf.apps.landmarks._record import Landmarks, table_rows, to_vertex
from jfsf.storage._text import read_text
from jfsf.types import ArrayLike

_CURVES = {"Curve": False, "ClosedCurve": True}  # types of Slicer -> closed or not
_SLICER = ".mrk.json"
_LEAST = {"curve": 2, "patch": 3}  # landmarks
_CLOSED = 3  # points of a closed curve: with fewer, both neighbours are one
_EXPECTED = (
    "a line is curve,NAME,NUMBER,LANDMARK,LANDMARK,... or "
    "patch,NAME,NUMBER,LANDMARK,LANDMARK,LANDMARK,..."
)


class Outline(NamedTuple):
    """A curve or the rim of a patch.

    name: its points are named so, with a number.
    kind: "curve", "closed" for a closed curve of Slicer, or "patch".
    number: of its semilandmarks that slide; the ends of an open curve do not.
    landmarks: the landmarks that it runs through, from 0; () for a curve of Slicer.
    controls: the control points of a curve of Slicer; None for others.
    """

    name: str
    kind: str
    number: int
    landmarks: tuple[int, ...] = ()
    controls: Float[ArrayLike, "c 3"] | None = None


def read_outlines(paths: Sequence[Path], names: Sequence[str]) -> list[Outline]:
    """Read the curves and patches of all files, curves first.

    Args:
        paths: curves of Slicer, and tables.
        names: of the landmarks.

    Raises:
        ValueError: another format, a line or a curve of another form, a landmark that
            is not there, or two outlines of one name; it names file and line.
        OSError: a file cannot be read.
    """
    found: dict[str, Outline] = {}
    numbers: dict[str, tuple[int, str]] = {}  # of curves of Slicer, and where it stands
    for path in map(Path, paths):
        if path.suffix.lower() not in (".json", ".csv"):
            raise ValueError(
                f"{path}: unknown format of semilandmarks; they are a curve of 3D "
                f"Slicer ({_SLICER}) or a table (.csv)"
            )
        is_table = path.suffix.lower() == ".csv"
        rows = _table(path, names, numbers) if is_table else [_curve(path)]
        for one in rows:
            if one.name in found:
                raise ValueError(f"{path}: {one.name!r} is there twice; rename one")
            found[one.name] = one
    for name, (number, where) in numbers.items():
        if name not in found or found[name].controls is None:
            raise ValueError(
                f"{where}: has no landmarks, and no curve of Slicer is named {name!r}; "
                f"{_EXPECTED}"
            )
        found[name] = found[name]._replace(number=number)
    for one in found.values():
        if one.kind == "closed" and one.number < _CLOSED:
            raise ValueError(
                f"{one.name}: a closed curve of {one.number} points; give {_CLOSED} "
                "or more"
            )
    return sorted(found.values(), key=lambda one: one.kind == "patch")


def _curve(path: Path) -> Outline:
    """A curve of Slicer, with as many points as it has control points."""
    text = read_text(path)
    read = read_markups(text, path)  # raises if the layout is another one
    kinds = [str(one.get("type")) for one in json.loads(text)["markups"]]
    if len(kinds) != 1 or kinds[0] not in _CURVES:
        raise ValueError(
            f"{path}: holds {', '.join(kinds)}; save one Curve or ClosedCurve a file, "
            "and points as --landmarks"
        )
    closed = _CURVES[kinds[0]]
    n = len(read.names)
    if n < (least := _CLOSED if closed else 2):
        raise ValueError(f"{path}: has {n} control points; place {least} or more")
    name = path.name[: -len(_SLICER)] if path.name.endswith(_SLICER) else path.stem
    kind, number = ("closed", n) if closed else ("curve", n - 2)
    return Outline(name, kind, number, (), read.points)


def _table(path: Path, names, numbers) -> list[Outline]:
    """The lines of a table; those without landmarks go to `numbers`."""
    found = []
    text = re.sub(r"(?m)^[ \t]*#.*$", "", read_text(path))
    for at, cells in table_rows(text, path):
        where = f"{path}: line {at}"
        while cells and not cells[-1]:  # spreadsheets fill lines up
            cells.pop()
        if not cells:
            continue
        kind = cells[0].lower()
        number = to_vertex(cells[2]) if len(cells) > 2 else None
        if kind not in _LEAST or not cells[1] or not number:
            raise ValueError(f"{where} is {','.join(cells)[:60]!r}; {_EXPECTED}")
        ends = tuple(_landmark(word, names, where) for word in cells[3:])
        if kind == "curve" and not ends:
            numbers[cells[1]] = number, where
            continue
        if len(set(ends)) < _LEAST[kind]:
            raise ValueError(
                f"{where}: {cells[1]} has {len(set(ends))} landmarks, and a {kind} "
                f"needs {_LEAST[kind]}; {_EXPECTED}"
            )
        after = ends[1:] + (ends[:1] if kind == "patch" else ())
        if any(a == b for a, b in zip(ends, after, strict=False)):
            raise ValueError(f"{where}: a landmark of {cells[1]} follows on itself")
        found.append(Outline(cells[1], kind, number, ends))
    if not found and not numbers:
        raise ValueError(f"{path}: holds no curve and no patch; {_EXPECTED}")
    return found


def _landmark(word: str, names: Sequence[str], where: str) -> int:
    """The number from 0 of a landmark that is named, or counted from 1."""
    times = list(names).count(word) if word else 0
    if times == 1:
        return list(names).index(word)
    number = to_vertex(word)
    if times or number is None or not 1 <= number <= len(names):
        why = "several have this name" if times else f"there are {len(names)}"
        raise ValueError(
            f"{where}: {word!r} is no landmark ({why}); give a name of one, or its "
            "number from 1 on"
        )
    return number - 1


def check_new_names(names: Sequence[str], new: Sequence[str]) -> None:
    """ValueError if a semilandmark has the name of a landmark."""
    if twice := sorted(set(names) & set(new)):
        raise ValueError(
            f"a landmark is named {twice[0]!r}, as a semilandmark is; rename the curve "
            "or the patch"
        )


def appended(landmarks: Landmarks, names: Sequence[str], points) -> Landmarks:
    """Landmarks with semilandmarks after them, all as points."""
    check_new_names(landmarks.names, names)
    together = np.concatenate([np.asarray(landmarks.points), points])
    return landmarks._replace(names=(*landmarks.names, *names), points=together)
