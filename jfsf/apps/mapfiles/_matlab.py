"""MATLAB files of -v4, -v6 and -v7 -> their arrays of numbers, and structs of these.

scipy's loadmat uses the type numbers of a file as indices without a check: one damaged
byte takes the process down. So these files are read here, in Python, where a damaged
number is no key, or a length that does not fit. Arrays of real numbers are decoded,
full and sparse, and single structs; other variables are listed.

A file of -v6 or -v7 is a header of 128 bytes and an element a variable: type, length,
data. The data, which -v7 compresses, are elements again: flags, dimensions, name, real
part. In place of the last, a sparse matrix has row indices, starts of the columns and
values; a struct has the length of its names, the names, and a variable for each field.
A file of -v4 has a header of five integers before each name and real part.
"""

import math
import struct
import zlib
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array

from jfsf.apps.mapfiles._formats import Arrays

# Types of elements: of numbers, then others. Some programs write unsigned shapes.
_NUMBERS = {
    **{1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"},
    **{12: "i8", 13: "u8"},
}
_INTEGERS, _TEXT, _MATRIX, _COMPRESSED = (5, 6), (1, 16), (14,), 15
_STRUCT, _SPARSE = 2, 5  # classes
_FULL = range(6, 16)  # classes of full arrays: double, single, then integers
_COMPLEX = 0x800  # a bit of the flags
_HEAD = 1024  # bytes that hold all elements before the real part
_NUMBERS_4 = "f8", "f4", "i4", "i2", "u2", "u1"


class _Variable(NamedTuple):
    """What comes before the real part, which begins `at` that byte.

    kind: its class; None for complex numbers.
    """

    name: str
    kind: int | None
    shape: list[int]
    at: int


def parse_mat(data: bytes, most_bytes: int) -> Arrays:
    """The variables of a file by name.

    An array is numpy's, a sparse one scipy's, and a struct a dict. What is none of
    these, in a struct too, is an array that holds None.

    Args:
        data: the file.
        most_bytes: a variable that decompresses to more is refused when it is read.

    Raises:
        NotImplementedError: saved with -v7.3, which is HDF5.
        ValueError, IndexError, struct.error, zlib.error: damaged. Reading an array
            raises them too.
    """
    if 0 in data[:4]:  # in other versions these are text
        return _parse_4(data)
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("it has no header of MATLAB's")
    if struct.unpack_from(order + "H", data, 124)[0] == 0x200:
        raise NotImplementedError
    found, at = {}, 128
    while at < len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        start, end = at + 8, at + 8 + size
        if end > len(data):
            raise ValueError(f"a variable announces {size} bytes, the file is shorter")
        if kind == _COMPRESSED:
            read = partial(_decompressed, data[start:end])
        else:
            read = partial(_stored, data[at:end])
        at = end
        variable = _variable(read(_HEAD)[0], order)
        if variable.name:  # what has none is MATLAB's own
            found[variable.name] = partial(_values, read, most_bytes, variable, order)
    return found


def _stored(matrix, _):
    return matrix, True


def _decompressed(data, most_bytes):
    """The first bytes of a matrix, and whether these are all."""
    stream = zlib.decompressobj()
    return stream.decompress(data, most_bytes), stream.eof


def _variable(head, order):
    if struct.unpack_from(order + "I", head)[0] not in _MATRIX:
        raise ValueError("a variable is not a matrix")
    _, flags, at = _element(head, 8, order, _INTEGERS)
    _, shape, at = _element(head, at, order, _INTEGERS)
    _, name, at = _element(head, at, order, _TEXT)
    flags = struct.unpack_from(order + "I", flags)[0]
    kind = None if flags & _COMPLEX else flags & 0xFF
    shape = np.frombuffer(shape, order + "i4").tolist()
    return _Variable(name.decode("latin-1"), kind, shape, at)


def _values(read, most_bytes, variable, order):
    if not (variable.kind in _FULL or variable.kind in (_SPARSE, _STRUCT)):
        return np.array(None)
    matrix, ended = read(most_bytes)
    if not ended:
        raise ValueError(f"{variable.name} is cut short, or above {most_bytes} bytes")
    return _decoded(matrix, variable, order)


def _decoded(matrix, variable, order):
    if variable.kind in _FULL:
        kind, part, _ = _element(matrix, variable.at, order, _NUMBERS)
        return _shaped(part, order + _NUMBERS[kind], variable.shape)
    if variable.kind == _SPARSE:
        return _sparse(matrix, variable, order)
    if variable.kind == _STRUCT and math.prod(variable.shape) == 1:
        return _fields(matrix, variable.at, order)
    return np.array(None)


def _sparse(matrix, variable, order):
    parts, at = [], variable.at
    for kinds in (_INTEGERS, _INTEGERS, _NUMBERS):
        kind, part, at = _element(matrix, at, order, kinds)
        # scipy takes the byte order of this machine only.
        number = np.dtype(order + _NUMBERS[kind])
        parts.append(np.frombuffer(part, number).astype(number.newbyteorder("=")))
    rows, starts, values = parts
    # scipy does not see it where the last start is 0.
    if (starts[1:] < starts[:-1]).any():
        raise ValueError(f"{variable.name} has columns that end before they start")
    # There may be more room than values.
    end = min(starts.max(initial=0), len(rows), len(values))
    found = csc_array((values[:end], rows[:end], starts), shape=variable.shape)
    found.check_format()  # the indices too
    return found


def _fields(matrix, at, order):
    _, length, at = _element(matrix, at, order, _INTEGERS)
    _, names, at = _element(matrix, at, order, _TEXT)
    length = struct.unpack_from(order + "i", length)[0]
    if length < 1:
        raise ValueError(f"names of fields have {length} bytes")
    found = {}
    for start in range(0, len(names), length):
        name = names[start : start + length].split(b"\0")[0].decode("latin-1")
        size = struct.unpack_from(order + "I", matrix, at + 4)[0]
        part, at = matrix[at : at + 8 + size], at + 8 + size
        if len(part) < 8 + size:
            raise ValueError(f"the field {name} is cut short")
        # An empty field may have no data.
        empty = np.zeros((0, 0))
        found[name] = _decoded(part, _variable(part, order), order) if size else empty
    return found


def _element(data, at, order, kinds):
    """Type, which must be among `kinds`, bytes and end of the element at an offset."""
    kind, size = struct.unpack_from(order + "II", data, at)
    start, end = at + 8, at + 8 + size + -size % 8
    if kind >> 16:  # a small one: length and type in a word, then up to four bytes
        kind, size, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
    part = data[start : start + size]
    if kind not in kinds:
        raise ValueError(f"an element is of type {kind}")
    if len(part) < size or start + size > end:
        raise ValueError(f"an element of {size} bytes is cut short")
    return kind, part, end


def _shaped(part, number, shape):
    size = math.prod(shape) * np.dtype(number).itemsize
    if min(shape, default=0) < 0 or size != len(part):
        raise ValueError(f"an array of shape {tuple(shape)} has {len(part)} bytes")
    return np.frombuffer(part, number).reshape(shape, order="F")


def _parse_4(data):
    # The first number is below 5000 in the right byte order.
    order = "<" if struct.unpack_from("<I", data)[0] < 5000 else ">"
    found, at = {}, 0
    while at < len(data):
        kind, *shape, is_complex, length = struct.unpack_from(order + "5i", data, at)
        if kind // 1000 != (order == ">"):
            raise ValueError(f"a variable is of type {kind}")
        number = order + _NUMBERS_4[kind % 1000 // 10]
        start = at + 20 + length
        name = data[at + 20 : start].rstrip(b"\0").decode("latin-1")
        size = math.prod(shape) * np.dtype(number).itemsize
        end = start + size * (2 if is_complex else 1)
        if min(*shape, length) < 0 or end > len(data):
            raise ValueError(f"a variable of shape {tuple(shape)} is cut short")
        if kind % 10 or is_complex:
            found[name] = lambda: np.array(None)
        else:
            found[name] = partial(_shaped, data[start : start + size], number, shape)
        at = end
    return found
