"""jfsf evaluate: the figures of a map, against ground truth if it is given."""

import json
import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._files import can_write
from jfsf.apps.cli._print import say_result
from jfsf.apps.cli._stored import read_pair, stored_match

ERROR_LIMITS = (0.01, 0.02, 0.05, 0.1)  # geodesic over sqrt(area), for the curve


def evaluate(
    x: opt.MeshX,
    y: opt.MeshY,
    map_file: opt.MapFile,
    gt_x: opt.GroundTruthX = None,
    gt_y: opt.GroundTruthY = None,
    exact: Annotated[
        bool, typer.Option("--exact", help="Exact geodesics, slow (needs pygeodesic).")
    ] = False,
    every: Annotated[
        int, typer.Option(min=1, help="Measure at every Nth point and vertex.")
    ] = 1,
    base: opt.BaseOption = None,
    repair: opt.MapRepairOption = False,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures here too.")
    ] = None,
) -> None:
    """Measure a map, against ground truth if it is given.

    Distances are geodesic and relative to sqrt(area). Points of the ground truth on
    vertices that belong to no face, or that were not matched, are left out and counted.

    Example: jfsf evaluate a.off b.off map.npz --gt-x a.vts --gt-y b.vts --every 5
    """
    from jfsf.apps.mapfiles import read_map

    if json_file is not None:
        can_write(json_file, ".json")
    mesh_x, mesh_y, maps, truth = read_pair(
        x, y, map_file, gt_x, gt_y, base, mend=repair
    )
    points = left_out = None
    why = ""
    if truth is not None:
        points = len(read_map(gt_x, base=base))  # type: ignore
        left_out = points - len(truth[0])
        match = stored_match(map_file)
        parts = match is not None and match.matched_x is not None
        why = _why_left_out(maps, parts, repair)
        if left_out == points:
            raise ValueError(
                f"{gt_x}, {gt_y}: all {points} points are left out, {why}; are the "
                "files those of these meshes?"
            )
    figures = figures_of(mesh_x, mesh_y, maps, truth, exact, every)
    shown = Table(title=escape(map_file.name))
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    for name, value in figures.items():
        text = f"{value:.4g}" if math.isfinite(value) else "no finite distance"
        shown.add_row(name.replace("_", " "), text)
    notes, doubts = [], []
    if left_out:
        are = "is" if left_out == 1 else "are"
        notes = [f"ground truth: {left_out} of {points} points {are} left out, {why}"]
    if not all(map(math.isfinite, figures.values())):
        doubts = ["no finite distance: the map takes some points to another piece"]
    say_result([shown], notes, doubts, ())
    if json_file is not None:
        from jfsf import __version__
        from jfsf.storage._atomic import write_text

        record = {
            "x": str(x),
            "y": str(y),
            "map": str(map_file),
            "ground_truth": None if truth is None else [str(gt_x), str(gt_y)],
            "geodesics": "exact" if exact else "heat method",
            "every": every,
            "repair": repair,
            "points": points,
            "points_left_out": left_out,
            "jfsf": __version__,
            # JSON has no infinity.
            "figures": {n: v if math.isfinite(v) else None for n, v in figures.items()},
        }
        write_text(json_file, json.dumps(record, indent=2) + "\n")


def _why_left_out(maps, parts: bool, repair: bool) -> str:
    """Why points of the ground truth are left out."""
    known = ["the repair removes"] if repair else []
    if parts or maps.index_x is not None or maps.index_y is not None:
        known.append("were not matched")
    return f"on vertices that {' or '.join(known or ['belong to no face'])}"


def figures_of(mesh_x, mesh_y, maps, truth, exact, every) -> dict[str, float]:
    """The figures of a map that can be measured, by name; a bar shows the progress."""
    from jfsf.evaluate import auc, error_curve, evaluate

    with Progress(console=Console(stderr=True), transient=True) as bars:
        tasks = {}

        def show(name, done, total):
            if name not in tasks:
                tasks[name] = bars.add_task(name.replace("_", " "), total=total)
            bars.update(tasks[name], completed=done, total=total)

        measured = evaluate(
            maps,
            mesh_x,
            mesh_y,
            truth=truth,
            every=every,
            exact=exact,
            progress=show,
        )
    figures: dict[str, float] = {}
    errors = measured.error[~np.isnan(measured.error)]
    for name, value in measured._asdict().items():
        # How many points were left out is no figure of the map.
        if name not in ("error", "error_left_out") and not np.isnan(value):
            figures[name] = value
        if name == "error_max" and len(errors):
            shares = error_curve(errors, ERROR_LIMITS)
            for limit, share in zip(ERROR_LIMITS, shares, strict=True):
                figures[f"share_within_{limit}"] = float(share)
            figures["auc_0.25"] = auc(errors, limit=0.25)
    return figures
