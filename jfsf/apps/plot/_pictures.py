"""Pictures of shapes and maps: by colour, by texture, by error.

colour_x[i] = colour_y[T_xy[i]]. Where the map is right, corresponding parts have equal
colours. Where it is discontinuous, so are the colours of X.
"""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from jfsf.apps.plot._colours import (
    body_colours,
    error_colours,
    matched_colours,
    pull_back,
    ramp,
)
from jfsf.apps.plot._frames import Up
from jfsf.apps.plot._panels import (
    ShapePanel,
    draw_panels,
    look,
    look_at_pair,
)
from jfsf.types import ArrayLike, Mesh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PLAIN = np.array([0.72, 0.75, 0.8])


def draw_shape(
    mesh: Mesh,
    colours: Float[ArrayLike, "n 3"] | None = None,
    *,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
    up: Up = "y",
    turn: float | None = None,
) -> "Figure":
    """Draw one shape.

    Args:
        mesh: a mesh or point cloud.
        colours: sRGB in [0, 1] of each vertex; plain grey when absent.
        path, title, up, turn: as in `draw_pair`.

    Returns:
        As `draw_pair`.

    Raises:
        ImportError, ValueError: as `draw_pair`.
    """
    view = look(mesh, up=up, turn=turn)
    n = len(view.depth)
    colours = np.tile(_PLAIN, (n, 1)) if colours is None else np.asarray(colours, float)
    if colours.shape != (n, 3):
        raise ValueError(f"draw_shape: {n} vertices, colours {colours.shape}")
    return draw_panels([ShapePanel("", view, colours)], path, title, None)


def draw_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    names: tuple[str, str] = ("X", "Y"),
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
    errors: Float[ArrayLike, " n_x"] | None = None,
    matched_x: Bool[ArrayLike, " n_x"] | None = None,
    matched_y: Bool[ArrayLike, " n_y"] | None = None,
    up: Up = "y",
    turn: float | None = None,
) -> "Figure":
    """Draw X, coloured through the map from X to Y, beside Y.

    Args:
        mesh_x, mesh_y: meshes or point clouds; each is drawn at area 1 (a cloud: at a
            fixed spread), so their units do not matter.
        T_xy: the vertex of Y for each vertex of X.
        names: of X and of Y, for what stands below them.
        path: the PNG to write, 160 dpi, completely or not at all.
        title: a line above.
        errors: one number for each vertex of X, drawn on X at the right; nan is grey.
        matched_x, matched_y: for a match of parts, `Match.matched_x` and `matched_y`;
            all other vertices are grey.
        up: the axis that points up in X's file, such as "z" or "-y", with the front
            where modelling tools have it. Y is turned onto X by the rotation that fits
            the map best.
        turn: degrees by which the shapes turn about it, to their right. When absent 20,
            and up to 55 for bodies as long as a horse.

    Returns:
        The figure, not registered with pyplot.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: wrong shapes of arrays, vertex numbers, `up` or suffix of `path`.
    """
    T_xy = _map_of(mesh_x, mesh_y, T_xy)
    view_x, view_y = look_at_pair(
        mesh_x, mesh_y, T_xy, up=up, turn=turn, matched_x=matched_x
    )
    colours = body_colours(view_y.body)
    panels = [
        ShapePanel(
            f"{names[0]}, coloured by its map to {names[1]}",
            view_x,
            matched_colours(colours[T_xy], matched_x),
        ),
        ShapePanel(names[1], view_y, matched_colours(colours, matched_y)),
    ]
    scale = None
    if errors is not None:
        paint, top = error_colours(errors, len(view_x.depth))
        panels.append(ShapePanel(f"error on {names[0]}", view_x, paint))
        scale = _error_scale(top)
    return draw_panels(panels, path, title, scale)


def draw_maps(
    mesh_x: Mesh,
    mesh_y: Mesh,
    maps: Mapping[str, Int[ArrayLike, " n_x"]],
    *,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
    up: Up = "y",
    turn: float | None = None,
) -> "Figure":
    """Draw Y, then X once for each of several maps from X to Y, in the same colours.

    Args:
        mesh_x, mesh_y, path, title, up, turn: as in `draw_pair`. Y is turned by the
            first map.
        maps: label -> T_xy, such as {"nearest": ..., "Sinkhorn": ...}.

    Returns:
        As `draw_pair`.

    Raises:
        ImportError, ValueError: as `draw_pair`; ValueError also without any map.
    """
    if not maps:
        raise ValueError("draw_maps: no map to draw")
    maps = {name: _map_of(mesh_x, mesh_y, T_xy) for name, T_xy in maps.items()}
    first = next(iter(maps.values()))
    view_x, view_y = look_at_pair(mesh_x, mesh_y, first, up=up, turn=turn)
    colours = body_colours(view_y.body)
    panels = [ShapePanel("Y", view_y, colours)]
    panels += [ShapePanel(name, view_x, colours[T]) for name, T in maps.items()]
    return draw_panels(panels, path, title, None)


def _error_scale(top):
    return ramp(np.linspace(0, 1, 256)), "0", f"{top:.3g}"


def _map_of(mesh_x, mesh_y, T_xy):
    """T_xy as numpy; ValueError if it is no map from X to Y."""
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    if np.shape(T_xy) != (n_x,):
        raise ValueError(f"draw: X has {n_x} vertices, T_xy has shape {np.shape(T_xy)}")
    return pull_back(np.arange(n_y)[:, None], T_xy)[:, 0]
