"""A shape model as one page: its mean, and a slider for each of the first modes.

The page holds how far each mode moves every vertex at `REACH` standard deviations, and
adds these up: x = mean + sum_k t_k d_k.
"""

import os
from collections.abc import Sequence

import numpy as np

from jfsf.apps.model import ShapeModel
from jfsf.apps.plot import draw_shape
from jfsf.apps.plot._colours import body_colours, ramp
from jfsf.apps.plot._frames import Up, frame, natural_turn
from jfsf.apps.report._html import data_url, packed, page
from jfsf.apps.report._scene import MOST, shape_values
from jfsf.mesh import coarsen
from jfsf.storage._atomic import write_text
from jfsf.types import Mesh

MODES = 6  # sliders
REACH = 3  # standard deviations to either side
_SMALL = 90  # dots per inch


def write_model_page(
    path: str | os.PathLike[str],
    model: ShapeModel,
    names: Sequence[str],
    *,
    title: str = "Shape model",
    modes: int = MODES,
    up: Up = "y",
) -> None:
    """Write a page with the mean of a model and a slider for each of its first modes.

    It needs no network, as all pages. Sliders go from -3 to 3 standard deviations. The
    shapes that the model was fitted to can be chosen: sliders then show their scores.

    Args:
        path: the page, written completely or not at all.
        model: linear modes of positions.
        names: a name for each shape that the model was fitted to, in that order.
        title: above all.
        modes: sliders, at most.
        up: the axis that points up in the model.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: more or fewer names than shapes.
    """
    if len(model.scores) != len(names):
        raise ValueError(
            f"write_model_page: {len(names)} names for a model of {len(model.scores)} "
            "shapes"
        )
    axes, mean = frame(up), np.asarray(model.mean, float)
    coarse, index = coarsen(Mesh(mean, np.asarray(model.faces)), MOST)
    points = mean[index] @ axes
    points = points - (points.min(0) + points.max(0)) / 2
    body = Mesh(points, np.asarray(coarse.faces, np.int32).reshape(-1, 3))
    turn, colours = natural_turn(points), body_colours(points)
    size = float(np.ptp(points, axis=0).max()) or 1.0
    variance = np.asarray(model.variance, float)
    total = float(model.total_variance) or 1.0
    few = min(modes, int((variance > 1e-9 * total).sum()))
    deviation = np.sqrt(variance[:few])
    moved = []
    for mode, far in zip(np.asarray(model.modes), REACH * deviation, strict=False):
        away = far * mode[index] @ axes / size
        unit = float(np.abs(away).max()) / 32767 or 1.0
        moved.append({"unit": unit, "at": packed(away / unit, "<i2")})
    shares = np.cumsum(variance) / total
    record = {
        "title": title,
        "counts": f"{len(names)} shapes, {len(mean):,} vertices",
        "names": list(names),
        "reach": REACH,
        "vertices": len(mean),
        "shape": shape_values(body),
        "colours": packed(255 * colours, "u1"),
        "ramp": packed(255 * ramp(np.linspace(0, 1, 256)), "u1"),
        "turn": turn,
        "picture": data_url(draw_shape(body, colours, turn=turn), _SMALL),
        "modes": moved,
        "scores": (np.asarray(model.scores, float)[:, :few] / deviation).tolist(),
        "rows": [
            (f"mode {k + 1}", f"{variance[k] / total:.1%}", f"{shares[k]:.1%} so far")
            for k in range(len(variance))
        ],
    }
    write_text(path, page("model", record))
