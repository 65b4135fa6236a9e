"""Files that are written completely or not at all, and caches on disk.

Read in this order:

- `_atomic`: write a file completely or not at all
- `_npz`: read an array of a .npz file to its end
- `_cache`: records of arrays, kept under a digest of their inputs
- `_programs`: compile programs early, and keep them on disk
"""

from jfsf.storage._atomic import (
    check_writable,
    remove_unfinished,
    write_atomically,
    write_text,
)
from jfsf.storage._cache import fetch, folder, key, store
from jfsf.storage._npz import read_npz_array
from jfsf.storage._programs import Program, compile_ahead, large_jit

__all__ = [
    "Program",
    "check_writable",
    "compile_ahead",
    "fetch",
    "folder",
    "key",
    "large_jit",
    "read_npz_array",
    "remove_unfinished",
    "store",
    "write_atomically",
    "write_text",
]
