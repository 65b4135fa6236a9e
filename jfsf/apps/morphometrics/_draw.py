"""Charts of specimens: two components, and size against regression score."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jfsf.apps.morphometrics._statistics import Allometry, Components
from jfsf.apps.plot._panels import INK, LINES, PALE, new_figure, save, style

NAMED = 60  # specimens; of more, names would hide the points
MARKS = "osD^vP"  # with the seven colours, 42 groups that differ


def draw_components(
    path: Path, found: Components, names: Sequence[str], groups: Sequence[str]
) -> None:
    """Draw the first two components, both to one scale, as PNG.

    Args:
        path: the file.
        found: the components; with fewer than two, the scores are 0.
        names: of the specimens.
        groups: of the specimens; none if all are "".
    """
    scores = np.zeros((len(names), 2))
    scores[:, : found.scores.shape[1]] = found.scores[:, :2]
    shares = [*found.share[:2], 0, 0][:2]
    labels = [f"PC{i} ({share:.1%})" for i, share in enumerate(shares, 1)]
    figure, axes = _scatter(scores[:, 0], scores[:, 1], names, groups)
    axes.axhline(0, color=PALE, lw=0.8, zorder=0)
    axes.axvline(0, color=PALE, lw=0.8, zorder=0)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_aspect("equal", adjustable="datalim")
    save(figure, path)


def draw_allometry(
    path: Path,
    found: Allometry,
    sizes: Float[np.ndarray, " s"],
    names: Sequence[str],
    groups: Sequence[str],
) -> None:
    """Draw regression scores against the logarithm of size, with the fit, as PNG.

    Args:
        path: the file.
        found: the regression.
        sizes: centroid sizes.
        names: of the specimens.
        groups: of the specimens; none if all are "".
    """
    log = np.log(sizes)
    figure, axes = _scatter(log, found.scores, names, groups)
    ends = np.array([log.min(), log.max()])
    line = (ends - log.mean()) * np.linalg.norm(found.slope)
    axes.plot(ends, line, color=INK, lw=1.2, zorder=1)
    axes.set(
        xlabel="ln centroid size",
        ylabel="regression score",
        title=f"R² {found.share:.1%}, p {found.p:.2g}",
    )
    save(figure, path)


def _scatter(x, y, names, groups):
    """A figure with a point for each specimen, its name, and its group's colour."""
    figure = new_figure(6.4, 5.0)
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    known = sorted(set(groups) - {""})
    for i, group in enumerate(known):
        at = np.array([own == group for own in groups])
        colour, mark = LINES[i % len(LINES)], MARKS[i // len(LINES) % len(MARKS)]
        axes.scatter(x[at], y[at], s=28, color=colour, marker=mark, label=group)
    if (none := np.array([not own for own in groups])).any():
        colour = "none" if known else LINES[0]
        axes.scatter(x[none], y[none], s=28, color=colour, edgecolor=INK, label="none")
    # Names stand towards the middle, where there is room.
    right = x > (x.min() + x.max()) / 2
    for name, place, side in zip(names, zip(x, y, strict=True), right, strict=True):
        axes.annotate(
            name if len(names) <= NAMED else "",
            place,
            (-4 if side else 4, 3),
            textcoords="offset points",
            ha="right" if side else "left",
            fontsize=7,
            color=INK,
            parse_math=False,  # $ in names
        )
    axes.margins(0.08)
    style(axes)
    if known:
        columns = min(4, len(known) + none.any())
        place = {"loc": "outside upper center", "ncols": columns, "frameon": False}
        box = figure.legend(*axes.get_legend_handles_labels(), fontsize=8, **place)
        for text in box.get_texts():
            text.set(color=INK, parse_math=False)
    return figure, axes
