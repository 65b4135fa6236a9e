"""Shapes beside each other on one page, to one scale."""

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.apps.plot._page import INK, check_png, new_figure, save
from jfsf.apps.plot._shading import View, lit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TALL, _WIDE = 4.0, 13.0  # inches, at most, for the shapes
_GAP, _LABEL, _SCALE, _TITLE, _EDGE = 0.25, 0.3, 0.12, 0.45, 0.12  # inches
# Triangles of a textured shape are divided until there are so many; each is plain.
_TEXTURE_FACES = 150_000


class ShapePanel(NamedTuple):
    """A shape with a label below.

    colours: (n, 3) sRGB in [0, 1], one row a vertex of the view.
    """

    label: str
    view: View
    colours: Float[np.ndarray, "n 3"]


def divided(
    view: View, values: Float[np.ndarray, "n c"]
) -> tuple[View, Float[np.ndarray, "m c"]]:
    """View and values of vertices with each triangle divided into four, repeatedly."""
    depth, sky = view.depth[:, None], view.sky[:, None]
    rows = np.concatenate([view.xy, depth, view.normals, sky, values], 1)
    faces = view.faces
    while 4 * len(faces) <= _TEXTURE_FACES:
        ends = np.sort(np.stack([faces, np.roll(faces, -1, 1)], 2).reshape(-1, 2), 1)
        ends, middle = np.unique(ends, axis=0, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = (middle.reshape(-1, 3) + len(rows)).T
        rows = np.concatenate([rows, rows[ends].mean(1)])
        parts = (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)
        faces = np.concatenate([np.stack(part, 1) for part in parts])
    xy, depth, normals, sky, values = np.split(rows, (2, 3, 6, 7), axis=1)
    fine = View(view.body, xy, depth[:, 0], normals, sky[:, 0], faces)
    return fine, values


def draw_panels(
    panels: Sequence[ShapePanel],
    path: str | os.PathLike[str] | None,
    title: str | None,
    scale: tuple[Float[np.ndarray, "s 3"], str, str] | None,
) -> "Figure":
    """Draw all panels, and write the figure if there is a path.

    Args:
        panels: one or more.
        path, title: as in `jfsf.apps.plot.draw_pair`.
        scale: colours, and what the first and last stand for, below the last panel.
    """
    check_png(path)
    boxes = np.array([panel.view.xy.max(0) for panel in panels])
    # One scale for all, in inches. The page is made to fit the shapes.
    room = max(_WIDE - _GAP * (len(panels) - 1), 1)
    inches = min(
        _TALL / max(boxes[:, 1].max(), 1e-9), room / max(boxes[:, 0].sum(), 1e-9)
    )
    letters = np.array([len(panel.label) for panel in panels])
    widths = np.maximum(boxes[:, 0] * inches, 0.4 + 0.075 * letters)
    width = widths.sum() + _GAP * (len(panels) - 1) + 2 * _EDGE
    floor = _EDGE + _LABEL * bool(letters.any()) + (_SCALE if scale else 0)
    height = floor + boxes[:, 1].max() * inches + _EDGE + (_TITLE if title else 0)
    figure = new_figure(width, height)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()

    middles = _EDGE + np.cumsum(widths + _GAP) - _GAP - widths / 2
    for (label, view, colours), middle in zip(panels, middles, strict=True):
        xy = (view.xy - [view.xy[:, 0].max() / 2, 0]) * inches + [middle, floor]
        _paint(axes, xy, view, colours)
        axes.text(middle, _EDGE, label, ha="center", va="bottom", color=INK, size=10)
    if scale:
        strip, low, high = scale
        ends, y = middles[-1] + np.array([-0.4, 0.4]), _EDGE + 0.23
        axes.imshow(strip[None], extent=(*ends, y - 0.03, y + 0.03), aspect="auto")
        axes.text(ends[0] - 0.05, y, low, ha="right", va="center", size=7)
        axes.text(ends[1] + 0.05, y, high, ha="left", va="center", size=7)
    if title:
        y = height - _EDGE - 0.08
        axes.text(width / 2, y, title, ha="center", va="top", color=INK, size=13)
    axes.set(xlim=(0, width), ylim=(0, height))
    return save(figure, path)


def _paint(axes: Any, xy, view: View, colours) -> None:
    from matplotlib.collections import TriMesh
    from matplotlib.tri import Triangulation

    if len(view.faces):
        # Far triangles first. Those that face away are hidden in a closed shape. In an
        # open one they are its inside, and are lit like the outside.
        faces = view.faces[np.argsort(view.depth[view.faces].mean(1), kind="stable")]
        normals = view.normals * np.where(view.normals[:, 2:] < -0.2, -1, 1)
        patch = TriMesh(Triangulation(xy[:, 0], xy[:, 1], faces))
        patch.set_facecolor(lit(colours, normals, view.sky))  # type: ignore
        axes.add_collection(patch)
    else:
        order = np.argsort(view.depth, kind="stable")
        dot = float(np.clip(20000 / len(xy), 2, 40))
        axes.scatter(*xy[order].T, s=dot, c=colours[order], linewidths=0)
