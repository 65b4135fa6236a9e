"""Files that are written completely or not at all, and caches on disk.

Read in this order:

- `_atomic`: write a file completely or not at all
- `_npz`: read an array of a .npz file to its end
- `_private`: files that only this user can have written
- `_folder`: the cache folder, its limit, and what is removed from it
- `_cache`: records of arrays, kept under a digest of their inputs
"""

from jfsf.storage._atomic import (
    check_writable,
    remove_left_over,
    remove_unfinished,
    utf8,
    write_atomically,
    write_text,
)
from jfsf.storage._cache import fetch, key, store
from jfsf.storage._folder import (
    PROGRAM,
    SPECTRUM,
    StoredFile,
    folder,
    limit_bytes,
    make_room,
    mark_used,
    programs_folder,
    remove_stored,
    stored_files,
)
from jfsf.storage._npz import read_npz_array
from jfsf.storage._private import (
    NotPrivateError,
    has_owners,
    make_private,
    read_private,
    write_private,
)

__all__ = [
    "PROGRAM",
    "SPECTRUM",
    "NotPrivateError",
    "StoredFile",
    "check_writable",
    "fetch",
    "folder",
    "has_owners",
    "key",
    "limit_bytes",
    "make_private",
    "make_room",
    "mark_used",
    "programs_folder",
    "read_npz_array",
    "read_private",
    "remove_left_over",
    "remove_stored",
    "remove_unfinished",
    "store",
    "stored_files",
    "utf8",
    "write_atomically",
    "write_private",
    "write_text",
]
