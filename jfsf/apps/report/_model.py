"""A shape model as one page: its mean, and a slider for each of the first modes.

The page holds the displacement of every vertex from the mean at some scores of each
mode (`KNOTS`), and blends between them: x = mean + sum_k d_k(t_k), t_k in standard
deviations. d_k is linear, so that is exact.
"""

import os
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jfsf.apps.model import ShapeModel, shape_at
from jfsf.apps.plot import draw_shape
from jfsf.apps.plot._colours import Up, body_colours, frame, ramp
from jfsf.apps.plot._shading import natural_turn
from jfsf.apps.plot._upright import find_frame
from jfsf.apps.report._html import page
from jfsf.apps.report._scene import data_url, packed, shape_values
from jfsf.mesh import coarsen
from jfsf.storage._atomic import write_text
from jfsf.types import Mesh

MODES = 6  # sliders
MOST = 12_000  # vertices that are shown: all of them move with each slider
REACH = 3  # standard deviations to either side
KNOTS = -REACH, REACH
ABOUT = (
    "Modes of positions: each moves every vertex along a straight line. "
    "The shape is the mean plus the sum of all modes, each as far as its slider says."
)
_SMALL = 90  # dots per inch


def write_model_page(
    path: str | os.PathLike[str],
    models: Sequence[ShapeModel],
    names: Sequence[str],
    *,
    title: str = "Shape model",
    warning: str | None = None,
    modes: int = MODES,
    up: Up | None = None,
) -> None:
    """Write a page with the mean of a model and a slider for each of its first modes.

    It needs no network, as all pages. Sliders go from -3 to 3 standard deviations. The
    shapes that the model was fitted to can be chosen: sliders then show their scores.

    Args:
        path: the page, written completely or not at all.
        models: of the same shapes, in the order in which they are offered.
        names: of the shapes that the models were fitted to, in that order.
        title: above all.
        warning: what to say of the model.
        modes: sliders, at most.
        up: the axis that points up in the models; found when absent.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: no model, or more or fewer names than shapes.
    """
    if not models:
        raise ValueError("write_model_page: has no model; give one or more")
    for model in models:
        if len(model.scores) != len(names):
            raise ValueError(
                f"write_model_page: {len(names)} names for a model of "
                f"{len(model.scores)} shapes"
            )
    # All models show the same vertices.
    first = models[0]
    few = coarsen(Mesh(np.asarray(first.mean), np.asarray(first.faces)), MOST)
    record = {
        "title": title,
        "counts": f"{len(names)} shapes, {len(models[0].mean):,} vertices",
        "names": list(names),
        "reach": REACH,
        "warning": warning,
        "models": [_values(model, *few, modes, up) for model in models],
        "ramp": packed(255 * ramp(np.linspace(0, 1, 256)), "u1"),
    }
    write_text(path, page("model", record))


def displacements(
    model: ShapeModel, mode: int, knots: Sequence[float]
) -> Float[np.ndarray, "t n 3"]:
    """How far a mode moves each vertex from the mean, at scores in deviations.

    Args:
        model: of shapes.
        mode: from 0.
        knots: scores, in standard deviations of the mode.
    """
    mean = np.asarray(model.mean)
    unit = jnp.zeros(len(model.modes), model.mean.dtype).at[mode]
    reach = float(np.sqrt(np.asarray(model.variance)[mode]))
    whole = np.asarray(shape_at(model, unit.set(reach))) - mean
    return np.stack([t * whole for t in knots])


def _values(model: ShapeModel, coarse: Mesh, index, modes: int, up: Up | None):
    """A model as plain values for JSON; the vertices of this index are shown."""
    mean = Mesh(np.asarray(model.mean, float), np.asarray(model.faces))
    axes = find_frame(mean).axes if up is None else frame(up)
    points = mean.vertices[index] @ axes
    points = points - (points.min(0) + points.max(0)) / 2
    body = Mesh(points, np.asarray(coarse.faces, np.int32).reshape(-1, 3))
    turn = natural_turn(body.vertices)
    colours = body_colours(body.vertices)
    size = float(np.ptp(body.vertices, axis=0).max()) or 1.0
    variance = np.asarray(model.variance, float)
    total = float(model.total_variance) or 1.0
    few = min(modes, int((variance > 1e-9 * total).sum()))
    deviation = np.sqrt(variance[:few])
    moved = []
    for k in range(few):
        at = displacements(model, k, KNOTS)[:, index] @ axes / size
        unit = float(np.abs(at).max()) / 32767 or 1.0
        moved.append({"unit": unit, "at": [packed(d / unit, "<i2") for d in at]})
    shares = np.cumsum(variance) / total
    return {
        "kind": "positions",
        "about": ABOUT,
        "vertices": len(mean.vertices),
        "shape": shape_values(body),
        "colours": packed(255 * colours, "u1"),
        "turn": turn,
        "picture": data_url(draw_shape(body, colours, up="y", turn=turn), _SMALL),
        "knots": list(KNOTS),
        "modes": moved,
        "scores": (np.asarray(model.scores, float)[:, :few] / deviation).tolist(),
        "rows": [
            (f"mode {k + 1}", f"{variance[k] / total:.1%}", f"{shares[k]:.1%} so far")
            for k in range(len(variance))
        ],
    }
