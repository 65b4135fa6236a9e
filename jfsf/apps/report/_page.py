"""A match as one page for the browser that needs no network."""

import os
import platform
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.apps.plot import draw_error_curves, draw_functional_map, draw_pair, draw_shape
from jfsf.apps.plot._charts import draw_reliability
from jfsf.apps.plot._colours import body_colours, matched_colours
from jfsf.apps.plot._frames import Up, frames_of_pair
from jfsf.apps.report._candidates import Considered, considered
from jfsf.apps.report._html import level, page
from jfsf.apps.report._measured import measure
from jfsf.apps.report._scene import (
    Shown,
    data_url,
    lifted_maps,
    scene,
    shown,
    shown_maps,
    shown_matched,
)
from jfsf.apps.report._words import findings, readings, reasons, verdict
from jfsf.initial import Orientation
from jfsf.matching import Settings
from jfsf.matching._arguments import checked_map
from jfsf.storage._atomic import write_text
from jfsf.types import STAGES, ArrayLike, Maps, Match, Mesh

_FEW = 6000  # vertices by which candidates are drawn and compared
_SMALL, _LARGE = 60, 110  # dots per inch
# Mean distance of images, where 1 is the size of Y, up to which a map is a candidate's.
_SAME = 0.25


class Side(NamedTuple):
    """A shape of a pair.

    mesh: as it was matched.
    name: for the titles, such as the file.
    numbers: (n,) the file's numbers of its vertices; None if they are the mesh's.
    """

    mesh: Mesh
    name: str
    numbers: Int[ArrayLike, " n"] | None = None


