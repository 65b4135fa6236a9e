"""Files of what is carried: values and labels as numbers or text, and images."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jfsf.apps.transfer._parts import parts_text, read_parts
from jfsf.storage._atomic import write_atomically, write_text
from jfsf.storage._text import find_separator, plain_numbers, read_text
from jfsf.types import ArrayLike

FORMATS = ".npy", ".csv", ".txt"
# Labels also as the Princeton benchmark's of faces, and as SMPL's parts of vertices.
LABEL_FORMATS = *FORMATS, ".seg", ".json"


class Column(NamedTuple):
    """What a file has for each vertex or face.

    rows: (n, ...) numbers, or names.
    titles: of its columns; () if it has none.
    """

    rows: ArrayLike
    titles: tuple[str, ...] = ()


def check_format(path: Path, formats: tuple[str, ...] = FORMATS) -> None:
    """ValueError if these are not read and written with this suffix."""
    if path.suffix.lower() not in formats:
        what = "values" if formats == FORMATS else "labels"
        raise ValueError(
            f"{path}: {what} are {', '.join(formats)}, not {path.suffix!r}"
        )


def read_values(path: Path, n: int) -> Column:
    """Numbers of the n vertices of a mesh.

    Args:
        path: `.npy`, (n,) or (n, d); `.csv` or `.txt`, a line for each vertex with d
            numbers between commas, semicolons, tabs or blanks. Its first line may hold
            titles. An empty cell, or nan, is a number that is not known; of one column
            an empty line, if there are as many lines as vertices.
        n: vertices to expect.

    Returns:
        (n,) or (n, d) float64.

    Raises:
        ValueError: another format or number of rows, or something that is no number.
        OSError: the file cannot be read.
    """
    check_format(path)
    rows, titles = _table(path, (n,), _numbers)
    if rows.dtype.kind not in "fiub" or rows.ndim not in (1, 2) or len(rows) != n:
        raise ValueError(
            f"{path}: is {rows.dtype} {rows.shape}; expected numbers ({n},) or "
            f"({n}, d), one row a vertex"
        )
    return Column(rows.astype(np.float64), titles)


def read_labels(path: Path, n: int, m: int) -> Column:
    """Labels of the n vertices or the m faces of a mesh.

    Args:
        path: `.npy` of whole numbers or names; `.csv` of one column, or `.txt` or
            `.seg`, a label on each line. They are numbers if all of them are. The
            first line is a title if there is one more than there should be. Or `.json`,
            a list of vertices for the name of each part, as SMPL's: a vertex in several
            parts has the first of them, one in none the name "".
        n, m: vertices and faces; as many labels are expected.

    Returns:
        (n,) or (m,) int64 or str.

    Raises:
        ValueError: another format or number of labels, or fractions.
        OSError: the file cannot be read.
    """
    check_format(path, LABEL_FORMATS)
    if path.suffix.lower() == ".json":
        return Column(read_parts(path, n))
    rows, titles = _table(path, (n, m), _words)
    if rows.ndim == 2 and rows.shape[1] == 1:
        rows = rows[:, 0]
    if rows.ndim != 1 or len(rows) not in (n, m):
        raise ValueError(
            f"{path}: has {' x '.join(map(str, rows.shape))} labels, expected one for "
            f"each of {n} vertices or of {m} faces"
        )
    if rows.dtype.kind == "f":
        whole = np.isfinite(rows) & (rows == np.floor(rows)) & (np.abs(rows) < 2**53)
        if not whole.all():
            at = int(np.argmin(whole))
            raise ValueError(
                f"{path}: label {at + 1} is {rows[at]}, not a whole number; carry "
                "numbers that are no labels as values"
            )
        rows = rows.astype(np.int64)
    if rows.dtype.kind not in "iubU":
        raise ValueError(f"{path}: holds {rows.dtype}; expected whole numbers or names")
    return Column(rows, titles)


def write_column(path: Path, column: Column) -> None:
    """Write values or labels; the file appears complete or not at all.

    Args:
        path: `.npy`, `.csv` (with commas) or `.txt` (with blanks); of labels also
            `.seg`, and `.json` of those of vertices, without "" and -1.
        column: numbers or names, and their titles.

    Raises:
        ValueError: another suffix.
        OSError: the file cannot be written.
    """
    rows = np.asarray(column.rows)
    is_labels = rows.ndim == 1 and rows.dtype.kind != "f"
    check_format(path, LABEL_FORMATS if is_labels else FORMATS)
    suffix = path.suffix.lower()
    if suffix == ".json":
        write_text(path, parts_text(rows))
        return
    if suffix == ".npy":
        write_atomically(path, lambda file: np.save(file, rows, allow_pickle=False))
        return
    form = "%.9g" if rows.dtype.kind == "f" else "%s"
    lines = [[form % cell for cell in np.atleast_1d(row)] for row in rows]
    if column.titles and suffix != ".seg":
        lines.insert(0, list(column.titles))
    if suffix == ".csv":
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(lines)
        write_text(path, text.getvalue())
    else:
        write_text(path, "".join(" ".join(line) + "\n" for line in lines))


def _table(path: Path, counts: tuple[int, ...], convert: Callable) -> Column:
    """The rows of a file; `convert` makes an array of lines of text."""
    if path.suffix.lower() == ".npy":
        try:
            rows = np.load(path, allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise ValueError(
                f"{path}: is no array of numbers or names ({error}); write it with "
                "numpy.save"
            ) from None
        if not isinstance(rows, np.ndarray):
            raise ValueError(f"{path}: holds several arrays; write one with numpy.save")
        return Column(rows)
    text = read_text(path)
    # Not splitlines, which also splits at rarer characters that names may hold.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not lines[-1]:
        lines.pop()  # it was ended by the last line break
    # Then the separator is found again in the titles or the numbers.
    lines = lines[find_separator(lines, "")[1] :]
    full = max((i for i, line in enumerate(lines, 1) if line.strip()), default=0)
    if full == 0:
        raise ValueError(f"{path}: is empty; expected a line a vertex")
    # Empty lines at the end mean nothing, unless they are needed: a label may be empty.
    titled = full not in counts and len(lines) - 1 in counts
    if len(lines) not in counts and not titled:
        lines = lines[:full]
    return convert(path, lines, counts)


def _by_csv(path: Path, lines, separator: str) -> list[list[str]]:
    try:
        return list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise ValueError(f"{path}: {error}; save it again") from None


def _cells(path: Path, lines, counts) -> list[list[str]]:
    full = [line for line in lines if line.strip()]
    if separator := find_separator(full, "\t;,")[0]:
        return _by_csv(path, full, separator)
    rows = [line.split() for line in full]
    if len(rows) not in counts and max(map(len, rows)) == 1:
        return [line.split() or [""] for line in lines]
    return rows


def _numbers(path: Path, lines, counts) -> Column:
    rows, titles = _cells(path, lines, counts), ()
    if any(_number(cell) is None for cell in rows[0]):
        titles, rows = tuple(cell.strip() for cell in rows[0]), rows[1:]
    if len(rows) not in counts:
        raise ValueError(
            f"{path}: has {len(rows)} rows of numbers, expected {counts[0]}, one a "
            "vertex"
        )
    wide = len(rows[0])
    for number, cells in enumerate(rows, 1 + bool(titles)):
        if len(cells) != wide or any(_number(cell) is None for cell in cells):
            raise ValueError(
                f"{path}: line {number} is {' '.join(cells)[:60]!r}, expected {wide} "
                "numbers"
            )
    found = np.array([[_number(cell) for cell in cells] for cells in rows], float)
    return Column(found[:, 0] if wide == 1 else found, titles)


def _words(path: Path, lines, counts) -> Column:
    if path.suffix.lower() == ".csv":
        table, titles = _by_csv(path, lines, ","), ()
        for number, cells in enumerate(table, 1):
            if len(cells) > 1:
                raise ValueError(
                    f"{path}: line {number} has {len(cells)} cells, expected one "
                    "label; save that column alone, names that hold commas in quotes"
                )
        rows = [cells[0].strip() if cells else "" for cells in table]
    else:
        rows, titles = [_unquoted(line.strip()) for line in lines], ()
    if len(rows) not in counts and len(rows) - 1 in counts:
        titles, rows = (rows[0],), rows[1:]
    if any(_number(row) is None or not row for row in rows):
        return Column(np.array(rows, str), titles)
    try:
        return Column(np.array([int(row) for row in rows], np.int64), titles)
    except (ValueError, OverflowError):
        return Column(np.array([_number(row) for row in rows], float), titles)


def _unquoted(word: str) -> str:
    return word[1:-1] if len(word) > 1 and word[0] == word[-1] == '"' else word


def _number(cell: str) -> float | None:
    cell = plain_numbers(cell.strip())
    if cell.lower() in ("", "nan", "na"):
        return np.nan
    try:
        # float() takes 1_0 for 10.
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def read_image(path: Path) -> ArrayLike:
    """The pixels of an image.

    Args:
        path: PNG, JPEG or whatever Pillow reads.

    Returns:
        (h, w, 3) uint8, or (h, w, 4) if it has transparency; the first row at the top.

    Raises:
        ImportError: Pillow is not installed.
        ValueError: no image, or one of more than 8 bits a channel.
        OSError: the file cannot be read.
    """
    pillow = _pillow()
    data = Path(path).read_bytes()
    try:
        with pillow.open(io.BytesIO(data)) as image:
            mode = image.mode
            clear = mode in ("RGBA", "LA", "PA") or "transparency" in image.info
            pixels = np.asarray(image.convert("RGBA" if clear else "RGB"))
    except Exception as error:
        # Pillow has errors of its own for each format.
        raise ValueError(
            f"{path}: is not a readable image ({type(error).__name__}); save it as PNG"
        ) from None
    if mode.startswith(("I", "F")):  # which were clipped
        raise ValueError(f"{path}: has more than 8 bits a channel; save it with 8 bits")
    return pixels


def png_of(image: ArrayLike) -> bytes:
    """The PNG file of pixels (h, w, 1, 3 or 4) uint8.

    Raises:
        ImportError: Pillow is not installed.
    """
    pillow, file = _pillow(), io.BytesIO()
    pixels = np.ascontiguousarray(image)
    if pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    pillow.fromarray(pixels).save(file, "png", optimize=False)
    return file.getvalue()


def _pillow():
    try:
        from PIL import Image
    except ImportError:
        raise ImportError("textures need Pillow: pip install 'jfsf[texture]'") from None
    return Image
