"""Plain point clouds -> Mesh: text with a point a line, and arrays of numpy."""

import io
import math

import numpy as np

from jfsf.mesh._values import MeshError, check_plain_numbers
from jfsf.types import Mesh

_COMMENTS = "#", "//"
# By the version of the file. Version 3 is only for fields with names beyond ASCII.
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def parse_xyz(data: bytes) -> Mesh:
    """Read lines that begin with x, y and z; what follows, such as normals, is dropped.

    Blanks, commas or semicolons stand between the numbers, the same number of them on
    every line. A line that begins with # or // is a comment. A first line with the
    number of points, or with titles that begin with x, y, z, is passed over.

    Raises:
        MeshError: lines of different lengths, words instead of numbers, or decimal
            commas.
    """
    text = data.removeprefix(b"\xef\xbb\xbf").decode("ascii", "replace")
    rows, numbers = [], []
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if line and not line.startswith(_COMMENTS):
            numbers.append(number)
            rows.append(_words(line, number))
    if rows and _is_head(rows):
        del rows[0], numbers[0]
    for number, row in zip(numbers, rows, strict=True):
        if len(row) < 3:
            raise MeshError(f"line {number} is {' '.join(row)!r}, not x y z")
        if len(row) != len(rows[0]):
            raise MeshError(
                f"line {number} has {len(row)} numbers, and the first point "
                f"{len(rows[0])}",
                "export it again",
            )
    try:
        check_plain_numbers(text)
        points = np.array([row[:3] for row in rows], np.float64)
    except ValueError as error:
        raise MeshError(
            f"it is no list of points ({error})", "write x y z a line"
        ) from (None)
    return Mesh(points.reshape(-1, 3), np.zeros((0, 3), np.int64))


def _words(line: str, number: int) -> list[str]:
    """The numbers of a line as words."""
    if "," in line:
        words = [word.strip(",") for word in line.replace(";", " ").split()]
        if len(words) > 1 and any("," in word for word in words):
            raise MeshError(
                f"line {number} is {line[:40]!r}, with commas inside of numbers",
                "write decimal points",
            )
    return line.replace(",", " ").replace(";", " ").split()


def _is_head(rows: list[list[str]]) -> bool:
    first = [word.lower().strip('"') for word in rows[0]]
    count = len(first) == 1 and first[0].isdecimal() and int(first[0]) == len(rows) - 1
    return count or first[:3] == ["x", "y", "z"]


def parse_npy(data: bytes) -> Mesh:
    """Read an array (n, 3) of real numbers that numpy saved.

    Raises:
        MeshError: another array, or fewer or more bytes than it announces.
    """
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in _HEADERS:
        raise MeshError(f"it is of version {version}", "save it with numpy.save")
    shape, in_columns, kind = _HEADERS[version](stream)
    if kind.kind not in "fiu" or len(shape) != 2 or shape[1] != 3:
        raise MeshError(f"it holds {kind} {shape}", "save real numbers (n, 3)")
    body = data[stream.tell() :]
    if (size := math.prod(shape) * kind.itemsize) != len(body):
        raise MeshError(
            f"its header announces {size} bytes, but {len(body)} follow",
            "save it again",
        )
    points = np.frombuffer(body, kind).reshape(shape, order="F" if in_columns else "C")
    return Mesh(points.astype(np.float64), np.zeros((0, 3), np.int64))
