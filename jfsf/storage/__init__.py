"""Files that are written completely or not at all, and caches on disk.

Read in this order:

- `_text`: files of text that people bring: encodings, tables, stand-ins
- `_atomic`: write a file completely or not at all
- `_npz`: read an array of a .npz file to its end
- `_private`: files that only this user can have written
- `_folder`: the cache folder, its limit, and what is removed from it
- `_cache`: records of arrays, kept under a digest of their inputs
"""

from jfsf.storage._cache import key
from jfsf.storage._folder import folder

__all__ = ["folder", "key"]
