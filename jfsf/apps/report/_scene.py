"""What the page's viewer shows: shapes in their frames, maps, colours and figures."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jfsf.apps.plot._colours import (
    body_colours,
    matched_colours,
    ramp,
    texture_coordinates,
)
from jfsf.apps.plot._frames import natural_turn
from jfsf.apps.report._html import packed
from jfsf.mesh import coarsen
from jfsf.types import ArrayLike, Maps, Match, Mesh

MOST = 12_000  # vertices of a shape; larger ones are shown by some of their vertices
_TOP = 0.05  # of sqrt(area): where the scale of a figure ends, at least
_NOT_KNOWN = 255  # a figure of a vertex that was not measured


class Shown(NamedTuple):
    """A shape as it is shown.

    body: its mesh, whole or coarsened; axes right, up and front, centred.
    index: (p,) number of each shown vertex in the shape.
    near: (n,) the shown vertex nearest to each vertex of the shape.
    """

    body: Mesh
    index: ArrayLike
    near: ArrayLike


def shown(mesh: Mesh, axes: Float[np.ndarray, "3 3"], most: int = MOST) -> Shown:
    """The shape in this frame, with at most so many vertices."""
    coarse, index = coarsen(mesh, most)
    points = np.asarray(coarse.vertices, float) @ axes
    middle = (points.min(0) + points.max(0)) / 2
    body = Mesh(points - middle, np.asarray(coarse.faces, np.int32).reshape(-1, 3))
    near = np.arange(len(index))
    if len(index) < len(mesh.vertices):
        near = KDTree(coarse.vertices).query(mesh.vertices)[1]
    return Shown(body, np.asarray(index), near.astype(np.int32))


def shown_maps(maps: Any, x: Shown, y: Shown) -> Maps:
    """Maps between shapes as maps between what is shown of them."""
    T_xy: Any = y.near[np.asarray(maps.T_xy)[x.index]]
    T_yx: Any = x.near[np.asarray(maps.T_yx)[y.index]]
    return Maps(T_xy, T_yx)


def shown_matched(
    found: Match, x: Shown, y: Shown
) -> tuple[np.ndarray, np.ndarray] | None:
    """Whether each shown vertex of X, and of Y, is matched; None for whole shapes."""
    if found.matched_x is None or found.matched_y is None:
        return None
    return np.asarray(found.matched_x)[x.index], np.asarray(found.matched_y)[y.index]


def scene(
    x: Shown,
    y: Shown,
    maps: Mapping[str, Maps],
    figures: Mapping[str, Float[ArrayLike, " p"]],
    numbers: tuple[Int[ArrayLike, " n_x"] | None, Int[ArrayLike, " n_y"] | None],
    matched: tuple[Bool[ArrayLike, " p"], Bool[ArrayLike, " q"]] | None = None,
) -> dict[str, Any]:
    """The shapes and maps as plain values for JSON; arrays are base64, little endian.

    Args:
        x, y: both shapes.
        maps: label -> maps between shown vertices; the first is shown at first.
        figures: label -> a number for each shown vertex of X, nan if not known.
        numbers: the file's numbers of the vertices of X and Y; None if they are these.
        matched: whether each shown vertex of X, and of Y, is in the region that both
            share; None for whole shapes.
    """
    colours, on_x = body_colours(y.body.vertices), None
    if matched is not None:
        # Else X is painted as Y is. Here what is grey differs.
        first = next(iter(maps.values()))
        painted = matched_colours(colours[np.asarray(first.T_xy)], matched[0])
        on_x = packed(255 * painted, "u1")
        colours = matched_colours(colours, matched[1])
    return {
        "turn": natural_turn(x.body.vertices, y.body.vertices),
        "x": _shape(x, numbers[0]) | {"colours": on_x},
        "y": _shape(y, numbers[1])
        | {
            "colours": packed(255 * colours, "u1"),
            "uv": packed(65535 * texture_coordinates(y.body.vertices), "<u2"),
        },
        "maps": [
            {
                "name": name,
                "xy": _indices(T_xy, len(y.index)),
                "yx": _indices(T_yx, len(x.index)),
            }
            for name, (T_xy, T_yx) in maps.items()
        ],
        "figures": [_figure(name, values) for name, values in figures.items()],
        "ramp": packed(255 * ramp(np.linspace(0, 1, _NOT_KNOWN)), "u1"),
    }


def shape_values(body: Mesh) -> dict[str, Any]:
    """A shape as plain values for JSON, in units of its largest extent."""
    points = np.asarray(body.vertices)
    low, size = points.min(0), float(np.ptp(points, axis=0).max()) or 1.0
    return {
        "n": len(points),
        "points": packed(65535 * (points - low) / size, "<u2"),
        "low": (low / size).tolist(),
        "faces": _indices(np.asarray(body.faces).ravel(), len(points)),
    }


def _shape(shape: Shown, numbers) -> dict[str, Any]:
    index = shape.index
    if numbers is not None:
        index = np.asarray(numbers)[index]
    same = np.array_equal(index, np.arange(len(index)))
    return shape_values(shape.body) | {
        "numbers": None if same else packed(index, "<u4")
    }


def _figure(name: str, values) -> dict[str, Any]:
    values = np.asarray(values, float)
    known = np.isfinite(values)
    top = float(np.quantile(values[known], 0.99)) if known.any() else 0.0
    # A good map is to look good: the scale does not end at its small errors.
    top = max(top, _TOP)
    share = np.where(known, values, 0) / top
    steps = np.where(known, np.clip(share, 0, 1) * (_NOT_KNOWN - 1), _NOT_KNOWN)
    return {"name": name, "top": top, "steps": packed(steps, "u1")}


def _indices(index, count: int) -> str:
    """Two bytes each, or four where there are more vertices than that."""
    return packed(index, "<u2" if count <= 65536 else "<u4")
