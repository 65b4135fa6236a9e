"""The contents of a PLY file -> Mesh.

An ASCII body is converted to doubles in binary, so one reader does both. MeshLab writes
some values of a line without a word in the header: these are passed over.
"""

import re
from collections.abc import Callable

import numpy as np

from jfsf.mesh._polygons import triangulate
from jfsf.mesh._values import MeshError, check_plain_numbers
from jfsf.storage._text import plain_numbers
from jfsf.types import ArrayLike, Mesh

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4"},
    **{"uint": "u4", "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1"},
    **{"int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8"},
    **{"uint64": "u8", "float32": "f4", "float64": "f8"},
}
_ORDER = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = "vertex_indices", "vertex_index"  # names of the property in use

# A property: its name, the type of its length (None for a scalar) and of its items.
Property = tuple[str, str | None, str]


def parse_ply(data: bytes) -> tuple[Mesh, tuple[str, ...]]:
    """Read ASCII and binary PLY of either byte order, polygons of any size.

    Returns:
        The mesh, and what was passed over, a sentence each.

    Raises:
        MeshError: not PLY, cut short or too long, with a header that is damaged, or
            without usable vertices or faces.
    """
    columns, notes = ply_columns(data)
    return _mesh(columns), notes


def ply_columns(
    data: bytes,
) -> tuple[dict[str, dict[str, tuple[ArrayLike, ArrayLike]]], tuple[str, ...]]:
    """All that a file holds: {element: {property: (sizes, values)}}, and notes.

    The sizes (count,) say how many of the values belong to each record, in order. The
    notes are those of `parse_ply`.

    Raises:
        MeshError: not PLY, cut short or too long, or with a header that is damaged.
    """
    end = re.search(rb"^end_header[^\n]*\n", data, re.M)
    if not data.startswith(b"ply") or end is None:
        raise MeshError("it has no complete PLY header", "export the mesh again")
    header = data[: end.start()].decode("ascii", "replace")
    encoding = re.search(r"^format (\S+)", header, re.M)
    if encoding is None or encoding[1] not in _ORDER:
        raise MeshError("its PLY header names no known format", "export the mesh again")
    is_text = encoding[1] == "ascii"
    body = data[end.end() :]

    def kind(word):
        item = _ORDER[encoding[1]] + _TYPES[word]
        return "<f8" if is_text else item

    elements, notes = _elements(header, kind), ()
    if is_text:
        # A lost line would shift all numbers after it, perhaps without another error.
        total = sum(count for _, count, properties in elements if properties)
        lines = sum(map(bool, map(bytes.strip, body.splitlines())))
        if lines != total:
            raise MeshError(
                f"its header announces {total} lines, but {lines} follow",
                "export the mesh again",
            )
        text = body.decode("ascii", "replace")
        check_plain_numbers(text)
        body = body if (plain := plain_numbers(text)) is text else plain.encode()
        body, notes = _announced(body, elements)
        body = np.array(body.split(), "<f8").tobytes()
    at, columns = 0, {}
    for name, count, properties in elements:
        columns[name], at = _records(body, at, name, count, properties)
    if left := len(body[at:] if is_text else body[at:].strip(b"\r\n")):
        raise MeshError(
            f"its header accounts for all but the last {left} bytes",
            "export the mesh again",
        )
    return columns, notes


def _announced(
    body: bytes, elements: list[tuple[str, int, list[Property]]]
) -> tuple[bytes, tuple[str, ...]]:
    """The text without values at the ends of lines that the header does not name.

    All lines of an element must have equally many of these: else a value is lost or
    added somewhere, and none can be told from its neighbours.
    """
    lines = [line for line in body.splitlines() if line.strip()]
    at, notes = 0, []
    for name, count, properties in elements:
        if not properties:
            continue
        rows = lines[at : at + count]
        # Only files with such values pay for the splitting of each line. A single line
        # may as well be two that have lost the line end between them.
        words = rows[0].split() if count > 1 else []
        used = _length(words, properties)
        if 0 <= used < len(words):
            more = len(words) - used
            rows = [row.split() for row in rows]
            left = [row[: len(row) - more] for row in rows]
            for row, own in enumerate(left):
                if len(own) != _length(own, properties):
                    raise MeshError(
                        f"its lines of element {name!r} hold more values than its "
                        f"header names: {more} in the first, but not in line {row}",
                        "export the mesh again",
                    )
            lines[at : at + count] = map(b" ".join, left)
            values = "value" if more == 1 else "values"
            notes.append(
                f"its lines of element {name!r} end in {more} {values} that its header "
                "does not name; passed over"
            )
        at += count
    return (b"\n".join(lines), tuple(notes)) if notes else (body, ())


