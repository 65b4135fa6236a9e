"""jfsf demo | match | register | batch | evaluate | ...: options and exit codes.

Exit codes: 0 done, 1 bad input (one line on stderr says which), 2 wrong usage, 130
interrupted.

This file is long because it declares the options of most commands, with their help.
"""

from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from typer.core import TyperGroup

from jfsf.apps.cli._batch import batch
from jfsf.apps.cli._cache import cache
from jfsf.apps.cli._collection import collection
from jfsf.apps.cli._components import Pictures, check_components_options, match_pieces
from jfsf.apps.cli._evaluate import evaluate
from jfsf.apps.cli._exports import (
    ByPlaceOption,
    CheckerOption,
    Looks,
    Up,
    UpAxis,
    draw,
    seen,
)
from jfsf.apps.cli._exports import export as exported
from jfsf.apps.cli._files import (
    AnyUnitOption,
    BaseOption,
    MeshX,
    MeshY,
    Orientation,
    OrientationOption,
    can_export,
    can_write,
    can_write_in,
    matchable,
    need_matplotlib,
    write_found,
)
from jfsf.apps.cli._info import info
from jfsf.apps.cli._landmarks import (
    KnownPairs,
    LandmarkFiles,
    check_landmark_options,
    known_pairs,
)
from jfsf.apps.cli._notes import check_units, notes_of
from jfsf.apps.cli._pages import can_report, kept_truth
from jfsf.apps.cli._register import (
    register,
    registration_table,
    registration_warnings,
    write_registered,
)
from jfsf.apps.cli._report import certificate_table
from jfsf.apps.cli._shapes import shapes
from jfsf.apps.cli._stages import stage_bar
from jfsf.apps.cli._transfer import transfer
from jfsf.apps.cli._warm_up import warm_up
from jfsf.apps.cli._words import print_any_letter, sentence
from jfsf.apps.report import Side, write_report
from jfsf.apps.report._words import attempts, warnings_of
from jfsf.mesh._read import stem_of


class _OneLine(TyperGroup):
    """Turns an error about the input into one line on stderr and exit code 1."""

    def invoke(self, ctx):
        """Run the command."""
        try:
            return super().invoke(ctx)
        except (ValueError, ImportError, OSError) as error:
            typer.echo(f"jfsf: {sentence(error)}", err=True)
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


def main() -> None:
    """Run the command line, and end the process."""
    print_any_letter()
    app()


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
    pair: Annotated[
        tuple[str, str], typer.Option(help="Two embedded shapes, X and Y.")
    ] = ("man_walk", "man_up"),
    out: Annotated[Path, typer.Option(help="Folder for the JSON and the PNG.")] = Path(
        "jfsf-demo"
    ),
    report: Annotated[
        bool, typer.Option("--report", help="Write a page to look at, too.")
    ] = False,
) -> None:
    """Match two embedded shapes; compare nearest neighbour and Sinkhorn.

    Example: jfsf demo --pair man_walk woman_up --out results --report
    """
    from jfsf.apps.cli._demo import measure, table, write, write_page

    if report:
        need_matplotlib()
    can_write_in(out)
    with _status("starting ...") as status:
        result = measure(*pair, lambda step: status.update(f"{step} ..."))
        status.update("drawing ...")
        written = write(result, out)
        if report:
            status.update("report ...")
            written.append(write_page(result, out))
    console = Console()
    console.print(table(result.record))
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


