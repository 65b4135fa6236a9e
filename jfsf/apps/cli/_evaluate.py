"""jfsf evaluate: the figures of a map, against ground truth if it is given."""

import json
import math
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli._files import BaseOption, MeshX, MeshY, can_write
from jfsf.apps.cli._report import figures_of
from jfsf.apps.cli._stored import read_pair, stored_match


def evaluate(
    x: MeshX,
    y: MeshY,
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A file of match, or T_xy as .npz, .mat, .map or .vts.",
        ),
    ],
    gt_x: Annotated[
        Path | None,
        typer.Option(help="Ground truth: line i is the vertex of X at point i."),
    ] = None,
    gt_y: Annotated[
        Path | None, typer.Option(help="The same for Y; text files count from 1.")
    ] = None,
    exact: Annotated[
        bool, typer.Option("--exact", help="Exact geodesics, slow (needs pygeodesic).")
    ] = False,
    every: Annotated[
        int, typer.Option(min=1, help="Measure at every Nth point and vertex.")
    ] = 1,
    base: BaseOption = None,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair", help="Repair the meshes first, for a map of match --repair."
        ),
    ] = False,
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
    console = Console()
    console.print(shown)
    if left_out:
        are = "is" if left_out == 1 else "are"
        line = f"ground truth: {left_out} of {points} points {are} left out, {why}"
        console.print(line, soft_wrap=True, markup=False)
    if not all(map(math.isfinite, figures.values())):
        line = "no finite distance: the map takes some points to another piece"
        console.print(f"warning: {line}", soft_wrap=True, markup=False)
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