def _length(words: list[bytes], properties: list[Property]) -> int:
    """How many of these words the properties take; -1 if there are too few."""
    at = 0
    for _, size, _ in properties:
        if at >= len(words):
            return -1
        number = float(words[at]) if size else 1
        if not 0 <= number <= len(words):
            return -1
        at += int(number) + bool(size)
    return at if at <= len(words) else -1


def _elements(
    header: str, kind: Callable[[str], str]
) -> list[tuple[str, int, list[Property]]]:
    """Names, numbers of records and properties, in order.

    Nothing is passed over: what follows a lost line would be read as something else.
    """
    elements: list[tuple[str, int, list[Property]]] = []
    for line in header.splitlines():
        match line.split():
            case [] | ["ply"] | ["format" | "comment" | "obj_info", *_]:
                pass
            case ["element", name, count] if count.isdecimal():
                elements.append((name, int(count), []))
            case ["property", "list", size, item, name] if elements:
                elements[-1][2].append((name, kind(size), kind(item)))
            case ["property", item, name] if elements:
                elements[-1][2].append((name, None, kind(item)))
            case _:
                raise MeshError(
                    f"its header has the line {line[:60]!r}", "export the mesh again"
                )
    _distinct("element", [name for name, _, _ in elements])
    for element, _, properties in elements:
        names = [name for name, _, _ in properties]
        _distinct("property", names)
        if element == "tristrips":
            raise MeshError("it holds triangle strips", "export it with single faces")
        if element != "face" and not set(names).isdisjoint(CORNERS):
            raise MeshError(
                f"its element {element!r} has corners, as only 'face' may",
                "export the mesh again",
            )
    return elements


def _distinct(what, names):
    if len(names) > len(set(names)):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise MeshError(f"it has two of {what} {twice!r}", "export the mesh again")


def _mesh(columns):
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    if vertex and not vertex.keys() >= {"x", "y", "z"}:
        raise MeshError("its vertices lack x, y or z", "export the mesh again")
    points = [vertex[axis][1] if vertex else np.zeros(0) for axis in "xyz"]
    names = [name for name in CORNERS if name in face]
    if face and not names:
        raise MeshError("its faces lack vertex_indices", "export the mesh again")
    sizes, corners = face[names[0]] if face else ([], [])
    vertices = np.stack(points, axis=1).astype(np.float64)
    return Mesh(vertices, triangulate(sizes, corners, vertices))


def _records(
    body: bytes, at: int, element: str, count: int, properties: list[Property]
) -> tuple[dict[str, tuple[ArrayLike, ArrayLike]], int]:
    """{property: (sizes (count,), values (sum of sizes,))}, and the next offset."""
    if count <= 0 or not properties:
        return {}, at
    # Nearly always every list is as long as in the first record: then one dtype does.
    first, _ = _walk(body, at, element, 1, properties)
    fields = []
    for name, size, item in properties:
        fields += [(f"size of {name}", size)] if size else []
        fields.append((name, item, (int(first[name][0][0]),)))
    record = np.dtype(fields)
    if at + count * record.itemsize > len(body):
        return _walk(body, at, element, count, properties)
    table = np.frombuffer(body, record, count, at)
    columns = {}
    for name, size, _ in properties:
        sizes = np.full(count, first[name][0][0])
        if size and not np.array_equal(table[f"size of {name}"], sizes):
            return _walk(body, at, element, count, properties)
        columns[name] = sizes, table[name].ravel()
    return columns, at + count * record.itemsize


def _walk(body, at, element, count, properties):
    def take(kind, number):
        nonlocal at
        start, at = at, at + np.dtype(kind).itemsize * number
        if number < 0 or at > len(body):
            raise MeshError(
                f"its header announces {count} of element {element!r}, but the data "
                "ends before the last",
                "export the mesh again",
            )
        return np.frombuffer(body, kind, number, start)

    columns = {name: ([], []) for name, _, _ in properties}
    for _ in range(count):
        for name, size, item in properties:
            number = int(take(size, 1)[0]) if size else 1
            columns[name][0].append(number)
            columns[name][1].append(take(item, number))
    return {
        name: (np.array(sizes), np.concatenate(values))
        for name, (sizes, values) in columns.items()
    }, at
