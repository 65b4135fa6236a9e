"""Lists of pairs: CSV files with two mesh paths, and options of the pair, on a line."""

import csv
import os
from pathlib import Path
from typing import Any, NamedTuple

from jfsf.storage._text import find_separator, read_text

# Titles of the columns of X and of Y.
_X = "x", "mesh_x", "source", "from", "a"
_Y = "y", "mesh_y", "target", "to", "b"
_WORDS = {
    **dict.fromkeys(("yes", "true", "1"), True),
    **dict.fromkeys(("no", "false", "0"), False),
}
_ORIENTATIONS = "preserve", "reverse", "any"


class PairOptions(NamedTuple):
    """Options of one pair, as of `jfsf match`; None where its line says nothing.

    orientation: "preserve", "reverse" or "any".
    largest_component: whether only the component with the largest area is matched.
    partial: whether one shape is a part of the other, or both overlap.
    repair: whether the meshes are repaired first.
    landmarks: the file of landmarks as pairs of vertices.
    landmarks_x: the file of landmarks of X.
    landmarks_y: the file of landmarks of Y.
    gt_x: the file of ground truth of X, for the report of the pair.
    gt_y: the file of ground truth of Y, for the report of the pair.
    """

    orientation: str | None = None
    largest_component: bool | None = None
    partial: bool | None = None
    repair: bool | None = None
    landmarks: Path | None = None
    landmarks_x: Path | None = None
    landmarks_y: Path | None = None
    gt_x: Path | None = None
    gt_y: Path | None = None


_FILES = "landmarks", "landmarks_x", "landmarks_y", "gt_x", "gt_y"
_COLUMNS = f"x, y, {', '.join(PairOptions._fields)}"


class Pair(NamedTuple):
    """Two meshes to match.

    x: the mesh file of X.
    y: the mesh file of Y.
    name: both paths, relative to the list's folder, joined; unique in the list.
    options: what the further columns of its line say.
    """

    x: Path
    y: Path
    name: str
    options: PairOptions = PairOptions()


def read_pairs(path: Path) -> list[Pair]:
    """The pairs of a CSV file, in order, each once.

    Args:
        path: two mesh paths on each line, relative to its own folder or absolute, with
            a comma, a semicolon or a tab between; a first line such as `sep=;` may say
            which. It is UTF-8, or UTF-16 with a byte order mark. Blank lines and lines
            that begin with # are skipped. The first line may hold titles: x and y,
            mesh_x and mesh_y, source and target, from and to, or a and b, in any order,
            and titles of further columns, the fields of `PairOptions`. Paths in these
            are relative to the folder too; yes and no may be true and false, or 1 and
            0; an empty cell leaves the choice to the options.

    Raises:
        OSError: the file cannot be read.
        ValueError: a line does not hold two paths, a title is unknown, a cell holds
            what its column cannot, there are no pairs, or two pairs would have the same
            name.
    """
    pairs, lines, columns = {}, {}, None
    for number, row in _rows(path):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#"):
            continue
        where = f"{path}: line {number}"
        if columns is None:
            columns = _columns(cells, where)
            if columns is not None:
                continue
            columns = ["x", "y"]
        found = _pair(cells, columns, path.parent, where, row)
        first = lines.setdefault(found.name, number)
        if pairs.setdefault(found.name, found) != found:
            raise ValueError(
                f"{path}: lines {first} and {number} would both be named "
                f"{found.name!r}; rename a file or folder, or leave one of them out"
            )
    if not pairs:
        raise ValueError(f"{path}: has no pairs; a line holds two mesh paths")
    return list(pairs.values())


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """The cells of each line that says something, and its number from 1."""
    lines = enumerate(read_text(path).splitlines(), 1)
    full = [(i, line) for i, line in lines if line.strip() and line.strip()[0] != "#"]
    texts = [line for _, line in full]
    # Commas first: a path may hold semicolons, as all lists with commas may.
    separator, said = find_separator(texts, "\t,;")
    try:
        cells = list(csv.reader(texts[said:], delimiter=separator or ","))
    except csv.Error as error:
        raise ValueError(f"{path}: is not a CSV file ({error})") from None
    return [(i, row) for (i, _), row in zip(full[said:], cells, strict=False)]


def _columns(cells: list[str], where: str) -> list[str] | None:
    """What each column holds, if these are titles."""
    titles = ",".join(cell.lower() for cell in cells).rstrip(",").split(",")
    named = ["x" if t in _X else "y" if t in _Y else t for t in titles]
    known = [name in ("x", "y", *PairOptions._fields) for name in named]
    # Two paths, or titles of which some are misspelt.
    if not all(known) and not {"x", "y"} <= set(named):
        return None
    if not all(known):
        unknown = cells[known.index(False)]
        raise ValueError(
            f"{where}: there is no column {unknown!r}; they are {_COLUMNS}"
        )
    if twice := [name for name in named if named.count(name) > 1]:
        raise ValueError(f"{where}: two columns are {twice[0]}; leave one out")
    if not {"x", "y"} <= set(named):
        raise ValueError(f"{where}: no column is x or none is y; name both")
    return named


def _pair(
    cells: list[str], columns: list[str], folder: Path, where: str, row: list[str]
) -> Pair:
    given = dict(zip(columns, cells, strict=False))
    x, y = given.pop("x", ""), given.pop("y", "")
    more = any(cells[len(columns) :])
    if not x or not y or more or "\0" in "".join(cells):
        few = "two mesh paths, with a comma, a semicolon or a tab between"
        hint = f"a line holds {few}; titles in the first line name further columns"
        if len(columns) > 2:
            hint = f"a line holds {', '.join(columns)}, as the first one says"
        raise ValueError(f"{where} is {','.join(row)!r}; {hint}")
    options: dict[str, Any] = {}
    for name, cell in given.items():
        if cell:
            options[name] = _option(name, cell, folder, where)
    name = "__".join(_plain(cell, folder) for cell in (x, y))
    return Pair(folder / x, folder / y, name, PairOptions(**options))


def _option(name: str, cell: str, folder: Path, where: str) -> Any:
    if name in _FILES:
        return folder / cell
    word = cell.lower()
    if name == "orientation":
        if word not in _ORIENTATIONS:
            known = ", ".join(_ORIENTATIONS)
            raise ValueError(f"{where}: {name} is {cell!r}; write one of {known}")
        return word
    if word not in _WORDS:
        raise ValueError(f"{where}: {name} is {cell!r}; write yes or no")
    return _WORDS[word]


def _plain(cell: str, folder: Path) -> str:
    """A path as part of a file name; its folders keep equal file names apart.

    Those that the path shares with the list's folder are left out.
    """
    if Path(cell).is_absolute() and cell[:1] == str(folder.absolute())[:1]:  # one drive
        cell = os.path.relpath(cell, folder.absolute())
    parts = [part for part in Path(cell).parts if part not in ("..", "/", "\\")]
    return "-".join(part.replace(":", "") for part in parts)
