"""Which landmarks of two shapes belong together, by name or by their order."""

import re
import unicodedata
from typing import NamedTuple

import numpy as np

from jfsf.apps.landmarks._record import Landmarks
from jfsf.types import ArrayLike

_NUMBERED = re.compile(r"(.*?)([0-9]*)", re.DOTALL)


class Pairing(NamedTuple):
    """Landmarks that belong together.

    rows: (p, 2) int64, the number of a landmark of X and of its partner of Y, from 0
        on, in the order of X.
    names: a name for each row.
    said: what was paired how, and what has no partner, a sentence each.
    """

    rows: ArrayLike
    names: tuple[str, ...]
    said: list[str]


def pair_landmarks(landmarks_x: Landmarks, landmarks_y: Landmarks) -> Pairing:
    """Pair the landmarks of two shapes.

    By name, if both have names that occur once each, and at least one is in both. Else
    by their order, if there are as many of both and one has no names, or both have
    numbers as a program gives them ("F-1", "F-2"). Numbers without a gap from 0 on and
    from 1 on are paired by their order too.

    Args:
        landmarks_x, landmarks_y: the landmarks of X and of Y.

    Raises:
        ValueError: they cannot be paired; it names what was found.
    """
    x, y = _plain(landmarks_x.names), _plain(landmarks_y.names)
    if not x or not y:
        raise ValueError("pair_landmarks: a shape has no landmark; give some")
    count = {name: i for i, name in enumerate(y)}
    common = [(i, count[name]) for i, name in enumerate(x) if name and name in count]
    unique = all(len(set(named)) == len(named) for named in (_named(x), _named(y)))
    nameless = not any(x) or not any(y)
    by_order = len(x) == len(y) and (nameless or _generated(x) and _generated(y))
    if common and unique and not (by_order and _shifted(x, y)):
        rows = np.array(common, np.int64)
        names = tuple(landmarks_x.names[i] for i in rows[:, 0])
        said = [f"{len(rows)} paired by name: {', '.join(names)}"]
        for side, names_of, paired in (("X", x, rows[:, 0]), ("Y", y, rows[:, 1])):
            alone = [name for i, name in enumerate(names_of) if i not in paired]
            if alone:
                said.append(f"without a partner, of {side}: {_listed(alone)}")
        return Pairing(rows, names, said)
    if by_order:
        rows = np.repeat(np.arange(len(x))[:, None], 2, axis=1)
        said = [f"{len(x)} paired by their order in the files"]
        return Pairing(rows, landmarks_x.names, said)
    if not unique:
        side, names = ("X", x) if len(set(_named(x))) < len(_named(x)) else ("Y", y)
        twice = sorted({name for name in names if name and names.count(name) > 1})
        raise ValueError(
            f"landmarks of {side} have the same name: {_listed(twice)}; give each "
            "a name of its own"
        )
    raise ValueError(
        f"no landmark has the same name in both files: X has {_listed(x)}, Y has "
        f"{_listed(y)}; name those that belong together alike, or give as many of "
        "both, in one order, without names"
    )


def _plain(names: tuple[str, ...]) -> list[str]:
    """One form for letters that can be written in two ways."""
    return [unicodedata.normalize("NFC", name).strip() for name in names]


def _named(names: list[str]) -> list[str]:
    return [name for name in names if name]


def _generated(names: list[str]) -> bool:
    """Whether there are no names, or one with a number after it."""
    if not any(names):
        return True
    parts = [_NUMBERED.fullmatch(name) for name in names]
    prefixes = {part[1] for part in parts if part}
    return len(prefixes) == 1 and all(part and part[2] for part in parts)


def _shifted(x: list[str], y: list[str]) -> bool:
    """Whether one is counted from 0 on without a gap, the other from 1 on."""
    # Not as numbers: Python refuses those of thousands of digits.
    number = lambda name: name[len(name.rstrip("0123456789")) :]
    counted = [[number(name) for name in names] for names in (x, y)]
    runs = [[str(first + i) for i in range(len(x))] for first in (0, 1)]
    return counted == runs or counted == runs[::-1]


def _listed(names: list[str]) -> str:
    """Up to ten names."""
    shown = [repr(name) if name else "one without a name" for name in names[:10]]
    more = [f"{len(names) - 10} more"] if len(names) > 10 else []
    return ", ".join(shown + more)
