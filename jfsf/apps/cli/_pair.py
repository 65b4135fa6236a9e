"""What `jfsf match` does with a pair, and `jfsf batch` with each."""

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from jfsf.apps.cli._files import UNTOUCHED, Shape, matchable, sides_in_doubt
from jfsf.apps.cli._known import KnownPairs
from jfsf.apps.cli._print import WARNING
from jfsf.apps.report import Side, write_report
from jfsf.apps.report._html import thumbnail
from jfsf.mesh._read import stem_of
from jfsf.types import Match

FOLDER = "report"  # of a batch: pages and pictures of its pairs


class Pictures(NamedTuple):
    """What is made of a pair beside its map, and how.

    png: the file of a picture; None for none.
    exports: files of meshes, X in the colours of Y.
    page: the file of the report; None for none.
    thumbnail: the file of a picture of the page; None for none.
    up: the axis that points up in the file of X.
    checker: whether a checker is exported too.
    by_place: whether Y is coloured by place even if its file has colours.
    """

    png: Path | None = None
    exports: tuple[Path, ...] = ()
    page: Path | None = None
    thumbnail: Path | None = None
    up: Any = "y"
    checker: bool = False
    by_place: bool = False


class Seen(NamedTuple):
    """What a picture or an exported mesh shows of a map.

    T_xy: (n_x,) the vertex of Y for each vertex of X.
    matched_x, matched_y: vertices with a partner; the others are grey. None for all.
    confidence: (n_x,) of each vertex; None where it is not known of all.
    membership: (n_x,) of a match of parts; else None.
    radius: (n_x,) of each vertex, in sqrt(area of Y); None where it is not known.
    """

    T_xy: np.ndarray
    matched_x: Any = None
    matched_y: Any = None
    confidence: Any = None
    membership: Any = None
    radius: Any = None


def both_matchable(paths, given) -> tuple[Shape, Shape]:
    """The shapes of a pair, read as its options (`PairOptions`) say."""
    x, y = (matchable(path, given.largest_component, given.repair) for path in paths)
    return x, y


def check_units(
    paths: tuple[Path, Path], shapes: tuple[Shape, Shape], given, same_unit: bool
) -> str:
    """Why the files of two parts may be in different units; "" if they are in one.

    Args:
        paths: of X and Y.
        shapes: what is matched of them.
        given: options of the pair.
        same_unit: whether the files have the same unit, as they are said to.

    Raises:
        ValueError: they must be in different units.
    """
    from jfsf.matching._arguments import TWO_UNITS, doubtful_units
    from jfsf.mesh._geometry import boundary_edges

    x, y = (shape.mesh for shape in shapes)
    # Clouds are refused, and closed shapes matched as wholes, at any scale.
    if not (given.partial and same_unit and len(x.faces) and len(y.faces)):
        return ""
    if not any(len(boundary_edges(mesh.faces)) for mesh in (x, y)):
        return ""
    names = str(paths[0]), str(paths[1])
    if doubt := doubtful_units(x, y, names=names, above=TWO_UNITS):
        raise ValueError(f"--partial: {doubt}, or give --any-unit")
    return doubtful_units(x, y, names=names)


def find(
    shapes: tuple[Shape, Shape],
    given,
    known: KnownPairs | None,
    *,
    same_unit: bool,
    cache: bool,
    progress: Callable[[str], object] | None = None,
) -> tuple[Match, dict[str, float]]:
    """The match of two shapes by the options of the pair, and the seconds it took."""
    from jfsf.matching import match

    started = perf_counter()
    found = match(
        *(shape.mesh for shape in shapes),
        orientation=given.orientation,
        landmarks=None if known is None else known.rows,  # type: ignore
        partial=given.partial,
        same_unit=same_unit,
        cache=cache,
        progress=progress,
    )
    return found, {"matching": perf_counter() - started}


