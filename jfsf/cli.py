"""jfsf demo | match | batch | evaluate | info: the command line.

Exit codes: 0 done, 1 bad input (one line on stderr says which), 2 wrong usage.
"""

import json
import os
import warnings
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from typer.core import TyperGroup

from jfsf.cli_batch import batch
from jfsf.cli_files import (
    Orientation,
    OrientationOption,
    can_write,
    matchable,
    need_matplotlib,
    one_sided,
    read_landmarks,
    read_pair,
    validate,
    write_found,
)
from jfsf.cli_report import certificate_table, figures_of, warnings_of


class _OneLine(TyperGroup):
    """Turns what bad input raises into one line on stderr and exit code 1."""

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except (ValueError, ImportError, OSError) as error:
            typer.echo(f"jfsf: {' '.join(str(error).split())}", err=True)
            raise typer.Exit(1) from None


app = typer.Typer(
    name="jfsf",
    cls=_OneLine,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Up(StrEnum):
    x = "x"
    y = "y"
    z = "z"


FORMATS = "OFF, OBJ, PLY, STL, GLB or glTF file."
MeshX = Annotated[Path, typer.Argument(metavar="X", help=FORMATS)]
MeshY = Annotated[Path, typer.Argument(metavar="Y", help=FORMATS)]
UpAxis = Annotated[Up, typer.Option(help="Axis that points up, for the picture.")]


def main() -> None:
    """The entry point: `app`, with compiled programs kept between processes."""
    app(obj="keep compiled programs")


def _version(asked: bool) -> None:
    if asked:
        from jfsf import __version__

        typer.echo(f"jfsf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Print it and stop."
        ),
    ] = False,
) -> None:
    """Dense maps between non-rigid 3D shapes: Fast Sinkhorn Filters in JAX."""


@app.command()
def demo(
    ctx: typer.Context,
    pair: Annotated[
        tuple[str, str], typer.Option(help="Two embedded shapes, X and Y.")
    ] = ("man_walk", "man_up"),
    out: Annotated[Path, typer.Option(help="Folder for the JSON and the PNG.")] = Path(
        "jfsf-demo"
    ),
) -> None:
    """Match two embedded shapes; compare nearest neighbour and Sinkhorn.

    Example: jfsf demo --pair man_walk woman_up --out results
    """
    from jfsf import demo as demos

    _keep_compiled(ctx, True)
    out.mkdir(parents=True, exist_ok=True)
    with _status("starting ...") as status:
        result = demos.measure(*pair, lambda what: status.update(f"{what} ..."))
        status.update("drawing ...")
        written = demos.write(result, out)
    console = Console()
    console.print(demos.table(result.record))
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


@app.command()
def match(
    ctx: typer.Context,
    x: MeshX,
    y: MeshY,
    out: Annotated[Path, typer.Option(help="The .npz to write.")],
    png: Annotated[
        Path | None, typer.Option(help="A picture of the map (needs matplotlib).")
    ] = None,
    orientation: OrientationOption = Orientation.preserve,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            help="Text file of known pairs: a line holds a vertex of X and one of Y, "
            "counted from 0."
        ),
    ] = None,
    largest_component: Annotated[
        bool,
        typer.Option(
            "--largest-component",
            help="Match the largest pieces only. Maps then count kept vertices; "
            "index_x and index_y in the file hold their numbers in X and Y.",
        ),
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Leave the cache folder alone.")
    ] = False,
    up: UpAxis = Up.y,
) -> None:
    """Map two meshes to each other, both ways.

    Writes T_xy (the vertex of Y for each vertex of X), T_yx (the other way; both int32,
    counted from 0), C_yx (the functional map) and certificate_* (evidence of quality).

    Example: jfsf match cat.off lion.off --out map.npz --png map.png
    """
    from jfsf.match import match as match_meshes
    from jfsf.viz import draw_pair

    can_write(out, ".npz")
    if png is not None:
        can_write(png, ".png")
        need_matplotlib()
    mesh_x, index_x = matchable(x, largest_component)
    mesh_y, index_y = matchable(y, largest_component)
    pairs = None
    if landmarks is not None:
        pairs = read_landmarks(landmarks, (index_x, index_y))
    _keep_compiled(ctx, not no_cache)
    with _status("matching (the first time, this compiles) ...") as status:
        found = match_meshes(
            mesh_x,
            mesh_y,
            orientation=orientation.value,
            landmarks=pairs,  # type: ignore
            cache=not no_cache,
        )
        status.update("writing ...")
        write_found(out, found, index_x=index_x, index_y=index_y)
        if png is not None:
            T_xy = np.asarray(found.T_xy)
            draw_pair(mesh_x, mesh_y, T_xy, path=png, up=up.value)
    console = Console()
    console.print(certificate_table(found.certificate))
    notes = warnings_of(found.certificate, orientation.value)
    for path, mesh in ((x, mesh_x), (y, mesh_y)):
        if one_sided(mesh):
            notes.append(f"{path}: cannot be wound consistently; check left and right")
    for line in notes:
        console.print(f"warning: {line}", soft_wrap=True, markup=False)
    for path in filter(None, (out, png)):
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