@app.command()
def match(
    x: MeshX,
    y: MeshY,
    out: Annotated[Path, typer.Option(help="The .npz to write.")],
    png: Annotated[
        Path | None, typer.Option(help="A picture of the map (needs matplotlib).")
    ] = None,
    export: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="X in the colours of Y, those of its file if it has any, for MeshLab, "
            "Blender and the like: .ply, .obj or .glb. PLY and GLB hold the confidence "
            "of each vertex too, or of parts the membership. May be given several "
            "times.",
        ),
    ] = None,
    checker: CheckerOption = False,
    by_place: ByPlaceOption = False,
    warped: Annotated[
        Path | None,
        typer.Option(
            "--register",
            metavar="FILE",
            help="X deformed onto Y by the map, as jfsf register does: .ply, .obj or "
            ".glb.",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="A page (.html) to turn both shapes in and judge the map."),
    ] = None,
    gt_x: Annotated[
        Path | None, typer.Option(help="Ground truth for the page, as in evaluate.")
    ] = None,
    gt_y: Annotated[Path | None, typer.Option(help="The same for Y.")] = None,
    base: BaseOption = None,
    orientation: OrientationOption = Orientation.preserve,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            help="Text file of known pairs: a line holds a vertex of X and one of Y, "
            "counted from 0."
        ),
    ] = None,
    landmarks_x: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Landmarks of X: .mrk.json or .fcsv (3D Slicer), .pp (MeshLab), "
            ".particles (ShapeWorks), or a table of name,x,y,z or name,vertex (.csv, "
            ".tsv, .txt). Goes with --landmarks-y; they are paired by name, or by "
            "order.",
        ),
    ] = None,
    landmarks_y: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The same for Y.")
    ] = None,
    largest_component: Annotated[
        bool,
        typer.Option(
            "--largest-component",
            help="Match the largest pieces only. Maps then count kept vertices; "
            "index_x and index_y in the file hold their numbers in X and Y.",
        ),
    ] = False,
    components: Annotated[
        bool,
        typer.Option(
            "--components",
            help="Match all pieces of X to those of Y, the best assignment. Maps count "
            "the vertices of the files, -1 where a vertex belongs to no piece with a "
            "partner; the file has the pair and its confidence for each vertex.",
        ),
    ] = False,
    partial: Annotated[
        bool,
        typer.Option(
            "--partial",
            help="One shape is a part of the other, or both overlap. "
            "The file then has matched_x and matched_y, the vertices that both have, "
            "membership_x and membership_y, how clearly, and the shares of the areas. "
            "Pictures, pages and exported meshes show the others in grey.",
        ),
    ] = False,
    any_unit: AnyUnitOption = False,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair",
            help="Repair both meshes first, see info. Maps still count the vertices of "
            "the files: one that was removed goes where the nearest goes. With "
            "--largest-component all other pieces are removed.",
        ),
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Leave the cache folder alone.")
    ] = False,
    up: UpAxis = Up.y,
) -> None:
    """Map two meshes to each other, both ways.

    Writes T_xy (the vertex of Y for each vertex of X), T_yx (the other way; both int32,
    counted from 0), C_yx (the functional map), certificate_* (evidence of quality),
    confidence_x and confidence_y (how likely each vertex is mapped right) and info_*
    (which starts were attempted, and how long it took).

    Example: jfsf match cat.off lion.off --out map.npz --report map.html
    """
    from jfsf.matching import match as match_meshes

    can_write(out, ".npz")
    if png is not None:
        can_write(png, ".png")
        need_matplotlib()
    exports = export or []
    can_export(exports, checker, (x, y))
    looks = Looks(up.value, checker, by_place)
    if components:
        options = {"--register": warped, "--report": report, "--partial": partial}
        options |= {"--gt-x": gt_x, "--gt-y": gt_y, "--base": base}
        options |= {"--landmarks": landmarks, "--landmarks-x": landmarks_x}
        options |= {"--landmarks-y": landmarks_y, "--repair": repair}
        options |= {"--largest-component": largest_component, "--any-unit": any_unit}
        check_components_options(options)
        pictures = Pictures(png, exports, looks)
        match_pieces(x, y, out, orientation.value, pictures, cache=not no_cache)
        return
    if warped is not None:
        can_export([warped], False, (x, y))
        if warped.absolute() in [path.absolute() for path in exports]:
            raise ValueError(f"{warped}: is the file of --export too; name another")
    can_report(report, gt_x, gt_y)
    if any_unit and not partial:
        raise ValueError("--any-unit goes with --partial; sizes of wholes never matter")
    files = LandmarkFiles(landmarks, landmarks_x, landmarks_y)
    check_landmark_options(files)
    shape_x, shape_y = (matchable(path, largest_component, repair) for path in (x, y))
    truth = kept_truth(gt_x, gt_y, (shape_x, shape_y), base)
    known = known_pairs(files, (shape_x, shape_y))
    console = Console()
    one_unit = partial and not any_unit
    if one_unit and (doubt := check_units((x, y), (shape_x, shape_y))):
        console.print(f"warning: {doubt}", soft_wrap=True, markup=False)
    started = perf_counter()
    with stage_bar() as stage:
        matched = match_meshes(
            shape_x.mesh,
            shape_y.mesh,
            orientation=orientation.value,
            landmarks=None if known is None else known.rows,  # type: ignore
            partial=partial,
            same_unit=not any_unit,
            cache=not no_cache,
            progress=stage,
        )
        seconds = {"matching": perf_counter() - started}
        stage("writing")
        known = known or KnownPairs(np.zeros((0, 2), np.int64))
        shapes = shape_x, shape_y
        notes = notes_of((x, y), shapes, partial=partial, said=known.said)
        write_found(out, matched, *shapes, notes=notes)
        if png is not None:
            draw(png, *shapes, seen(matched), looks)
        notes = exported(exports, *shapes, y, seen(matched), looks) + notes
        on_y = None
        if warped is not None:
            T, inside = np.asarray(matched.T_xy), matched.matched_x
            meshes = shape_x.mesh, shape_y.mesh
            on_y = write_registered(warped, *meshes, T, inside, stage)
        if report is not None:
            write_report(
                report,
                Side(shape_x.mesh, stem_of(x), shape_x.index),
                Side(shape_y.mesh, stem_of(y), shape_y.index),
                matched,
                orientation=orientation.value,  # type: ignore
                truth=truth,
                up=looks.up,
                seconds=seconds,
                cache=not no_cache,
                progress=lambda name: stage(f"report: {name}"),
            )
    console.print(certificate_table(matched.certificate))
    if matched.overlap_x is not None and matched.overlap_y is not None:
        shares = float(matched.overlap_x), float(matched.overlap_y)
        console.print(f"matched: {shares[0]:.0%} of X's area, {shares[1]:.0%} of Y's")
    if matched.info is not None:
        console.print(attempts(matched.info), soft_wrap=True, markup=False)
    if on_y is not None:
        console.print(registration_table(on_y, shape_y.mesh, None))
    doubts = warnings_of(matched.certificate, orientation.value, landmarks=known.names)
    if on_y is not None:
        doubts += registration_warnings(on_y, shape_y.mesh)
    for line in (*notes, *(f"warning: {doubt}" for doubt in doubts)):
        console.print(line, soft_wrap=True, markup=False)
    for path in filter(None, (out, png, *exports, warped, report)):
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


app.command()(register)
app.command()(transfer)
app.command()(batch)
app.command()(collection)
app.command()(evaluate)
app.command()(info)
app.command("warm-up")(warm_up)
app.command()(shapes)
app.command()(cache)


def _status(text: str):
    return Console(stderr=True).status(text)