def notes_of(
    paths: tuple[Path, Path],
    shapes: tuple[Shape, Shape],
    given,
    known: KnownPairs | None,
    *,
    brief: bool = False,
) -> list[str]:
    """A line for each thing that was done to a mesh, then for each doubt about one.

    Args:
        paths: of X and Y.
        shapes: what was matched of them.
        given: options of the pair.
        known: its landmarks.
        brief: without a line on a repair that had nothing to do.

    Returns:
        Lines without ends; doubts begin with `WARNING`.
    """
    from jfsf.matching.parts._surfaces import likely_part

    lines = [
        f"{path}: {line}"
        for path, shape in zip(paths, shapes, strict=True)
        for line in shape.said
        if not brief or line != UNTOUCHED
    ]
    lines += () if known is None else known.said
    for path, shape in zip(paths, shapes, strict=True):
        if doubt := sides_in_doubt(shape.mesh):
            lines.append(f"{WARNING}{path}: {doubt}; check left and right")
    x, y = (shape.mesh for shape in shapes)
    if not given.partial and likely_part(x, y):
        lines.append(
            f"{WARNING}one shape has a long boundary: if it is a part, pass --partial"
        )
    return lines


def seen(found: Match) -> Seen:
    """Of a match."""
    region = found.matched_x, found.matched_y
    likely, radius = (
        None if values is None or np.isnan(values).any() else np.asarray(values)
        for values in (found.confidence_x, found.radius_x)
    )
    return Seen(np.asarray(found.T_xy), *region, likely, found.membership_x, radius)


def draw(
    pictures: Pictures, shapes: tuple[Shape, Shape], paths, found: Seen
) -> list[str]:
    """Write the picture of a pair, and X in the colours of Y to each exported file.

    Args:
        pictures: which, and how.
        shapes: X and Y.
        paths: of X and Y; that of Y may have colours.
        found: the map.

    Returns:
        What to say of the colours, a line each.
    """
    from jfsf.apps.export import export_map
    from jfsf.mesh import surface_area, vertex_colours

    (x, y), colours = shapes, None
    how = {"up": pictures.up, "matched_x": found.matched_x}
    if pictures.png is not None:
        from jfsf.apps.plot import draw_pair

        how_y = {"matched_y": found.matched_y, "path": pictures.png}
        names = stem_of(paths[0]), stem_of(paths[1])
        draw_pair(x.mesh, y.mesh, found.T_xy, names=names, **how, **how_y)
    if pictures.exports and not pictures.by_place:
        colours = vertex_colours(paths[1])
        if colours is not None and y.index is not None:
            colours = colours[np.asarray(y.index)]
    values = {"confidence": found.confidence, "membership": found.membership}
    if found.radius is not None and (area := surface_area(y.mesh)):
        values["radius"] = found.radius * np.sqrt(area)
    how |= {"checker": pictures.checker, "colours_y": colours}
    how["values"] = {name: rows for name, rows in values.items() if rows is not None}
    for path in pictures.exports:
        export_map(path, x.mesh, y.mesh, found.T_xy, **how)
    if colours is None:
        return []
    return [f"exported in the vertex colours of {paths[1]}"]


def write_page(pictures: Pictures, paths, meshes, found: Match, **options) -> None:
    """Write the report of a pair, if there is to be one, and its thumbnail.

    Args:
        pictures: their files.
        paths: of X and Y.
        meshes: the mesh of each, and the numbers of its vertices in the file.
        found: the match.
        options: of `write_report`.
    """
    if pictures.page is not None:
        pairs = zip(paths, meshes, strict=True)
        pictures.page.parent.mkdir(exist_ok=True)
        x, y = (Side(mesh, stem_of(path), index) for path, (mesh, index) in pairs)
        shown = write_report(pictures.page, x, y, found, up=pictures.up, **options)
        if pictures.thumbnail is not None:
            thumbnail(shown, pictures.thumbnail)


def pages_of(out: Path) -> tuple[Path, Path]:
    """Page and picture of the pair of a batch whose match is in this file."""
    folder = out.parent / FOLDER
    return folder / f"{out.stem}.html", folder / f"{out.stem}.png"


def pictures_of(
    out: Path,
    *,
    report: bool = False,
    png: bool = False,
    suffixes: Sequence[str] = (),
    **looks: Any,
) -> Pictures:
    """What is made beside the match in a file of a batch; looks are those of it."""
    return Pictures(
        out.with_suffix(".png") if png else None,
        tuple(out.with_suffix(suffix) for suffix in suffixes),
        *(pages_of(out) if report else (None, None)),
        **looks,
    )
