"""Files that are written completely or not at all, and caches on disk.

Read in this order:

- `_text`: files of text that people bring: encodings, tables, stand-ins
- `_atomic`: files written completely or not at all, and arrays read to their end
- `_cache`: the cache folder: its limit, records under a digest, and private files
"""

from jfsf.storage._cache import folder, key

__all__ = ["folder", "key"]
