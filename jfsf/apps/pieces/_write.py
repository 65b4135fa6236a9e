"""Matched pieces -> a file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jfsf._figures import FIGURES
from jfsf.apps.mapfiles import MapFileError
from jfsf.apps.pieces._match import MatchedComponents
from jfsf.storage._atomic import write_atomically


def write_components(
    path: str | Path, found: MatchedComponents, *, notes: Sequence[str] = ()
) -> None:
    """Write what `match_components` returns as `.npz`.

    The file has T_xy and T_yx (int32, 0-based, -1 for a vertex without a partner),
    pair_x and pair_y (the number of its pair for each vertex, -1 likewise),
    confidence_x and confidence_y (nan likewise), and for each pair pair_margin and
    pair_NAME for each figure of the certificate, such as pair_confidence.
    `jfsf.apps.mapfiles.read_stored` reads it. It appears complete or not at all.

    Args:
        path: `.npz`.
        found: the result.
        notes: sentences on how it was made, for `jfsf.apps.mapfiles.read_notes`.

    Raises:
        MapFileError: the suffix is not `.npz`, or a folder that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise MapFileError(f"{path}: pieces are written as .npz, not {path.suffix!r}")
    arrays = {name: getattr(found, name) for name in found._fields[:4]}
    for side in "xy":
        values = np.full(len(arrays[f"pair_{side}"]), np.nan)
        for pair in found.pairs:
            own = getattr(pair.match, f"confidence_{side}")
            if own is not None:
                values[getattr(pair, side).index] = np.asarray(own)
        arrays[f"confidence_{side}"] = values
    arrays["pair_margin"] = np.array([pair.margin for pair in found.pairs])
    for name in FIGURES:
        figures = [np.asarray(getattr(p.match.certificate, name)) for p in found.pairs]
        arrays[f"pair_{name}"] = np.array(figures)
    if notes:
        arrays["notes"] = np.array(list(notes))
    try:
        write_atomically(path, lambda file: np.savez_compressed(file, **arrays))
    except OSError as error:
        raise MapFileError(
            f"{path}: cannot be written ({error.strerror}); check the folder"
        ) from None
