"""The look that all pictures share: figures, fonts, inks, and PNG files written whole.

matplotlib's Agg draws, which needs no display; pyplot and its global state stay
untouched.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jfsf.storage._atomic import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
