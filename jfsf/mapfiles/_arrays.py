"""A map file of any format -> its arrays, as they are stored."""

import io
import zipfile
import zlib
from pathlib import Path

import numpy as np
import scipy.io

from jfsf.mapfiles._formats import MapFileError


def read_text(path: Path) -> np.ndarray:
    """Numbers, (n,) float64, one a line; empty lines are left out.

    Raises:
        MapFileError: missing, empty, or with lines that are not one number.
    """
    try:
        lines = _read_bytes(path).decode("ascii").splitlines()
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


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a `.npz` file.

    Raises:
        MapFileError: missing, empty, damaged, or with arrays of objects.
    """
    # Read from memory, as np.load does not close a damaged file.
    data = io.BytesIO(_read_bytes(path))
    if not zipfile.is_zipfile(data):
        raise MapFileError(f"{path}: damaged, or no .npz; write it with np.savez")
    data.seek(0)
    try:
        with np.load(data, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise MapFileError(
            f"{path}: damaged, or no .npz of plain arrays ({error}); write it again"
        ) from None


def read_mat(path: Path) -> dict[str, np.ndarray]:
    """The variables of a MATLAB file, saved with -v7 or older.

    Raises:
        MapFileError: missing, empty, damaged, or saved with -v7.3.
    """
    data = io.BytesIO(_read_bytes(path))
    try:
        found = scipy.io.loadmat(data)
    except NotImplementedError:
        raise MapFileError(
            f"{path}: saved with MATLAB's -v7.3; save it again with -v7"
        ) from None
    # A damaged file makes scipy raise errors of many types.
    except Exception as error:
        raise MapFileError(
            f"{path}: damaged, or no .mat ({error}); save it again with -v7"
        ) from None
    return {name: value for name, value in found.items() if name[:2] != "__"}


def _read_bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MapFileError(f"{path}: {error.strerror}; check the path") from None
    if not data.strip():
        raise MapFileError(f"{path}: the file is empty; write or download it again")
    return data
