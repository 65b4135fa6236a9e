"""Pictures and meshes of a pair: what `jfsf match` and `jfsf batch` draw and export."""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from jfsf.apps.cli._files import Shape
from jfsf.types import Match


class Up(StrEnum):
    """The axis that points up, as choices of an option."""

    x = "x"
    y = "y"
    z = "z"
    minus_x = "-x"
    minus_y = "-y"
    minus_z = "-z"


UpAxis = Annotated[
    Up,
    typer.Option(
        help="Axis of the file of X that points up, for pictures, the page and colours."
    ),
]
CheckerOption = Annotated[
    bool,
    typer.Option(
        "--checker", help="Export a checker carried from Y too (.obj and .glb)."
    ),
]
ByPlaceOption = Annotated[
    bool,
    typer.Option(
        "--by-place",
        help="Export Y coloured by place, even if its file has colours of vertices.",
    ),
]


class Looks(NamedTuple):
    """How pairs are drawn and exported.

    up: the axis that points up in the file of X.
    checker: whether a checker is exported too.
    by_place: whether Y is coloured by place even if its file has colours.
    """

    up: Any = "y"
    checker: bool = False
    by_place: bool = False


class Seen(NamedTuple):
    """What a picture or an exported mesh shows of a map.

    T_xy: (n_x,) the vertex of Y for each vertex of X.
    matched_x, matched_y: vertices with a partner; the others are grey. None for all.
    confidence: (n_x,) of each vertex; None where it is not known of all.
    membership: (n_x,) of a match of parts; else None.
    """

    T_xy: np.ndarray
    matched_x: Any = None
    matched_y: Any = None
    confidence: Any = None
    membership: Any = None


def seen(found: Match) -> Seen:
    """Of a match."""
    region, likely = (found.matched_x, found.matched_y), found.confidence_x
    likely = None if likely is None or np.isnan(likely).any() else np.asarray(likely)
    return Seen(np.asarray(found.T_xy), *region, likely, found.membership_x)


def draw(path: Path, x: Shape, y: Shape, found: Seen, looks: Looks) -> None:
    """Write a picture of a pair."""
    from jfsf.apps.plot import draw_pair

    draw_pair(
        x.mesh,
        y.mesh,
        found.T_xy,
        path=path,
        matched_x=found.matched_x,
        matched_y=found.matched_y,
        up=looks.up,
    )


def export(
    paths: Sequence[Path],
    x: Shape,
    y: Shape,
    file_y: Path,
    found: Seen,
    looks: Looks,
) -> list[str]:
    """Write X in the colours of Y to each of these files.

    Args:
        paths: the files.
        x, y: the shapes.
        file_y: of Y, which may have colours.
        found: the map.
        looks: how.

    Returns:
        What to say of the colours, a line each.
    """
    from jfsf.apps.export import export_map
    from jfsf.mesh import vertex_colours

    colours = None
    if paths and not looks.by_place:
        colours = vertex_colours(file_y)
        if colours is not None and y.index is not None:
            colours = colours[np.asarray(y.index)]
    values = {"confidence": found.confidence, "membership": found.membership}
    values = {name: rows for name, rows in values.items() if rows is not None}
    for path in paths:
        export_map(
            path,
            x.mesh,
            y.mesh,
            found.T_xy,
            up=looks.up,
            checker=looks.checker,
            matched_x=found.matched_x,
            colours_y=colours,
            values=values,
        )
    if colours is None:
        return []
    return [f"exported in the vertex colours of {file_y}"]
