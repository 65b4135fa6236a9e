"""Pictures of maps by colour transfer: Y has a smooth colouring, X pulls it back.

colour_x[i] = colour_y[T_xy[i]]. Where the map is right, corresponding parts have equal
colours. Where it is discontinuous, so are the colours of X. matplotlib's Agg draws,
which needs no display; pyplot and its global state stay untouched.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.mesh import face_normals
from jfsf.plot._colours import (
    Up,
    coordinate_colours,
    error_colours,
    frame,
    points_of,
    pull_back,
    ramp,
)
from jfsf.storage import write_atomically
from jfsf.types import ArrayLike, Mesh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 160
_FINER = 3  # Agg does not smooth edges of shaded triangles: draw finer, then average
_TALL, _WIDE = 4.0, 13.0  # inches, at most, for the shapes
_GAP, _LABEL, _SCALE, _TITLE, _EDGE = 0.25, 0.3, 0.12, 0.45, 0.12  # inches
_INK = "#3b4048"


class _View(NamedTuple):
    """A shape as the viewer sees it, scaled to area 1.

    xy: (n, 2), right and up, from (0, 0).
    depth: (n,), towards the viewer.
    normals: (n, 3), right, up and towards the viewer; those of a point cloud point to
        the viewer.
    sky: (n,), the share of light that its surroundings let through to a vertex.
    faces: (m, 3).
    """

    xy: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    sky: np.ndarray
    faces: np.ndarray


def draw_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
    errors: Float[ArrayLike, " n_x"] | None = None,
    up: Up = "y",
    turn: float = 20.0,
) -> "Figure":
    """Draw X, coloured through the map from X to Y, beside Y.

    Args:
        mesh_x, mesh_y: meshes or point clouds; each is drawn at area 1 (a cloud: at a
            fixed spread), so their units do not matter.
        T_xy: the vertex of Y for each vertex of X.
        path: the PNG to write, 160 dpi, completely or not at all.
        title: a line above.
        errors: one number a vertex of X, drawn on X at the right; nan is grey.
        up: the axis that points up in the files.
        turn: degrees by which the shapes turn about it, to their right.

    Returns:
        The figure, not registered with pyplot.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: wrong shapes of arrays, vertex numbers, `up` or suffix of `path`.
    """
    colours = coordinate_colours(mesh_y.vertices, up=up)
    view_x, view_y = (_look(m, up, turn) for m in (mesh_x, mesh_y))
    panels = [
        ("X, coloured by its map to Y", view_x, _pulled(colours, T_xy, view_x)),
        ("Y", view_y, colours),
    ]
    scale = None
    if errors is not None:
        paint, top = error_colours(errors, len(view_x.depth))
        panels.append(("error on X", view_x, paint))
        scale = (ramp(np.linspace(0, 1, 256)), "0", f"{top:.3g}")
    return _draw(panels, path, title, scale)


def draw_maps(
    mesh_x: Mesh,
    mesh_y: Mesh,
    maps: Mapping[str, Int[ArrayLike, " n_x"]],
    *,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
    up: Up = "y",
    turn: float = 20.0,
) -> "Figure":
    """Draw Y, then X once for each of several maps from X to Y, in the same colours.

    Args:
        mesh_x, mesh_y, path, title, up, turn: as in `draw_pair`.
        maps: label -> T_xy, such as {"nearest": ..., "Sinkhorn": ...}.

    Returns:
        As `draw_pair`.

    Raises:
        ImportError, ValueError: as `draw_pair`; ValueError also without any map.
    """
    if not maps:
        raise ValueError("draw_maps: no map to draw")
    colours = coordinate_colours(mesh_y.vertices, up=up)
    view_x, view_y = (_look(m, up, turn) for m in (mesh_x, mesh_y))
    panels = [("Y", view_y, colours)]
    panels += [(name, view_x, _pulled(colours, T, view_x)) for name, T in maps.items()]
    return _draw(panels, path, title, None)


def _pulled(colours_y, T_xy, view_x):
    if np.shape(T_xy) != (n_x := len(view_x.depth),):
        raise ValueError(f"draw: X has {n_x} vertices, T_xy has shape {np.shape(T_xy)}")
    return pull_back(colours_y, T_xy)


def _look(mesh, up, turn) -> _View:
    points = points_of(mesh.vertices) @ frame(up)
    faces = np.asarray(mesh.faces).reshape(-1, 3)
    turn, tilt = np.radians([turn, 8])  # from a little above
    c, s = np.cos(turn), np.sin(turn)
    points = points @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    c, s = np.cos(tilt), np.sin(tilt)
    points = points @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])

    cross = face_normals(points, faces)
    size = np.sqrt(np.linalg.norm(cross, axis=1).sum() / 2)
    if size == 0:
        size = 2.6 * np.linalg.norm(points.std(0))
    points = (points - points.min(0)) / (size or 1)
    normals = np.zeros_like(points)
    for corner in faces.T:
        np.add.at(normals, corner, cross)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1), [0, 0, 1])
    return _View(points[:, :2], points[:, 2], normals, _sky(points, normals), faces)


def _sky(points, normals):
    # Nearby points in front of the tangent plane take light away: without this the
    # inside of a mouth is as bright as a cheek. About 5000 points represent the shape.
    some = points[:: -(-len(points) // 5000)]
    distance, near = KDTree(some).query(points, min(64, len(some)), workers=1)
    distance, near = distance.reshape(len(points), -1), near.reshape(len(points), -1)
    rise = np.einsum("nkd,nd->nk", some[near] - points[:, None], normals)
    rise = np.clip(rise / np.maximum(distance, 1e-12), 0, 1)
    return 1 - np.clip(1.2 * rise.mean(1), 0, 0.5)


def _lit(colours, normals, sky):
    # Lambert shading with a key light from the upper left, a fill light from the right,
    # and ambient light. Light beyond 1 adds white, like a soft highlight.
    key, fill = np.array([-0.45, 0.55, 0.75]), np.array([0.8, 0.1, 0.5])
    light = 0.42 + 0.62 * np.clip(normals @ key / np.linalg.norm(key), 0, 1)
    light += 0.18 * np.clip(normals @ fill / np.linalg.norm(fill), 0, 1)
    light = (light * sky)[:, None]
    return np.clip(colours * np.minimum(light, 1) + np.clip(light - 1, 0, 1), 0, 1)


def _draw(panels, path, title, scale) -> "Figure":
    """panels: (label, view, colours); scale: (colours, low, high) of the last one."""
    if path is not None and Path(path).suffix.lower() != ".png":
        raise ValueError(
            f"draw: the picture is a PNG, so path ends in .png; got {path}"
        )
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as missing:
        raise ImportError(
            "drawing needs matplotlib: pip install 'jfsf[viz]'"
        ) from missing

    boxes = np.array([view.xy.max(0) for _, view, _ in panels])
    # One scale for all, in inches. The page is made to fit the shapes.
    room = max(_WIDE - _GAP * (len(panels) - 1), 1)
    inches = min(
        _TALL / max(boxes[:, 1].max(), 1e-9), room / max(boxes[:, 0].sum(), 1e-9)
    )
    letters = np.array([len(label) for label, _, _ in panels])
    widths = np.maximum(boxes[:, 0] * inches, 0.4 + 0.075 * letters)
    width = widths.sum() + _GAP * (len(panels) - 1) + 2 * _EDGE
    floor = _EDGE + _LABEL + (_SCALE if scale else 0)
    height = floor + boxes[:, 1].max() * inches + _EDGE + (_TITLE if title else 0)
    fig = Figure((width, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(fig)
    axes = fig.add_axes((0, 0, 1, 1))
    axes.set_axis_off()

    middles = _EDGE + np.cumsum(widths + _GAP) - _GAP - widths / 2
    for (label, view, colours), middle in zip(panels, middles, strict=True):
        xy = (view.xy - [view.xy[:, 0].max() / 2, 0]) * inches + [middle, floor]
        _paint(axes, xy, view, colours)
        axes.text(middle, _EDGE, label, ha="center", va="bottom", color=_INK, size=10)
    if scale:
        strip, low, high = scale
        ends, y = middles[-1] + np.array([-0.4, 0.4]), _EDGE + 0.23
        axes.imshow(strip[None], extent=(*ends, y - 0.03, y + 0.03), aspect="auto")
        axes.text(ends[0] - 0.05, y, low, ha="right", va="center", size=7)
        axes.text(ends[1] + 0.05, y, high, ha="left", va="center", size=7)
    if title:
        y = height - _EDGE - 0.08
        axes.text(width / 2, y, title, ha="center", va="top", color=_INK, size=13)
    axes.set(xlim=(0, width), ylim=(0, height))
    if path is not None:
        _save(fig, Path(path))
    return fig


def _paint(axes, xy, view, colours):
    from matplotlib.collections import TriMesh
    from matplotlib.tri import Triangulation

    if len(view.faces):
        # Far triangles first. Those that face away are hidden in a closed shape. In an
        # open one they are its inside, and are lit like the outside.
        faces = view.faces[np.argsort(view.depth[view.faces].mean(1), kind="stable")]
        normals = view.normals * np.where(view.normals[:, 2:] < -0.2, -1, 1)
        patch = TriMesh(Triangulation(xy[:, 0], xy[:, 1], faces))
        patch.set_facecolor(_lit(colours, normals, view.sky))
        axes.add_collection(patch)
    else:
        order = np.argsort(view.depth, kind="stable")
        dot = float(np.clip(20000 / len(xy), 2, 40))
        axes.scatter(*xy[order].T, s=dot, c=colours[order], linewidths=0)


def _save(fig, path: Path) -> None:
    from matplotlib.image import imsave

    fig.set_dpi(_DPI * _FINER)
    fig.canvas.draw()
    fine = np.asarray(fig.canvas.buffer_rgba())[..., :3]
    fig.set_dpi(_DPI)
    high, wide = (n // _FINER for n in fine.shape[:2])
    fine = fine[: high * _FINER, : wide * _FINER]
    blocks = fine.reshape(high, _FINER, wide, _FINER, 3)
    image = np.rint(blocks.mean((1, 3), dtype=np.float32)).astype(np.uint8)
    write_atomically(path, lambda file: imsave(file, image, format="png", dpi=_DPI))
