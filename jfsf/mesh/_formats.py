"""The contents of a file -> Mesh: OFF, OBJ, STL, text with a point a line, and .npy.

Vertex i of the file must be vertex i of the map. trimesh 5.2 keeps to that only for
glTF, even with `process=False, maintain_order=True`. So the other formats are parsed
here and in `_ply`. Its faults:
- OFF and ASCII PLY: a file cut short loads without an error; with fewer vertices than
  announced, OFF takes the first face for a vertex; 4OFF loads as OFF; polygons are
  sorted by size, and faces of two vertices vanish.
- OBJ: vertices are split at texture and normal seams, copied for every material and
  dropped where textured faces do not use them; negative indices count back from the
  end of the file.
- PLY: split at texture seams; binary files that mix triangles and quads are refused.
- STL: an ASCII file cut short loads as empty, a binary one needs charset_normalizer.
"""

import io
import math
import re

import numpy as np

from jfsf.mesh._edit import weld
from jfsf.mesh._polygons import triangulate
from jfsf.mesh._values import MeshError, check_plain_numbers
from jfsf.storage._text import plain_numbers
from jfsf.types import ArrayLike, Mesh

_COMMENTS = "#", "//"
# By the version of the file. Version 3 is only for fields with names beyond ASCII.
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def parse_off(data: bytes) -> Mesh:
    """Read OFF, with or without colours (C), normals (N) or texture (ST).

    Raises:
        MeshError: not OFF, binary or 4D OFF, or other counts than announced.
    """
    text = [line.split("#", 1)[0] for line in text_of(data).splitlines()]
    lines = [line.split() for line in text if line.strip()] or [[""]]
    if len(lines[0]) in (2, 3) and all(map(str.isdecimal, lines[0])):
        lines.insert(0, ["OFF"])  # the format allows to leave it out
    keyword = off_keyword(lines[0][0])
    if keyword is None:
        raise MeshError(
            f"it starts with {lines[0][0][:20]!r}, not OFF", "export it again"
        )
    if keyword[2] or lines[0][1:2] == ["BINARY"]:
        raise MeshError(
            f"it is {' '.join(lines[0][:2])}", "export it as ASCII OFF in 3D"
        )
    head, body = [keyword[3]] * bool(keyword[3]) + lines[0][1:], lines[1:]
    if not head:
        head, body = body[0] if body else [], body[1:]
    n, m = (int(count) if count.isdecimal() else -1 for count in (*head, "", "")[:2])
    if min(n, m) < 0:
        raise MeshError(f"its counts are {' '.join(head)[:40]!r}", "export it again")
    if len(body) != n + m:
        raise MeshError(
            f"its header announces {n} vertices and {m} faces, but {len(body)} "
            f"lines follow instead of {n + m}",
            "export it again",
        )
    check_plain_numbers("\n".join(text))
    sizes, corners = [], []
    for face, row in enumerate(body[n:]):
        size = int(row[0])
        if len(row) <= size:
            raise MeshError(
                f"face {face} is cut short to {' '.join(row)!r}", "export it again"
            )
        sizes.append(size)
        corners += map(int, row[1 : 1 + size])
    vertices = _coordinates(body[:n])
    return Mesh(vertices, triangulate(sizes, corners, vertices))


def parse_obj(data: bytes) -> Mesh:
    """Read the v and f lines of OBJ; texture and normal seams do not split vertices.

    Raises:
        MeshError: a vertex with fewer than three coordinates, a face with fewer than
            three corners, index 0, or a negative index before the first vertex.
    """
    rows, sizes, corners = [], [], []
    text = text_of(data).replace("\r\n", "\n").replace("\\\n", " ")
    for line in text.splitlines():
        word, *rest = line.split("#", 1)[0].split() or [""]
        if word in ("v", "f"):
            check_plain_numbers(" ".join(rest))
        if word == "v":
            rows.append(rest)
        elif word == "f":
            sizes.append(len(rest))
            # 1-based; -1 is the last vertex so far.
            here = [int(corner.split("/", 1)[0]) for corner in rest]
            corners += [i - 1 if i > 0 else len(rows) + i for i in here]
            if 0 in here or min(here, default=0) < -len(rows):
                raise MeshError(
                    f"face {len(sizes) - 1} is {line.strip()!r} after {len(rows)} "
                    "vertices, and OBJ counts from 1 or back from -1",
                    "export it again",
                )
    vertices = _coordinates(rows)
    return Mesh(vertices, triangulate(sizes, corners, vertices))


