"""What `jfsf collection` makes of curves and patches: semilandmarks, and who slides."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jfsf.apps.landmarks import Landmarks
    from jfsf.apps.landmarks._semilandmarks import Semilandmarks

CURVES, PATCHES = "curveslide.csv", "surfslide.csv"  # as geomorph's examples name them


def semilandmarks_of(
    files: Sequence[Path],
    points: "Landmarks",
    template: Path,
    largest: bool,
    mend: bool,
) -> "tuple[Landmarks, Semilandmarks]":
    """The template's landmarks with semilandmarks after them, and which slide.

    Args:
        files: curves of Slicer, and tables.
        points: of `points_of`.
        template: its file.
        largest, mend: as `matchable`.

    Raises:
        ValueError: as `read_outlines` and `semilandmarks`.
    """
    from jfsf.apps.cli._files import matchable
    from jfsf.apps.landmarks._outlines import appended, read_outlines
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.apps.landmarks._semilandmarks import semilandmarks

    outlines = read_outlines(files, points.names)
    mesh = matchable(template, largest, mend).mesh
    try:
        found = semilandmarks(mesh, on_surface(points, mesh).points, outlines)
    except ValueError as error:
        raise ValueError(f"{template}: {error}") from None
    return appended(points, found.names, found.points), found


def sliders_in(out: Path) -> "Semilandmarks | None":
    """What `write_sliders` wrote, without names and points; None if it is nothing."""
    import numpy as np

    from jfsf.apps.landmarks._semilandmarks import Semilandmarks

    if not any((out / name).exists() for name in (CURVES, PATCHES)):
        return None
    read = {"delimiter": ",", "skiprows": 1, "dtype": int, "ndmin": 2}
    rows = lambda name, width: (
        np.loadtxt(out / name, **read)
        if (out / name).exists()
        else np.zeros((0, width), int)
    )
    return Semilandmarks((), np.zeros((0, 3)), rows(CURVES, 3), rows(PATCHES, 1)[:, 0])


def write_sliders(out: Path, sliding: "Semilandmarks | None") -> list[Path]:
    """Write which landmarks of landmarks.csv slide, as `geomorph::gpagen` takes them.

    Tables of an earlier run that do not hold are removed.
    """
    from jfsf.apps.cli._runs import write_table

    slide = [] if sliding is None else sliding.slide.tolist()
    surface = [] if sliding is None else sliding.surface[:, None].tolist()
    tables = {
        CURVES: (("before", "slide", "after"), slide),
        PATCHES: (("surface",), surface),
    }
    written = []
    for name, (titles, rows) in tables.items():
        if rows:
            named = [dict(zip(titles, row, strict=True)) for row in rows]
            write_table(out / name, titles, named)
            written.append(out / name)
        else:
            (out / name).unlink(missing_ok=True)
    return written
