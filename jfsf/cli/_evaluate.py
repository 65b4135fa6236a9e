"""jfsf evaluate: the figures of a map, against ground truth if it is given."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from jfsf.cli._files import MeshX, MeshY, can_write, read_pair
from jfsf.cli._report import figures_of


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
    base: Annotated[
        int | None,
        typer.Option(
            min=0, max=1, help="First index in text files that break the convention."
        ),
    ] = None,
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

    Distances are geodesic and relative to sqrt(area).

    Example: jfsf evaluate a.off b.off map.npz --gt-x a.vts --gt-y b.vts --every 5
    """
    if json_file is not None:
        can_write(json_file, ".json")
    mesh_x, mesh_y, maps, truth = read_pair(
        x, y, map_file, gt_x, gt_y, base, mend=repair
    )
    figures = figures_of(mesh_x, mesh_y, maps, truth, exact, every)
    shown = Table(title=map_file.name)
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    for name, value in figures.items():
        shown.add_row(name.replace("_", " "), f"{value:.4g}")
    Console().print(shown)
    if json_file is not None:
        from jfsf import __version__
        from jfsf.storage import write_text

        record = {
            "x": str(x),
            "y": str(y),
            "map": str(map_file),
            "ground_truth": None if truth is None else [str(gt_x), str(gt_y)],
            "geodesics": "exact" if exact else "heat method",
            "every": every,
            "repair": repair,
            "jfsf": __version__,
            "figures": figures,
        }
        write_text(json_file, json.dumps(record, indent=2) + "\n")
