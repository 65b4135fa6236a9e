"""Lists of semilandmarks and pairs, and groups of specimens, as files.

Landmarks are numbered from 1 there, as in geomorph, whose `define.sliders` writes
curveslide.csv and surfslide.csv.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.apps.landmarks._record import csv_text, table_rows, to_vertex
from jfsf.storage._atomic import write_text
from jfsf.storage._text import read_text


class Kind(NamedTuple):
    """A kind of list.

    file: its name, as `jfsf collection` writes it.
    titles: of its columns.
    once: the columns in which no landmark may be twice.
    """

    file: str
    titles: tuple[str, ...]
    once: slice = slice(None)


LISTS = {
    # Neighbours of a semilandmark may be those of others.
    "curves": Kind("curveslide.csv", ("before", "slide", "after"), slice(1, 2)),
    "surfaces": Kind("surfslide.csv", ("surface",)),
    "pairs": Kind("landmark_pairs.csv", ("left", "right")),
}
ALONE = -1  # in place of the partner of a landmark that has none


def read_list(path: Path, kind: Kind, landmarks: int) -> Int[np.ndarray, "r c"]:
    """Read rows of landmarks, as numbers from 0.

    Args:
        path: a table; the columns of the kind's titles, or the only ones.
        kind: one of `LISTS`.
        landmarks: how many there are.

    Returns:
        No rows of a table that has titles only. Of a pair whose second cell is empty,
        the second number is `ALONE`.

    Raises:
        ValueError: another layout, a number that no landmark has, or one that is there
            twice; it names the file and the line.
        OSError: the file cannot be read.
    """
    rows, width = _rows(path), len(kind.titles)
    first = rows[0][1]
    columns, is_head = list(range(width)), len(first) == width
    if set(kind.titles) <= set(first):
        columns, is_head = [first.index(title) for title in kind.titles], True
    if is_head and all(to_vertex(cell) is None for cell in first):
        rows = rows[1:]
    numbers, known = np.full((len(rows), width), ALONE), set()
    for at, (line, cells) in enumerate(rows):
        where = f"{path}: line {line}"
        own = [cells[i] for i in columns if i < len(cells)]
        is_alone = kind == LISTS["pairs"] and own[1:] == [""]
        found = [to_vertex(cell) for cell in (own[:1] if is_alone else own)]
        row = [number for number in found if number is not None]
        extra = columns == list(range(width)) and len(cells) > width
        if extra or len(row) < width - is_alone:
            raise ValueError(
                f"{where} is {','.join(cells)[:60]!r}; a line holds "
                f"{','.join(kind.titles)}, numbers of landmarks from 1"
            )
        if wrong := [i for i in row if not 1 <= i <= landmarks]:
            raise ValueError(f"{where} has {wrong[0]}; landmarks are 1 to {landmarks}")
        if len(set(row)) < len(row):
            raise ValueError(f"{where} has a landmark twice")
        if again := known.intersection(once := row[kind.once]):
            raise ValueError(
                f"{where}: landmark {min(again)} is twice in the file; take one out"
            )
        known.update(once)
        numbers[at, : len(row)] = np.array(row) - 1
    return numbers


def write_lists(
    folder: Path, lists: Mapping[str, Int[np.ndarray, "r c"]]
) -> list[Path]:
    """Write lists, by their kinds, and remove those of other kinds of an earlier run.

    Args:
        folder: where they are named as `LISTS` has them.
        lists: as `read_list` returns them.
    """
    written = []
    for name, kind in LISTS.items():
        path = folder / kind.file
        if name not in lists:
            path.unlink(missing_ok=True)
            continue
        rows = np.where(lists[name] < 0, "", (lists[name] + 1).astype(str))
        write_text(path, csv_text(kind.titles, rows))
        written.append(path)
    return written


def lists_in(folder: Path, landmarks: int) -> dict[str, Int[np.ndarray, "r c"]]:
    """The lists of a folder, by their kinds; as `read_list`."""
    paths = {name: folder / kind.file for name, kind in LISTS.items()}
    return {
        name: read_list(path, LISTS[name], landmarks)
        for name, path in paths.items()
        if path.is_file()
    }


def read_groups(
    path: Path, specimens: Sequence[str], column: str | None
) -> tuple[str, list[str]]:
    """The title of a column, and its cell for each specimen; "" for one without.

    Args:
        path: a table with titles; its first column holds names of specimens.
        specimens: their names.
        column: its title; the second column if None.

    Raises:
        ValueError: another layout, no such column, a specimen twice, or none of those
            that there are.
        OSError: the file cannot be read.
    """
    (_, titles), *rows = _rows(path)
    own = titles[1:]
    if not own:
        raise ValueError(
            f"{path}: has one column; give names of specimens, and columns of your own"
        )
    if column is not None and column not in own:
        raise ValueError(f"{path}: has no column {column!r}; it has {', '.join(own)}")
    title = column or own[0]
    at = 1 + own.index(title)
    cells = {}
    for line, row in rows:
        if row[0] in cells:
            raise ValueError(f"{path}: line {line} has {row[0]!r} again")
        cells[row[0]] = row[at] if at < len(row) else ""
    if not set(specimens) & set(cells):
        raise ValueError(
            f"{path}: names none of the specimens in its first column, "
            f"{titles[0]!r}; they are {', '.join(specimens[:3])}, ..."
        )
    return title, [cells.get(name, "") for name in specimens]


def has_rows(path: Path) -> bool:
    """Whether a table is there, and has more than titles."""
    return path.is_file() and len(_rows(path)) > 1


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Number of each line, and its cells; one or more."""
    if rows := table_rows(read_text(path), path):
        return rows
    raise ValueError(f"{path}: is empty; save it again")
