"""Lists of pairs: a CSV file with two mesh paths a line."""

import csv
import os
from pathlib import Path
from typing import NamedTuple

# A first line of these words is a line of column titles, not a pair.
TITLES = {"x", "y", "mesh_x", "mesh_y", "source", "target", "from", "to", "a", "b"}


class Pair(NamedTuple):
    """Two meshes to match.

    x, y: the files.
    name: made of both paths, relative to the list's folder; unique in its list.
    """

    x: Path
    y: Path
    name: str


def read_pairs(path: Path) -> list[Pair]:
    """The pairs of a CSV file, in order, each once.

    Args:
        path: two mesh paths a line, relative to its own folder or absolute. Blank lines
            and those that begin with # are skipped, and so is a first line of titles
            (x,y or mesh_x,mesh_y or source,target, ...).

    Raises:
        OSError: the file cannot be read.
        ValueError: a line does not hold two paths, there are no pairs, or two pairs
            would have the same name.
    """
    pairs, lines = {}, {}
    try:
        text = path.read_text(encoding="utf-8-sig")
        rows = list(enumerate(csv.reader(text.splitlines()), 1))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: is not a CSV file ({error})") from None
    for number, row in rows:
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if len(cells) != 2 or not all(cells) or "\0" in "".join(cells):
            raise ValueError(
                f"{path}: line {number} is {','.join(row)!r}; a line holds two mesh "
                "paths, with a comma between"
            )
        if not lines and all(cell.lower() in TITLES for cell in cells):
            continue
        x, y = cells
        name = "__".join(_plain(cell, path.parent) for cell in (x, y))
        found = Pair(path.parent / x, path.parent / y, name)
        first = lines.setdefault(found.name, number)
        if pairs.setdefault(found.name, found) != found:
            raise ValueError(
                f"{path}: lines {first} and {number} would both be named "
                f"{found.name!r}; rename a file or folder"
            )
    if not pairs:
        raise ValueError(f"{path}: has no pairs; a line holds two mesh paths")
    return list(pairs.values())


def _plain(cell: str, folder: Path) -> str:
    """A path as part of a file name; its folders keep equal file names apart.

    Those that the path shares with the list's folder are left out.
    """
    if Path(cell).is_absolute() and cell[:1] == str(folder.absolute())[:1]:  # one drive
        cell = os.path.relpath(cell, folder.absolute())
    parts = [part for part in Path(cell).parts if part not in ("..", "/", "\\")]
    return "-".join(part.replace(":", "") for part in parts)
