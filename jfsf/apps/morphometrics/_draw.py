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
    figure, axes = _scatter(*scores.T, names, groups)
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
    known = sorted(set(groups))
    for i, group in enumerate(known):
        at = np.array([own == group for own in groups])
        colour, mark = LINES[i % len(LINES)], MARKS[i // len(LINES) % len(MARKS)]
        if len(known) > 1 and not group:
            colour, group = PALE, "no group"
        axes.scatter(x[at], y[at], s=28, color=colour, marker=mark, label=group)
    if len(names) <= NAMED:
        for name, *place in zip(names, x, y, strict=True):
            axes.annotate(
                name,
                place,
                (4, 3),
                textcoords="offset points",
                fontsize=7,
                color=INK,
                parse_math=False,  # $ in names
            )
    axes.margins(0.12)
    style(axes)
    if any(known):
        box = axes.legend(fontsize=8, labelcolor=INK, framealpha=0.9)
        box.get_frame().set(edgecolor=PALE, linewidth=0.6)
    return figure, axes
