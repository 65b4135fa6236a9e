"""A look at the meshes of a collection: what is unfit, why, and what mends it.

Files are looked at before any work. What shows only beside the others, such as another
unit, is said once all can be read, before pairs are matched. A mirror image shows only
when it is matched.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jfsf.apps.cli._files import Shape, matchable
from jfsf.apps.cli._print import said

_LARGEST, _REPAIR = "--largest-component", "--repair"


class Unfit(NamedTuple):
    """A file that cannot be matched.

    why: a sentence that begins with its name.
    options: with which it can be; () if there are none.
    """

    why: str
    options: tuple[str, ...] = ()


def unfit(path: Path, largest: bool, mend: bool) -> Unfit | None:
    """Why a file cannot be matched, and what mends it; None if it can.

    Args:
        path: of a mesh.
        largest, mend: the options that are given, as `matchable` takes them.
    """
    # As it is first: most files are whole, and a repair takes longer than a look.
    found = _tried(path, False, False)
    if isinstance(found, Exception) and (largest or mend):
        found = _tried(path, largest, mend)
    if not isinstance(found, Exception):
        return None
    kept, ways = -1, [(True, False), (False, True), (True, True)]
    best = Unfit(said(found))
    for way in ((largest or one, mend or other) for one, other in ways):
        mended = None if way == (largest, mend) else _tried(path, *way)
        # Where seams are open the largest piece is one triangle: a repair keeps more.
        if isinstance(mended, Shape) and len(mended.mesh.vertices) > kept:
            kept = len(mended.mesh.vertices)
            asked = zip((_LARGEST, _REPAIR), way, (largest, mend), strict=True)
            options = tuple(name for name, now, given in asked if now and not given)
            does = ", ".join(mended.said).removeprefix(f"{_LARGEST} ")
            what = getattr(found, "what", said(found))
            why = f"{path}: {what}; {' '.join(options)} mends it: {does}"
            best = Unfit(why, options)
    return best


def _tried(path: Path, largest: bool, mend: bool) -> Shape | Exception:
    from jfsf.apps.collections._collection import check_surface

    try:
        shape = matchable(path, largest, mend)
        check_surface(shape.mesh, str(path))
    except Exception as error:  # as in jobs: one file does not end the run
        return error
    return shape


def doubts(names: Sequence[str], shapes: Iterable) -> list[str]:
    """What is odd about some shapes beside the others, a sentence each.

    Sizes are compared to the median, rims too; spectra to that of the most alike shape.

    Args:
        names: of the shapes.
        shapes: what is kept of each (`Kept`).
    """
    from jfsf.matching._arguments import TWO_UNITS
    from jfsf.matching._confidence import UNLIKE
    from jfsf.matching.parts._surfaces import LONG_LOOP, longest_loop
    from jfsf.mesh import surface_area

    areas, rims, signatures = [], [], []
    for own in shapes:  # one at a time: there may be many
        areas.append(float(surface_area(own.mesh)))
        rims.append(longest_loop(own.mesh))
        signatures.append(own.sketch.signature)
    size, rim, apart, found = np.sqrt(areas), np.array(rims), _apart(signatures), []
    for i, name in enumerate(names):
        factor = size[i] / np.median(size)
        if max(factor, 1 / factor) > TWO_UNITS:
            times = f"{max(factor, 1 / factor):.3g} times as "
            times += "large" if factor > 1 else "small"
            found.append(
                f"{name}: is {times} as the median of all: is it in another unit? Maps "
                "do not mind; --scale takes sizes out of the model"
            )
        if rim[i] - np.median(rim) > LONG_LOOP:
            found.append(
                f"{name}: is open, with a rim of {rim[i]:.2g} sqrt(area), and most are "
                "not: what it lacks is bridged, see that column of summary.csv"
            )
        if apart[i] > UNLIKE:
            found.append(
                f"{name}: may be of another kind: even from those of the most alike "
                f"shape its eigenvalues differ by a factor of {np.exp(apart[i]):.1f}"
            )
    return found


def _apart(signatures) -> np.ndarray:
    """Of each shape the `spectrum_gap` to the most alike one."""
    from scipy.spatial.distance import cdist

    from jfsf.apps.collections._cycles import evals_of
    from jfsf.matching._certificate import EIGENVALUES
    from jfsf.matching._confidence import LEAST

    logs = np.log([evals_of(row)[:EIGENVALUES] + LEAST for row in signatures])
    gaps = cdist(logs, logs, "chebyshev")
    np.fill_diagonal(gaps, np.inf)
    return gaps.min(1)
