"""Pictures and meshes of a pair: what `jfsf match` and `jfsf batch` draw and export."""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from jfsf.cli._files import Shape, known_confidence
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
    Up | None,
    typer.Option(
        help="Axis that points up in both files, for the picture. Found when absent."
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

    up: the axis that points up in both files; found when None.
    checker: whether a checker is exported too.
    by_place: whether Y is coloured by place even if its file has colours.
    """

    up: Any = None
    checker: bool = False
    by_place: bool = False


def draw(path: Path, x: Shape, y: Shape, found: Match, looks: Looks) -> None:
    """Write a picture of a pair."""
    from jfsf.plot import draw_pair

    draw_pair(
        x.mesh,
        y.mesh,
        np.asarray(found.T_xy),
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
    found: Match,
    looks: Looks,
) -> list[str]:
    """Write X in the colours of Y to each of these files.

    Args:
        paths: the files.
        x, y: the shapes.
        file_y: of Y, which may have colours.
        found: their match.
        looks: how.

    Returns:
        What to say of the colours, a line each.
    """
    from jfsf.export import export_map
    from jfsf.mesh import vertex_colours

    colours = None
    if paths and not looks.by_place:
        colours = vertex_colours(file_y)
        if colours is not None and y.index is not None:
            colours = colours[np.asarray(y.index)]
    for path in paths:
        export_map(
            path,
            x.mesh,
            y.mesh,
            np.asarray(found.T_xy),
            up=looks.up,
            checker=looks.checker,
            confidence=known_confidence(found),
            matched_x=found.matched_x,
            membership=found.membership_x,
            colours_y=colours,
        )
    if colours is None:
        return []
    return [f"exported in the vertex colours of {file_y}"]
