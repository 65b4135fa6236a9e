"""The formats of map files: suffixes, first indices, arrays, keys of a match."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from jfsf.types import Certificate

# The first index of each format, by convention.
BASE = {".vts": 1, ".map": 1, ".mat": 1, ".npz": 0}
# Keys of a match file: the fields of the records.
MATCHED_KEYS = ["matched_x", "matched_y"]  # of a partial match only
# In [0, 1] a vertex, where the match has them.
VERTEX_KEYS = ["confidence_x", "confidence_y"]
MEMBERSHIP_KEYS = ["membership_x", "membership_y"]
OVERLAP_KEYS = ["overlap_x", "overlap_y"]  # of a partial match only
# Those of its info, where it is known.
INFO_KEYS = [
    *("info_sources", "info_confidence", "info_won", "info_stages", "info_seconds")
]
NOTES_KEY = "notes"  # where something is to be said of how it was made
MATCH_KEYS = ["T_xy", "T_yx", "C_yx"]
CERTIFICATE_KEYS = ["certificate_" + name for name in Certificate._fields]
# Figures that files of version 0.2 lack, or have under another name.
LATER_KEYS = {
    "certificate_mirror_gap": None,
    "certificate_spectrum_gap": None,
    "certificate_rivals": None,
    "certificate_mirrored": None,
    "certificate_recall": None,
    "certificate_log_stretch_std": "certificate_unevenness",
}
# The arrays of a file by name; each is read when it is called. In MATLAB files some are
# sparse matrices or structs.
Arrays = dict[str, Callable[[], Any]]


class MapFileError(ValueError):
    """A map file that cannot be used. The message says which, why and what to do."""


def first_index(name: str, path: Path, base: int | None) -> int:
    """`base`, or the convention of the format if it is None.

    Raises:
        MapFileError: unknown format.
        ValueError: base is neither None, 0 nor 1; `name` opens the message.
    """
    if base not in (None, 0, 1):
        raise ValueError(f"{name}: base is {base!r}, expected 0, 1 or None")
    suffix = path.suffix.lower()
    if suffix not in BASE:
        raise MapFileError(
            f"{path}: unknown format {suffix!r}; maps are {', '.join(BASE)}"
        )
    return BASE[suffix] if base is None else base
