"""Charts of specimens: two components, and size against regression score."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from jfsf.apps.morphometrics._statistics import Allometry, Components
from jfsf.apps.plot._panels import INK, LINES, PALE, new_figure, save, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKS = "osD^vP"  # with the seven colours, 42 groups that differ
POINT = 28  # area of a mark, in square points
# Where a name stands beside its point, in points, the first that is free.
BESIDE = (4, 3), (-4, 3), (4, -3), (-4, -3)


def draw_components(
    path: Path | None,
    found: Components,
    names: Sequence[str],
    groups: Sequence[str],
) -> "Figure":
    """Draw the first two components, both to one scale.

    Args:
        path: the PNG to write; None writes none.
        found: the components; with fewer than two, the scores are 0.
        names: of the specimens; those that have room are written.
        groups: of the specimens; none if all are "".
    """
    scores = np.zeros((len(names), 2))
    scores[:, : found.scores.shape[1]] = found.scores[:, :2]
    x, y = scores.T
    shares = [*found.share[:2], 0, 0][:2]
    labels = [f"PC{i} ({share:.1%})" for i, share in enumerate(shares, 1)]
    figure, axes = _scatter(x, y, groups)
    axes.axhline(0, color=PALE, lw=0.8, zorder=0)
    axes.axvline(0, color=PALE, lw=0.8, zorder=0)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_aspect("equal", adjustable="datalim")
    _name(figure, axes, x, y, names)
    return save(figure, path)


def draw_allometry(
    path: Path | None,
    found: Allometry,
    sizes: Float[np.ndarray, " s"],
    names: Sequence[str],
    groups: Sequence[str],
) -> "Figure":
    """Draw regression scores against the logarithm of size, with the fit.

    Args:
        path: the PNG to write; None writes none.
        found: the regression.
        sizes: centroid sizes.
        names: of the specimens; those that have room are written.
        groups: of the specimens; none if all are "".
    """
    log = np.log(sizes)
    figure, axes = _scatter(log, found.scores, groups)
    ends = np.array([log.min(), log.max()])
    line = (ends - log.mean()) * np.linalg.norm(found.slope)
    axes.plot(ends, line, color=INK, lw=1.2, zorder=1)
    axes.set(
        xlabel="ln centroid size",
        ylabel="regression score",
        title=f"R² {found.share:.1%}, p {found.p:.2g}",
    )
    _name(figure, axes, log, found.scores, names)
    return save(figure, path)


def _scatter(x, y, groups):
    """A figure with a point for each specimen, in the colour of its group."""
    figure = new_figure(6.4, 5.0)
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    known, marks = sorted(set(groups) - {""}), []
    for i, group in enumerate(known):
        at = np.array([own == group for own in groups])
        colour, mark = LINES[i % len(LINES)], MARKS[i // len(LINES) % len(MARKS)]
        marks.append(axes.scatter(x[at], y[at], s=POINT, color=colour, marker=mark))
    if (none := np.array([not own for own in groups])).any():
        colour = "none" if known else LINES[0]
        own = axes.scatter(x[none], y[none], s=POINT, color=colour, edgecolor=INK)
        known, marks = known and [*known, "none"], [*marks, own]
    axes.margins(0.08)
    style(axes)
    if known:
        place = {"loc": "outside upper center", "ncols": min(4, len(known))}
        # A label that begins with a low line would be left out.
        labels = [group if group[0] != "_" else f" {group}" for group in known]
        box = figure.legend(marks, labels, fontsize=8, frameon=False, **place)
        for text in box.get_texts():
            text.set(color=INK, parse_math=False)
    return figure, axes


def _name(figure, axes, x, y, names):
    """Write the names that have room, those far from the middle first."""
    figure.draw_without_rendering()  # now the axes have their place
    at = axes.transData.transform(np.column_stack([x, y]))
    half = np.sqrt(POINT) / 2 * figure.dpi / 72
    taken = [np.concatenate([at - half, at + half], axis=1)]  # left, low, right, high
    frame = axes.bbox
    away = np.hypot(*((at - np.median(at, axis=0)) / [frame.width, frame.height]).T)
    for i in np.argsort(-away):
        for right, up in BESIDE:
            text = axes.annotate(
                names[i],
                (x[i], y[i]),
                (right, up),
                textcoords="offset points",
                ha="left" if right > 0 else "right",
                va="bottom" if up > 0 else "top",
                fontsize=7,
                color=INK,
                parse_math=False,  # $ in names
            )
            left, low, end, high = box = text.get_window_extent().extents
            others = np.concatenate(taken)
            meets = (others[:, 0] < end) & (others[:, 2] > left)
            meets &= (others[:, 1] < high) & (others[:, 3] > low)
            inside = frame.x0 < left and end < frame.x1
            if inside and frame.y0 < low and high < frame.y1 and not meets.any():
                taken.append(box[None])
                break
            text.remove()
