"""Lists of semilandmarks and pairs, and groups of specimens, as people's files.

Landmarks are numbered from 1, as in geomorph, whose `define.sliders` writes
curveslide.csv (before, slide, after) and surfslide.csv.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int

from jfsf.apps.landmarks._record import cells_of, numbered_lines, to_vertex
from jfsf.apps.morphometrics._checks import check_once
from jfsf.storage._text import find_separator, read_text

CURVES, SURFACES, PAIRS = ("before", "slide", "after"), ("surfaces",), ("left", "right")


def read_numbers(
    path: Path, titles: Sequence[str], landmarks: int
) -> Int[np.ndarray, "r c"]:
    """Read rows of landmarks, as numbers from 0.

    Args:
        path: a table; the columns of these titles, or the only ones.
        titles: of the columns. No landmark may slide, or be in a pair, twice.
        landmarks: how many there are.

    Returns:
        No rows of a table that has titles only.

    Raises:
        ValueError: another layout, a number that no landmark has, or one that is there
            twice; it names the file and the line.
        OSError: the file cannot be read.
    """
    (head, *rows), width = _rows(path), len(titles)
    columns = list(range(width))
    if any(to_vertex(cell) is not None for cell in head[1]):
        rows = [head, *rows]
    elif set(titles) <= set(head[1]):
        columns = [head[1].index(title) for title in titles]
    elif len(head[1]) != width:
        rows = [head, *rows]  # whose number of cells is wrong
    numbers = np.zeros((len(rows), width), int)
    for at, (line, cells) in enumerate(rows):
        there = len(cells) > max(columns)
        if tuple(titles) == PAIRS and there and not cells[columns[1]]:
            raise ValueError(
                f"{path}: line {line}: landmark {cells[columns[0]]} has no partner; "
                "write it there, or take the line out if it is on the midline"
            )
        row = [to_vertex(cells[i]) for i in columns if i < len(cells)]
        row = [number for number in row if number is not None]
        if len(row) < width or (len(cells) != width and columns == list(range(width))):
            raise ValueError(
                f"{path}: line {line} is {','.join(cells)[:60]!r}; a line holds "
                f"{','.join(titles)}, numbers of landmarks from 1"
            )
        if wrong := [number for number in row if not 1 <= number <= landmarks]:
            raise ValueError(
                f"{path}: line {line} has {wrong[0]}; landmarks are 1 to {landmarks}"
            )
        if len(set(row)) < width:
            raise ValueError(f"{path}: line {line} has a landmark twice")
        numbers[at] = row
    # Neighbours of a semilandmark may be those of others.
    once = numbers[:, 1] if tuple(titles) == CURVES else numbers.ravel()
    check_once(str(path), "the file", once)
    return numbers - 1


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
    lines = numbered_lines(read_text(path))
    separator, said = find_separator([line for _, line in lines], "\t;,")
    lines = lines[said:]
    if not lines:
        raise ValueError(f"{path}: is empty; save it again")
    rows = ((number, cells_of(line, separator or ",", path)) for number, line in lines)
    return [(number, [cell.strip() for cell in cells]) for number, cells in rows]