def write_report(
    path: str | os.PathLike[str],
    x: Side,
    y: Side,
    found: Match,
    *,
    orientation: Orientation = "preserve",
    truth: tuple[Int[ArrayLike, " p"], Int[ArrayLike, " p"]] | None = None,
    up: Up = "y",
    settings: Settings = Settings(),
    seconds: Mapping[str, float] | None = None,
    timed: bool = True,
    cache: bool = True,
    progress: Callable[[str], object] | None = None,
) -> str:
    """Write a match as one HTML page: both shapes to turn and click, and the evidence.

    Args:
        path: the page, written completely or not at all.
        x, y: both shapes.
        found: their match.
        orientation: as it was asked for.
        truth: vertices of X and of Y that correspond, counted as the meshes'.
        up: the axis of X's mesh that points up.
        settings: with which it was made.
        seconds: what took how long, for the table.
        timed: put the date and that table on the page. Without them equal matches make
            equal pages.
        cache: as in `jfsf.match`; the search is made once more, for its candidates.
        progress: called with the name of each step as it begins.

    Returns:
        A picture of the pair, as the address of an image (`data:`).

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: maps or ground truth that do not fit the meshes.
    """
    name, (n_x, n_y) = "write_report", (len(x.mesh.vertices), len(y.mesh.vertices))
    checked_map(found.T_xy, found.matched_x, (n_x, n_y), caller=name)
    back = {"called": ("T_yx", "matched_y"), "names": ("Y", "X")}
    checked_map(found.T_yx, found.matched_y, (n_y, n_x), caller=name, **back)
    step = progress or (lambda name: None)
    seconds = dict(seconds or {})
    if found.info is not None:
        stages = zip(STAGES, found.info.seconds, strict=True)
        seconds |= {f"matching: {name}": s for name, s in stages if not np.isnan(s)}
    started = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal started
        now = time.perf_counter()
        seconds[name], started = now - started, now

    step("frames of the shapes")
    axes_x, axes_y = frames_of_pair(
        x.mesh, y.mesh, found.T_xy, up=up, matched_x=found.matched_x
    )
    shown_x, shown_y = shown(x.mesh, axes_x), shown(y.mesh, axes_y)
    few_x, few_y = shown(x.mesh, axes_x, _FEW), shown(y.mesh, axes_y, _FEW)
    step("figures")
    measured = measure(x.mesh, y.mesh, found, truth)
    lap("figures")
    step("candidates")
    candidates = []
    if found.matched_x is None:  # parts are not found by the search
        candidates = considered(
            x.mesh,
            y.mesh,
            at=(few_x.index, few_y.index),
            orientation=orientation,
            settings=settings,
            cache=cache,
        )
    lap("candidates")
    step("pictures")
    maps = {"the map found": shown_maps(found, shown_x, shown_y)}
    rows = []
    own = shown_maps(found, few_x, few_y)
    apart = [_distance(own, one.maps, few_y) for one in candidates]
    for i, one in enumerate(candidates):
        name = f"candidate {i + 1}"
        maps[name] = lifted_maps(one.maps, (few_x, few_y), (shown_x, shown_y))
        nearest = apart[i] == min(apart) and apart[i] < _SAME
        rows.append(_candidate(name, one, few_x, few_y, nearest))
    few_matched = shown_matched(found, few_x, few_y) or (None, None)
    picture = _pair_picture(few_x, few_y, own, few_matched)
    colours = body_colours(few_y.body.vertices)[own.T_xy]
    colours = matched_colours(colours, few_matched[0])
    pictures = {
        "pair": picture,
        "found": data_url(draw_shape(few_x.body, colours), _SMALL),
        "functional_map": data_url(draw_functional_map(found.C_yx, size=60), _LARGE),
    }
    if measured.errors is not None:
        curves = draw_error_curves({"the map": measured.errors})
        pictures["errors"] = data_url(curves, _LARGE)
    if measured.reliability is not None:
        chart = draw_reliability({"the vertices": measured.reliability})
        pictures["reliability"] = data_url(chart, _LARGE)
    member = found.membership_x
    figures = {
        "error": measured.error,
        "there and back": measured.back,
        "doubt": measured.doubt,
        "not shared": None if member is None else 1 - np.asarray(member),
    }
    record = {
        "title": f"{x.name} to {y.name}",
        "x": {"name": x.name, "vertices": len(x.mesh.vertices)},
        "y": {"name": y.name, "vertices": len(y.mesh.vertices)},
        "shown": [len(shown_x.index), len(shown_y.index)],
        "verdict": _verdict(float(found.certificate.confidence)),
        "reasons": reasons(found.certificate, found.info),
        "findings": [one._asdict() for one in findings(found.certificate, orientation)],
        "certificate": [
            (name.replace("_", " "), *texts)
            for name, texts in readings(found.certificate).items()
        ],
        "figures": measured.rows,
        "truth": measured.truth_rows,
        "candidates": rows,
        "pictures": pictures,
        "scene": scene(
            shown_x,
            shown_y,
            maps,
            {
                name: values[shown_x.index]
                for name, values in figures.items()
                if values is not None
            },
            (x.numbers, y.numbers),
            shown_matched(found, shown_x, shown_y),
        ),
        "settings": {"orientation": orientation, **settings.as_record()},
        "versions": versions(),
        "seconds": {},
    }
    lap("page")
    if timed:
        record["seconds"] = {name: round(took, 2) for name, took in seconds.items()}
    else:
        del record["versions"]["date"]
    write_text(path, page("report", record))
    return picture


def versions() -> dict[str, str]:
    """Of python and the packages that decide the result, the device, and the date."""
    import jax

    from jfsf import __version__

    device = jax.devices()[0]
    return {
        "jfsf": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in ("jax", "jaxlib", "numpy", "scipy")},
        "device": f"{device.platform} {device.device_kind}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _verdict(confidence: float) -> dict[str, Any]:
    known = None if np.isnan(confidence) else confidence
    words = verdict(confidence)
    return {"words": words, "level": level(confidence), "confidence": known}


def _candidate(name, one: Considered, x: Shown, y: Shown, nearest: bool):
    colours = body_colours(y.body.vertices)[one.maps.T_xy]
    score = None if np.isnan(one.orientation) else one.orientation
    return {
        "name": name,
        "picture": data_url(draw_shape(x.body, colours), _SMALL),
        "energy": one.energy,
        "orientation": score,
        "nearest": bool(nearest),
    }


def _pair_picture(x: Shown, y: Shown, maps: Maps, matched) -> str:
    inside = dict(zip(("matched_x", "matched_y"), matched, strict=True))
    figure = draw_pair(x.body, y.body, maps.T_xy, **inside)
    return data_url(figure, _SMALL)


def _distance(one: Maps, other: Maps, y: Shown) -> float:
    """Mean distance on Y of the images of X, where 1 is the spread of Y."""
    points = y.body.vertices
    away = np.linalg.norm(points[one.T_xy] - points[other.T_xy], axis=1)
    spread = np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean())
    return float(away.mean() / (spread or 1))
