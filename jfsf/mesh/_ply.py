"""The contents of a PLY file -> Mesh.

An ASCII body is converted to doubles in binary, so one reader does both.
"""

import re
from collections.abc import Callable

import numpy as np

from jfsf.mesh._values import MeshError, check_plain_numbers, triangulate
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


def parse_ply(data: bytes) -> Mesh:
    """Read ASCII and binary PLY of either byte order, polygons of any size.

    Raises:
        MeshError: not PLY, cut short or too long, with a header that is damaged, or
            without usable vertices or faces.
    """
    return _mesh(ply_columns(data))


def ply_columns(data: bytes) -> dict[str, dict[str, tuple[ArrayLike, ArrayLike]]]:
    """All that a file holds: {element: {property: (sizes, values)}}.

    The sizes (count,) say how many of the values belong to each record, in order.

    Raises:
        MeshError: not PLY, cut short or too long, or with a header that is damaged.
    """
    end = re.search(rb"^end_header[^\n]*\n", data, re.M)
    if not data.startswith(b"ply") or end is None:
        raise MeshError("it has no complete PLY header; export the mesh again")
    header = data[: end.start()].decode("ascii", "replace")
    encoding = re.search(r"^format (\S+)", header, re.M)
    if encoding is None or encoding[1] not in _ORDER:
        raise MeshError("its PLY header names no known format; export the mesh again")
    is_text = encoding[1] == "ascii"
    body = data[end.end() :]

    def kind(word):
        item = _ORDER[encoding[1]] + _TYPES[word]
        return "<f8" if is_text else item

    elements = _elements(header, kind)
    if is_text:
        # A lost line would shift all numbers after it, perhaps without another error.
        total = sum(count for _, count, properties in elements if properties)
        lines = sum(map(bool, map(bytes.strip, body.splitlines())))
        if lines != total:
            raise MeshError(
                f"its header announces {total} lines, but {lines} follow; "
                "export the mesh again"
            )
        check_plain_numbers(body.decode("ascii", "replace"))
        body = np.array(body.split(), "<f8").tobytes()
    at, columns = 0, {}
    for name, count, properties in elements:
        columns[name], at = _records(body, at, name, count, properties)
    if left := len(body[at:] if is_text else body[at:].strip(b"\r\n")):
        raise MeshError(
            f"its header accounts for all but the last {left} bytes; export the mesh "
            "again"
        )
    return columns


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
                    f"its header has the line {line[:60]!r}; export the mesh again"
                )
    _distinct("element", [name for name, _, _ in elements])
    for element, _, properties in elements:
        names = [name for name, _, _ in properties]
        _distinct("property", names)
        if element == "tristrips":
            raise MeshError("it holds triangle strips; export it with single faces")
        if element != "face" and not set(names).isdisjoint(CORNERS):
            raise MeshError(
                f"its element {element!r} has corners, as only 'face' may; export the "
                "mesh again"
            )
    return elements


def _distinct(what, names):
    if len(names) > len(set(names)):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise MeshError(f"it has two of {what} {twice!r}; export the mesh again")


def _mesh(columns):
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    if vertex and not vertex.keys() >= {"x", "y", "z"}:
        raise MeshError("its vertices lack x, y or z; export the mesh again")
    points = [vertex[axis][1] if vertex else np.zeros(0) for axis in "xyz"]
    names = [name for name in CORNERS if name in face]
    if face and not names:
        raise MeshError("its faces lack vertex_indices; export the mesh again")
    polygons = face[names[0]] if face else ([], [])
    return Mesh(np.stack(points, axis=1).astype(np.float64), triangulate(*polygons))


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
                "ends before the last; export the mesh again"
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
