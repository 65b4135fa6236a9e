"""Shapes as the viewer sees them, turned and lit, beside each other; PNG files.

The look is that of all pictures: figures, fonts and inks. matplotlib's Agg draws, which
needs no display; pyplot and its global state stay untouched.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jfsf.storage._atomic import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jfsf.apps.plot._frames import Up, frame, frames_of_pair, natural_turn, points_of
from jfsf.mesh._geometry import face_areas, vertex_normals
from jfsf.types import ArrayLike, Mesh

DPI = 160
INK, PALE = "#3b4048", "#d5d8dc"
# Told apart by people with any colour vision too (Okabe and Ito), darkest first.
LINES = ("#0b6fa4", "#d1600a", "#12946e", "#b14e92", "#7a5c00", "#4d4d4d", "#66aadd")
_FINER = 3  # Agg does not smooth edges of shaded triangles: draw finer, then average


def new_figure(width: float, height: float) -> "Figure":
    """A white figure, in inches, not registered with pyplot.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as missing:
        raise ImportError(
            "drawing needs matplotlib: pip install 'jfsf[viz]'"
        ) from missing
    figure = Figure((width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def check_png(path: str | os.PathLike[str] | None) -> None:
    """ValueError unless path is None or ends in .png."""
    if path is not None and Path(path).suffix.lower() != ".png":
        raise ValueError(
            f"draw: the picture is a PNG, so path ends in .png; got {path}"
        )


def style(axes: Any) -> None:
    """Thin pale frame and grid, small type in ink."""
    for side in axes.spines.values():
        side.set(color=PALE, linewidth=0.8)
    axes.tick_params(colors=INK, labelsize=8, length=2.5, width=0.6, which="both")
    axes.grid(color=PALE, linewidth=0.5, alpha=0.7)
    axes.set_axisbelow(True)
    for text in (axes.xaxis.label, axes.yaxis.label):
        text.set(color=INK, size=9)
    axes.title.set(color=INK, size=10)


def picture_of(figure: "Figure", dpi: float = DPI) -> np.ndarray:
    """The pixels (h, w, 3) uint8 of a figure, edges smoothed."""
    before = figure.get_dpi()
    figure.set_dpi(dpi * _FINER)
    figure.canvas.draw()
    fine = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore
    figure.set_dpi(before)
    high, wide = (n // _FINER for n in fine.shape[:2])
    fine = fine[: high * _FINER, : wide * _FINER]
    blocks = fine.reshape(high, _FINER, wide, _FINER, 3)
    return np.rint(blocks.mean((1, 3), dtype=np.float32)).astype(np.uint8)


def save(figure: "Figure", path: str | os.PathLike[str] | None) -> "Figure":
    """Write a figure as PNG, completely or not at all; returns it. None writes none."""
    if path is None:
        return figure
    from matplotlib.image import imsave

    image = picture_of(figure)
    write_atomically(path, lambda file: imsave(file, image, format="png", dpi=DPI))
    return figure


_TILT = 8.0  # degrees: from a little above
_TALL, _WIDE = 4.0, 13.0  # inches, at most, for the shapes
_GAP, _LABEL, _SCALE, _TITLE, _EDGE = 0.25, 0.3, 0.12, 0.45, 0.12  # inches


class View(NamedTuple):
    """A shape as the viewer sees it, scaled to area 1.

    body: (n, 3), right, up and front of the shape itself.
    xy: (n, 2), right and up on the page, from (0, 0).
    depth: (n,), towards the viewer.
    normals: (n, 3), right, up and towards the viewer; those of a point cloud point to
        the viewer.
    sky: (n,), the share of light that its surroundings let through to a vertex.
    faces: (m, 3).
    """

    body: np.ndarray
    xy: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    sky: np.ndarray
    faces: np.ndarray


class ShapePanel(NamedTuple):
    """A shape with a label below.

    colours: (n, 3) sRGB in [0, 1], one row for each vertex of the view.
    """

    label: str
    view: View
    colours: Float[np.ndarray, "n 3"]


def look(mesh: Mesh, *, up: Up = "y", turn: float | None = None) -> View:
    """One shape, with this axis of its file up.

    turn: degrees to its right; by `natural_turn` when absent.
    """
    body = points_of(mesh.vertices) @ frame(up)
    return _view(mesh, body, natural_turn(body) if turn is None else turn)


def look_at_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    up: Up = "y",
    turn: float | None = None,
    matched_x: Bool[ArrayLike, " n_x"] | None = None,
) -> tuple[View, View]:
    """Two shapes from one side, in the frames of `frames_of_pair`."""
    axes = frames_of_pair(mesh_x, mesh_y, T_xy, up=up, matched_x=matched_x)
    body_x = points_of(mesh_x.vertices) @ axes[0]
    body_y = points_of(mesh_y.vertices) @ axes[1]
    turn = natural_turn(body_x, body_y) if turn is None else turn
    return _view(mesh_x, body_x, turn), _view(mesh_y, body_y, turn)


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


def lit(
    colours: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    sky: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Colours under a key light, a fill light and ambient light (Lambert)."""
    # Key light from the upper left, fill from the right. Light beyond 1 adds white,
    # like a soft highlight.
    key, fill = np.array([-0.45, 0.55, 0.75]), np.array([0.8, 0.1, 0.5])
    light = 0.42 + 0.62 * np.clip(normals @ key / np.linalg.norm(key), 0, 1)
    light += 0.18 * np.clip(normals @ fill / np.linalg.norm(fill), 0, 1)
    light = (light * sky)[:, None]
    return np.clip(colours * np.minimum(light, 1) + np.clip(light - 1, 0, 1), 0, 1)


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


def _view(mesh: Mesh, body, turn: float) -> View:
    faces = np.asarray(mesh.faces).reshape(-1, 3)
    turn, tilt = np.radians([turn, _TILT])
    c, s = np.cos(turn), np.sin(turn)
    points = body @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    c, s = np.cos(tilt), np.sin(tilt)
    points = points @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])

    size = np.sqrt(face_areas(points, faces).sum())
    if size == 0:
        size = 2.6 * np.linalg.norm(points.std(0))
    points = (points - points.min(0)) / (size or 1)
    normals = vertex_normals(points, faces)
    normals[~normals.any(1)] = [0, 0, 1]  # towards the eye
    sky = _sky(points, normals)
    return View(body, points[:, :2], points[:, 2], normals, sky, faces)


def _sky(points, normals):
    # Nearby points in front of the tangent plane take light away: without this the
    # inside of a mouth is as bright as a cheek. About 5000 points represent the shape.
    some = points[:: -(-len(points) // 5000)]
    distance, near = KDTree(some).query(points, min(64, len(some)), workers=1)
    distance, near = distance.reshape(len(points), -1), near.reshape(len(points), -1)
    rise = np.einsum("nkd,nd->nk", some[near] - points[:, None], normals)
    rise = np.clip(rise / np.maximum(distance, 1e-12), 0, 1)
    return 1 - np.clip(1.2 * rise.mean(1), 0, 0.5)
