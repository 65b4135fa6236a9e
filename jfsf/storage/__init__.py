"""Files that are written completely or not at all, and caches on disk.

Read in this order:

- `_text`: files of text that people bring: encodings, tables, stand-ins
- `_atomic`: files written completely or not at all, and arrays read to their end
- `_private`: files that only this user can have written
- `_cache`: the cache folder, its limit, and records kept under a digest of their inputs
"""

from jfsf.storage._cache import folder, key

__all__ = ["folder", "key"]