app.command()(batch)


@app.command()
def evaluate(
    x: MeshX,
    y: MeshY,
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help="What match wrote, or a .npz, .mat, .map, .vts of T_xy."
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
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures here too.")
    ] = None,
) -> None:
    """Measure a map, against ground truth where there is one.

    Distances are geodesic and relative to sqrt(area).

    Example: jfsf evaluate a.off b.off map.npz --gt-x a.vts --gt-y b.vts --every 5
    """
    mesh_x, mesh_y, maps, truth = read_pair(x, y, map_file, gt_x, gt_y, base)
    if json_file is not None:
        can_write(json_file, ".json")
    figures = figures_of(mesh_x, mesh_y, maps, truth, exact, every)
    shown = Table(title=map_file.name)
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    for name, value in figures.items():
        shown.add_row(name.replace("_", " "), f"{value:.4g}")
    Console().print(shown)
    if json_file is not None:
        from jfsf import __version__

        record = {
            "x": str(x),
            "y": str(y),
            "map": str(map_file),
            "ground_truth": None if truth is None else [str(gt_x), str(gt_y)],
            "geodesics": "exact" if exact else "heat method",
            "every": every,
            "jfsf": __version__,
            "figures": figures,
        }
        json_file.write_text(json.dumps(record, indent=2) + "\n")


@app.command()
def info(
    path: Annotated[Path, typer.Argument(metavar="MESH", help=FORMATS)],
) -> None:
    """Say what is in a mesh file, and whether it can be matched.

    Exit code 0 if it can, 1 if not.

    Example: jfsf info cat.off
    """
    from jfsf.mesh import MeshError, check, read

    mesh = read(path)
    report = check(mesh)
    shown = Table(title=path.name, show_header=False)
    for name, value in report._asdict().items():
        if value is not None:
            words = {True: "yes", False: "no"}
            text = words[value] if isinstance(value, bool) else f"{value:.6g}"
            shown.add_row(name.replace("_", " "), text)
    console = Console()
    console.print(shown)
    try:
        validate(mesh, path)
    except MeshError as error:
        console.print(f"cannot be matched: {error}", soft_wrap=True, markup=False)
        raise typer.Exit(1) from None
    notes = ""
    if report.faces == 0:
        notes = "; a point cloud tells no left from right"
    elif one_sided(mesh):
        notes = "; it cannot be wound consistently, so left and right may be swapped"
    console.print(f"can be matched{notes}", soft_wrap=True)


def _keep_compiled(ctx: typer.Context, cache: bool) -> None:
    # Only `main` asks for it: a library, or a test, must not change jax's settings.
    if not cache or ctx.find_root().obj is None:
        return
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    import jax

    from jfsf.cache import folder

    jax.config.update("jax_compilation_cache_dir", str(folder() / "xla"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    # XLA logs an error about its own tuning flags for each program it loads.
    jax.config.update("jax_logging_level", "CRITICAL")
    # A cache that cannot be read or written is done without.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation")


def _status(text: str):
    return Console(stderr=True).status(text)


if __name__ == "__main__":
    main()
