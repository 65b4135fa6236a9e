"""Charts in one look: errors, functional maps as matrices."""

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.apps.plot._colours import diverging
from jfsf.apps.plot._panels import INK, LINES, PALE, check_png, new_figure, save, style
from jfsf.evaluate import error_curve
from jfsf.types import ArrayLike

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDE, _HIGH = 4.2, 3.1  # inches of a panel
_FEW = 30  # values; a curve of no more has a dot at each
_INSIDE = 6  # curves at most, for the legend to stand among them
_LEGEND = 2.4  # inches beside the panel
_DASHES = "-", "--", ":"


class Panel(NamedTuple):
    """One chart of several beside each other.

    curves: label -> (x, y), drawn in this order. A curve without label is "".
    x, y: what the axes show, with units.
    title: a line above.
    log: "x", "y", "xy" or "": axes that are logarithmic.
    legend: where it stands, as matplotlib's `loc`.
    top: the end of the vertical axis; it begins at 0, if it is not logarithmic.
    """

    curves: Mapping[str, tuple[ArrayLike, ArrayLike]]
    x: str = ""
    y: str = ""
    title: str = ""
    log: str = ""
    top: float | None = None
    legend: str = "best"


def draw_curves(
    panels: Sequence[Panel],
    *,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
) -> "Figure":
    """Draw charts beside each other. A label keeps its colour in all of them.

    Args:
        panels: the charts, one or more.
        path: the PNG to write, 160 dpi, completely or not at all.
        title: a line above all.

    Returns:
        The figure, not registered with pyplot.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: no panel or no curve, x and y of different lengths, or another
            suffix than .png.
    """
    check_png(path)
    labels = list(dict.fromkeys(name for panel in panels for name in panel.curves))
    if not labels:
        raise ValueError("draw_curves: no curve to draw")
    ink = {
        name: {"color": LINES[i % len(LINES)], "ls": _DASHES[i // len(LINES) % 3]}
        for i, name in enumerate(labels)
    }
    high = _HIGH + (0.35 if title else 0)
    outside = [len(panel.curves) > _INSIDE for panel in panels]
    widths = [_WIDE + _LEGEND * out for out in outside]
    figure = new_figure(sum(widths), high)
    figure.set_layout_engine("constrained")
    all_axes = figure.subplots(1, len(panels), squeeze=False, width_ratios=widths)[0]
    for axes, panel, out in zip(all_axes, panels, outside, strict=True):
        values = [0.0]
        for name, (x, y) in panel.curves.items():
            x, y = np.asarray(x, float), np.asarray(y, float)
            if x.ndim != 1 or x.shape != y.shape:
                raise ValueError(
                    f"draw_curves: {name!r} has x of shape {x.shape} and y of {y.shape}"
                )
            marker = "." if len(x) <= _FEW else ""
            axes.plot(x, y, marker=marker, lw=1.6, label=name, **ink[name])
            values.extend(y[np.isfinite(y)])
        steps = np.concatenate([np.ravel(x) for x, _ in panel.curves.values()])
        if "x" in panel.log:
            axes.set_xscale("log")
        elif steps.size and (steps == np.rint(steps)).all():
            axes.xaxis.get_major_locator().set_params(integer=True)
        if "y" in panel.log:
            axes.set_yscale("log")
        else:
            axes.set_ylim(0, panel.top or 1.05 * max(values) or 1)
        axes.set(xlabel=panel.x, ylabel=panel.y, title=panel.title)
        style(axes)
        if any(panel.curves):
            place: dict[str, Any] = {"loc": panel.legend}
            if out:
                place = {"loc": "center left", "bbox_to_anchor": (1.01, 0.5)}
            box = axes.legend(fontsize=8, labelcolor=INK, framealpha=0.9, **place)
            box.get_frame().set(edgecolor=PALE, linewidth=0.6)
    if title:
        figure.suptitle(title, color=INK, size=13)
    return save(figure, path)


def draw_error_curves(
    errors: Mapping[str, Float[ArrayLike, " p"]],
    *,
    limit: float = 0.25,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
) -> "Figure":
    """Draw the share of points whose error is at most each threshold.

    Args:
        errors: label -> errors of points; nan counts as above every threshold.
        limit: the last threshold.
        path, title: as in `draw_curves`.

    Returns:
        As `draw_curves`; a label has the mean error behind it.

    Raises:
        ImportError, ValueError: as `draw_curves`; ValueError also for no errors, or a
            limit that is not positive.
    """
    if not limit > 0:
        raise ValueError(f"draw_error_curves: limit is {limit}, it must be positive")
    at = np.linspace(0, limit, 201)
    curves = {
        f"{name} (mean {np.nanmean(values):.3f})": (at, 100 * error_curve(values, at))
        for name, values in errors.items()
    }
    axes = "geodesic error / sqrt(area)", "points within it, %"
    panel = Panel(curves, *axes, top=102, legend="lower right")
    return draw_curves([panel], path=path, title=title)


def draw_functional_map(
    C_yx: Float[ArrayLike, "k_x k_y"],
    *,
    size: int | None = None,
    path: str | os.PathLike[str] | None = None,
    title: str | None = None,
) -> "Figure":
    """Draw a functional map as a matrix: blue below 0, white at 0, red above.

    Near the diagonal for shapes that are nearly isometric; +-1 where an eigenfunction
    of Y is one of X.

    Args:
        C_yx: functions on Y pulled back to X.
        size: rows and columns to draw, from the first; all when absent.
        path, title: as in `draw_curves`.

    Returns:
        As `draw_curves`.

    Raises:
        ImportError, ValueError: as `draw_curves`; ValueError also for what is not a
            finite matrix.
    """
    check_png(path)
    C_yx = np.asarray(C_yx, float)
    if C_yx.ndim != 2 or not C_yx.size or not np.isfinite(C_yx).all():
        raise ValueError(
            f"draw_functional_map: C_yx is a finite matrix (k_x, k_y); got {C_yx.shape}"
        )
    C_yx = C_yx[:size, :size]
    figure = new_figure(3.9, 3.6 + (0.35 if title else 0))
    figure.set_layout_engine("constrained")
    axes, strip = figure.subplots(1, 2, width_ratios=(1, 0.04))
    axes.imshow(diverging(C_yx), interpolation="nearest", aspect="auto")
    axes.set(xlabel="eigenfunctions of Y", ylabel="eigenfunctions of X")
    ends = np.linspace(1, -1, 256)[:, None]
    strip.imshow(diverging(ends), extent=(0, 1, -1, 1), aspect="auto")
    strip.yaxis.tick_right()
    strip.set(xticks=[], yticks=[-1, 0, 1])
    for part in (axes, strip):
        style(part)
        part.grid(False)
    if title:
        figure.suptitle(title, color=INK, size=13)
    return save(figure, path)
