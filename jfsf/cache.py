"""A disk cache of array records: content-keyed, atomic, and safe to delete.

Files live in the user's cache folder, or where JFSF_CACHE points.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs


def folder() -> Path:
    """Where cached records live: $JFSF_CACHE, or the platform's cache folder."""
    return Path(os.environ.get("JFSF_CACHE") or platformdirs.user_cache_dir("jfsf"))


def key(*parts: Any) -> str:
    """A digest of arrays (shape, dtype, bytes) and plain values, in their order."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            text, data = f"array {part.shape} {part.dtype.str}", part.tobytes()
        else:
            text, data = repr(part), b""
        # With the length of each text, no two lists of parts read the same.
        digest.update(f"{len(text)} {text}".encode() + data)
    return digest.hexdigest()


def fetch(key: str, record: Any, compute: Callable[[], Any]) -> Any:
    """The NamedTuple `record` stored under `key`, computed and stored if need be.

    A file that cannot be read is computed again and replaced; a folder that cannot be
    written is done without.

    Args:
        key: names the file; see `key`.
        record: class of NamedTuple, all its fields arrays.
        compute: gives the record; what it raises passes through, and nothing is stored.
    """
    path = folder() / f"{key}.npz"
    try:
        # numpy leaves the file open when it finds it damaged.
        with path.open("rb") as raw, np.load(raw) as file:
            return record(*(file[name] for name in record._fields))
    except Exception:  # a damaged file makes numpy and zipfile raise nearly anything
        pass
    value = compute()
    try:
        store(path, **value._asdict())
    except OSError:
        pass
    return value


def store(path: Path, **arrays: Any) -> None:
    """Write an .npz under a temporary name, then rename it: whole or not at all.

    Raises:
        OSError: the folder cannot be made or written; the temporary file is gone.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
