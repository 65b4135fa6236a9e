"""A disk cache of records of arrays. The name of a file is a digest of its inputs."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from jfsf.storage._atomic import write_atomically
from jfsf.storage._folder import SPECTRUM, folder, limit_bytes, make_room, mark_used
from jfsf.storage._npz import read_npz_array


def key(*parts: Any) -> str:
    """A digest of arrays (shape, dtype, bytes) and plain values, in their order."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            text, data = f"array {part.shape} {part.dtype.str}", part.tobytes()
        else:
            text, data = repr(part), b""
        # The length of each text keeps the parts apart: (1, 23) is not (12, 3).
        digest.update(f"{len(text)} {text}".encode() + data)
    return digest.hexdigest()


def fetch(key: str, record: Any, compute: Callable[[], Any]) -> Any:
    """The NamedTuple `record` stored under `key`, computed and stored if need be.

    A file that cannot be read is computed again and replaced. If the folder cannot be
    written, the result is returned all the same, without being stored.

    Args:
        key: names the file; see `key`.
        record: class of NamedTuple, all its fields arrays.
        compute: gives the record; its errors pass through, and nothing is stored then.

    Raises:
        ValueError: JFSF_CACHE_LIMIT is no number above 0.
    """
    limit_bytes()  # a wrong limit is found before the work
    path = folder() / f"{key}{SPECTRUM}"
    try:
        with ZipFile(path) as file:
            found = record(*(read_npz_array(file, name) for name in record._fields))
        mark_used(path)
        return found
    except Exception:  # a damaged file makes numpy and zipfile raise nearly anything
        pass
    value = compute()
    try:
        store(path, **value._asdict())
        make_room()
    except OSError:
        pass
    return value


def store(path: Path, **arrays: Any) -> None:
    """Write an .npz with `write_atomically`, in a folder that is made if need be.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda file: np.savez(file, **arrays))
