"""A disk cache of array records: content-keyed, atomic, and safe to delete.

Files live in the user's cache folder, or where JFSF_CACHE points.
"""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs


def folder() -> Path:
    """Where cached records live: $JFSF_CACHE, or the platform's cache folder."""
    return Path(os.environ.get("JFSF_CACHE") or platformdirs.user_cache_dir("jfsf"))


def key(*parts: Any) -> str:
    """A digest of arrays (shape, dtype, bytes) and plain values."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.shape}{part.dtype}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()


def fetch(key: str, record: Any, compute: Callable[[], Any]) -> Any:
    """The NamedTuple `record` stored under `key`, computed and stored if need be.

    A file that cannot be read is computed again; a folder that cannot be written is
    done without.
    """
    path = folder() / f"{key}.npz"
    try:
        with np.load(path) as file:
            return record(*(file[name] for name in record._fields))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        pass
    value = compute()
    try:
        store(path, **value._asdict())
    except OSError:
        pass
    return value


def store(path: Path, **arrays: Any) -> None:
    """Write an .npz under a temporary name, then rename it: whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
