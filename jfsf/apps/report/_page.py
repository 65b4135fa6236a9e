"""A match as one page for the browser that needs no network."""

import os
import platform
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.apps.plot import draw_pair, draw_shape
from jfsf.apps.plot._charts import draw_error_curves, draw_functional_map
from jfsf.apps.plot._colours import body_colours, matched_colours
from jfsf.apps.plot._frames import Up, frames_of_pair
from jfsf.apps.report._candidates import candidate_maps
from jfsf.apps.report._html import data_url, page
from jfsf.apps.report._measured import measure
from jfsf.apps.report._scene import (
    Shown,
    scene,
    shown,
    shown_maps,
    shown_matched,
)
from jfsf.apps.report._words import findings, level, readings, reasons, verdict
from jfsf.initial._search import Orientation
from jfsf.matching import Settings
from jfsf.matching._arguments import checked_map
from jfsf.storage._atomic import write_text
from jfsf.types import STAGES, ArrayLike, Maps, Match, MatchInfo, Mesh

_SMALL, _LARGE = 60, 110  # dots per inch
# Mean distance of images, where 1 is the size of Y, up to which a map is a candidate's.
_SAME = 0.25


class Side(NamedTuple):
    """A shape of a pair.

    mesh: the mesh that was matched.
    name: what the page calls it, such as its file.
    numbers: (n,) the number in the file of each vertex; None if the mesh has the file's
        numbers.
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
        orientation: the orientation that was asked for.
        truth: vertices of X and of Y that correspond, numbered as in the meshes.
        up: the axis of X's mesh that points up.
        settings: the settings that the match was made with.
        seconds: seconds by the name of a step, for the table of times.
        timed: put the date and the table of times on the page. Without them equal
            matches make equal pages.
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
    step("frames of the shapes")
    axes_x, axes_y = frames_of_pair(
        x.mesh, y.mesh, found.T_xy, up=up, matched_x=found.matched_x
    )
    shown_x, shown_y = both = shown(x.mesh, axes_x), shown(y.mesh, axes_y)
    step("figures")
    measured = measure(x.mesh, y.mesh, found, truth)
    step("candidates")
    candidates = []
    if found.matched_x is None:  # parts are not found by the search
        at = shown_x.index, shown_y.index
        options = {"orientation": orientation, "settings": settings, "cache": cache}
        candidates = candidate_maps(x.mesh, y.mesh, at, **options)
    step("pictures")
    own, matched = shown_maps(found, *both), shown_matched(found, *both)
    maps = {"the map found": own}
    maps |= {f"candidate {i}": one.maps for i, one in enumerate(candidates, 1)}
    inside_x, inside_y = matched or (None, None)
    pair = draw_pair(
        shown_x.body,
        shown_y.body,
        own.T_xy,
        names=(x.name, y.name),
        matched_x=inside_x,
        matched_y=inside_y,
    )
    pictures = {
        "pair": data_url(pair, _SMALL),
        "found": _painted(*both, own, inside_x),
        "functional_map": data_url(draw_functional_map(found.C_yx, size=60), _LARGE),
    }
    if measured.errors is not None:
        curves = draw_error_curves({"the map": measured.errors})
        pictures["errors"] = data_url(curves, _LARGE)
    figures = {
        "error": measured.error,
        "there and back": measured.back,
        "doubt": measured.doubt,
    }
    if found.membership_x is not None:
        figures["not shared"] = 1 - np.asarray(found.membership_x)
    evidence = found.certificate
    likely = float(evidence.confidence)
    record = {
        "title": f"{x.name} to {y.name}",
        "x": {"name": x.name, "vertices": n_x},
        "y": {"name": y.name, "vertices": n_y},
        "shown": [len(side.index) for side in both],
        "verdict": {
            "words": verdict(likely),
            "level": level(likely),
            "confidence": None if np.isnan(likely) else likely,
        },
        "reasons": reasons(evidence, found.info),
        "findings": [one._asdict() for one in findings(evidence, orientation)],
        "certificate": [
            (name.replace("_", " "), *texts)
            for name, texts in readings(evidence).items()
        ],
        "figures": measured.rows,
        "truth": measured.truth_rows,
        "candidates": _candidates(candidates, own, *both),
        "pictures": pictures,
        "scene": scene(
            *both,
            maps,
            {name: v[shown_x.index] for name, v in figures.items() if v is not None},
            (x.numbers, y.numbers),
            matched,
        ),
        "settings": {"orientation": orientation, **settings.as_record()},
        "versions": versions(date=timed),
        "seconds": _seconds(found.info, seconds or {}) if timed else {},
    }
    write_text(path, page("report", record))
    return pictures["pair"]


def versions(*, date: bool = True) -> dict[str, str]:
    """Of python and the packages that decide the result, the device, and the date."""
    import jax

    from jfsf import __version__

    device = jax.devices()[0]
    now = {"date": datetime.now(UTC).isoformat(timespec="seconds")}
    return {
        "jfsf": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in ("jax", "jaxlib", "numpy", "scipy")},
        "device": f"{device.platform} {device.device_kind}",
        **(now if date else {}),
    }


def _seconds(info: MatchInfo | None, seconds: Mapping[str, float]) -> dict[str, float]:
    """What took how long, with the stages of the match that were run."""
    stages = zip(STAGES, () if info is None else info.seconds, strict=False)
    all_of = {**seconds, **{f"matching: {name}": took for name, took in stages}}
    return {n: round(float(took), 2) for n, took in all_of.items() if took == took}


def _candidates(candidates, own: Maps, x: Shown, y: Shown) -> list[dict[str, Any]]:
    """Candidates as plain values; the nearest to the map that was found is marked."""
    apart = [_distance(own, one.maps, y) for one in candidates]
    return [
        {
            "name": f"candidate {i + 1}",
            "picture": _painted(x, y, one.maps),
            "energy": one.energy,
            "orientation": None if np.isnan(one.orientation) else one.orientation,
            "nearest": bool(away == min(apart) and away < _SAME),
        }
        for i, (one, away) in enumerate(zip(candidates, apart, strict=True))
    ]


def _painted(x: Shown, y: Shown, maps: Maps, inside_x=None) -> str:
    """A picture of X in the colours of Y, grey where it is not matched."""
    colours = body_colours(y.body.vertices)[maps.T_xy]
    return data_url(draw_shape(x.body, matched_colours(colours, inside_x)), _SMALL)


def _distance(one: Maps, other: Maps, y: Shown) -> float:
    """Mean distance on Y of the images of X, where 1 is the spread of Y."""
    points = y.body.vertices
    away = np.linalg.norm(points[one.T_xy] - points[other.T_xy], axis=1)
    spread = np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean())
    return float(away.mean() / (spread or 1))
