"""A map file of any format -> its arrays, as they are stored."""

import io
import math
import struct
import warnings
import zipfile
import zlib
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse

from jfsf.apps.mapfiles._formats import Arrays, MapFileError
from jfsf.storage._atomic import read_npz_array
from jfsf.storage._text import in_utf8, instead_of_data

MOST_BYTES = 1 << 28  # of an array, decompressed: more vertices than can be matched
# Classes whose shape says nothing of their size.
_CONTAINERS = "struct", "sparse", "cell"
# A .mat file of version 5: its header, which ends with the order of bytes, then
# elements of a type, a size and so many bytes; those of this type are compressed.
_HEADER, _ORDERS, _COMPRESSED = 128, {b"IM": "<", b"MI": ">"}, 15


def read_text(path: Path) -> np.ndarray:
    """Numbers, (n,) float64, one on each line; empty lines are left out.

    Raises:
        MapFileError: missing, empty, or with lines that are not one number.
    """
    try:
        lines = in_utf8(_read_bytes(path)).decode("ascii").splitlines()
    except UnicodeDecodeError:
        raise MapFileError(f"{path}: not text; expected one index a line") from None
    values = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            # float() reads 1_0 as 10.
            values.append(float("x" if "_" in line else line))
        except ValueError:
            raise MapFileError(
                f"{path}: line {number} is {line.strip()[:40]!r}; expected one index a "
                "line"
            ) from None
    return np.array(values)


def read_npz(path: Path) -> Arrays:
    """The arrays of a `.npz` file.

    Raises:
        MapFileError: missing, empty or damaged. Reading an array raises it too, if that
            is damaged, holds objects or more than `MOST_BYTES`.
    """
    data = io.BytesIO(_read_bytes(path))
    if not zipfile.is_zipfile(data):
        raise MapFileError(f"{path}: damaged, or no .npz; write it with np.savez")
    opened = partial(_refusing, path, ".npz of plain arrays", "write it again")
    with opened(), zipfile.ZipFile(data) as file:
        sizes = {
            item.filename.removesuffix(".npy"): item.file_size
            for item in file.infolist()
        }

    def read(name):
        if sizes[name] > MOST_BYTES:
            raise MapFileError(
                f"{path}[{name}]: has {sizes[name]} bytes, above {MOST_BYTES}; write "
                "a file without it"
            )
        with opened(), zipfile.ZipFile(data) as file:
            return read_npz_array(file, name)

    return {name: partial(read, name) for name in sizes}


def read_mat(path: str | Path, most_bytes: int | None = None) -> Arrays:
    """The variables of a MATLAB file, saved with -v7 or older, by `scipy.io`.

    Each is a function of no arguments that reads it: a full matrix as numpy's, a sparse
    one as scipy's, a struct as a dict, and what holds no real numbers as an array of
    None.

    scipy trusts the types that a file declares: of files without compression a damaged
    byte there can end the process.

    Raises:
        MapFileError: missing, empty, damaged, or saved with -v7.3. Reading a variable
            raises it too, if that is damaged, or a full matrix of more than
            `most_bytes`, by default `MOST_BYTES`.
    """
    limit = MOST_BYTES if most_bytes is None else most_bytes
    data = _read_bytes(path := Path(path))
    opened = partial(_refusing, path, ".mat", "save it again with -v7")

    def read(name, shape, kind):
        number = {"double": "f8", "single": "f4"}.get(kind, kind)
        size = math.prod(shape) * np.dtype(number if "int" in kind else "f8").itemsize
        if kind not in _CONTAINERS and size > limit:
            raise MapFileError(
                f"{path}[{name}]: has {size} bytes, above {limit}; write a file "
                "without it"
            )
        with opened():
            return _plain(
                scipy.io.loadmat(io.BytesIO(data), variable_names=[name])[name]
            )

    with opened():
        _check_compressed(data)
        try:
            listed = scipy.io.whosmat(io.BytesIO(data))
        except NotImplementedError:
            raise MapFileError(
                f"{path}: saved with MATLAB's -v7.3; save it again with -v7"
            ) from None
        # Names that begin with underscores are MATLAB's own.
        return {
            name: partial(read, name, shape, kind)
            for name, shape, kind in listed
            if name[:1].isalpha()
        }


def _check_compressed(data: bytes) -> None:
    """ValueError or zlib.error for a damaged variable that was compressed.

    scipy begins with what is decompressed, before the check sum at the end.
    """
    order, at = _ORDERS.get(data[_HEADER - 2 : _HEADER]), _HEADER
    while order and at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        at += 8 + size
        if kind == _COMPRESSED:
            stream, left = zlib.decompressobj(), data[at - size : at]
            while left and not stream.eof:
                stream.decompress(left, 1 << 20)
                left = stream.unconsumed_tail
            if not stream.eof:
                raise ValueError("a variable is cut short")


def _plain(value: Any) -> Any:
    """A variable of `scipy.io.loadmat` as `read_mat` gives it."""
    if scipy.sparse.issparse(value) and value.dtype.kind in "iufb":
        found = scipy.sparse.csc_array(value)
        # The full check does not see this where the last start is 0.
        if (np.diff(found.indptr) < 0).any():
            raise ValueError("a sparse matrix has columns that end before they start")
        found.check_format()
        return found
    if type(value) is np.ndarray and value.dtype.names and value.size == 1:
        return {name: _plain(value[name].item()) for name in value.dtype.names}
    number = type(value) is np.ndarray and value.dtype.kind in "iuf"
    return value if number else np.array(None)


@contextmanager
def _refusing(path, kind, remedy):
    """Turns all errors into MapFileError: numpy and zipfile raise nearly any."""
    try:
        with warnings.catch_warnings():
            # A damaged header is read as Python text, which may warn of its syntax.
            warnings.simplefilter("ignore")
            yield
    except MapFileError:
        raise
    except Exception as error:
        why = f"{error}" or type(error).__name__
        raise MapFileError(f"{path}: damaged, or no {kind} ({why}); {remedy}") from None


def _read_bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MapFileError(f"{path}: {error.strerror}; check the path") from None
    if not data.strip():
        raise MapFileError(f"{path}: the file is empty; write or download it again")
    if found := instead_of_data(data):
        raise MapFileError(f"{path}: {'; '.join(found)}")
    return data