def parse_stl(data: bytes) -> Mesh:
    """Read ASCII and binary STL, which repeats every corner: equal points are merged.

    Vertices come in the order in which the triangles first name them.

    Raises:
        MeshError: a file cut short.
    """
    count = int.from_bytes(data[80:84], "little")
    # Binary files may start with "solid" too, so the size decides: the count of a text
    # file, read as a number, is larger than any file.
    if len(data) >= 84 and count == 0:
        more = f", but {len(data) - 84} bytes follow" if len(data) > 84 else ""
        raise MeshError(
            f"it is a binary STL whose header announces 0 triangles{more}",
            "export it again",
        )
    if len(data) >= 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("xyz", "<f4", (3, 3)), ("", "<u2")])
        points = np.frombuffer(data, record, count, 84)["xyz"].reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        pattern = r"(?im)^\s*(?:vertex|endfacet|endsolid)\b[^\r\n]*"
        words = [line.split() for line in re.findall(pattern, text_of(data))]
        if not words or words[-1][0].lower() != "endsolid":
            raise MeshError("its last endsolid is missing", "export it again")
        corners = [word[1:] for word in words if word[0].lower() == "vertex"]
        check_plain_numbers(" ".join(map(" ".join, corners)))
        points = _coordinates(corners)
    else:
        raise MeshError(
            f"its header announces {count} triangles in {84 + 50 * count} bytes, "
            f"but it has {len(data)}",
            "export it again",
        )
    if len(points) % 3:
        raise MeshError(f"its {len(points)} corners are not triples", "export it again")
    faces = np.arange(len(points)).reshape(-1, 3)
    return weld(Mesh(points.astype(np.float64), faces)).mesh


def off_keyword(word: str) -> re.Match[str] | None:
    """The keyword of OFF: what a vertex has, "4" or "n" if it is not 3D, and a number.

    Colours (C), normals (N) and texture (ST) in any order: MeshLab writes NC, others
    CN.
    ModelNet writes the counts without a space after the keyword: OFF490 518 0.
    """
    return re.fullmatch(r"((?:ST|C|N)*)(4?n?)OFF(\d*)", word)


def text_of(data: bytes) -> str:
    """The text of a file; `plain_numbers`, of which some hold a # as comments do."""
    # Only names and comments hold characters beyond ASCII.
    return plain_numbers(data.decode("ascii", "replace"))


def _coordinates(rows: list) -> ArrayLike:
    short = next((i for i, row in enumerate(rows) if len(row) < 3), None)
    if short is not None:
        raise MeshError(
            f"vertex {short} has {len(rows[short])} coordinates", "export it again"
        )
    return np.array([row[:3] for row in rows], np.float64).reshape(-1, 3)


def parse_xyz(data: bytes) -> Mesh:
    """Read lines that begin with x, y and z; what follows, such as normals, is dropped.

    Blanks, commas or semicolons stand between the numbers, the same number of them on
    every line. A line that begins with # or // is a comment. A first line with the
    number of points, or with titles that begin with x, y, z, is passed over.

    Raises:
        MeshError: lines of different lengths, words instead of numbers, or decimal
            commas.
    """
    text = text_of(data)
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
        what = f"it is no list of points ({error})"
        raise MeshError(what, "write x y z a line") from None
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
