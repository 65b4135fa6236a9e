"""jfsf match: two meshes mapped to each other."""

from pathlib import Path
from typing import Annotated

import typer

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._components import check_components_options, match_pieces
from jfsf.apps.cli._files import can_export, can_write, need_matplotlib
from jfsf.apps.cli._known import kept_truth, known_pairs
from jfsf.apps.cli._pair import (
    Pictures,
    both_matchable,
    check_units,
    draw,
    find,
    notes_of,
    seen,
    write_page,
)
from jfsf.apps.cli._print import WARNING, certificate_table, say, say_result, stage_bar
from jfsf.apps.cli._register import (
    registration_table,
    registration_warnings,
    write_registered,
)
from jfsf.apps.cli._stored import write_found
from jfsf.apps.report._words import attempts, in_short


def match(
    x: opt.MeshX,
    y: opt.MeshY,
    out: Annotated[Path, typer.Option(help="The .npz to write.")],
    png: Annotated[
        Path | None, typer.Option(help="Write a picture of the map (needs matplotlib).")
    ] = None,
    export: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Write X in the colours of Y's file, or of Y coloured by place, for "
            "MeshLab, Blender and the like: .ply, .obj or .glb. PLY and GLB also hold "
            "the confidence and the radius of each vertex, in the unit of Y, or for "
            "parts its membership. May be given several times.",
        ),
    ] = None,
    checker: opt.CheckerOption = False,
    by_place: opt.ByPlaceOption = False,
    warped: Annotated[
        Path | None,
        typer.Option(
            "--register",
            metavar="FILE",
            help="Write X deformed onto Y by the map, as jfsf register does: .ply, "
            ".obj or .glb.",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Write a report (.html) to turn both shapes and judge the map."
        ),
    ] = None,
    gt_x: opt.GroundTruthX = None,
    gt_y: opt.GroundTruthY = None,
    base: opt.BaseOption = None,
    orientation: opt.OrientationOption = opt.Orientation.preserve,
    landmarks: opt.LandmarksOption = None,
    landmarks_x: opt.LandmarksXOption = None,
    landmarks_y: opt.LandmarksYOption = None,
    largest_component: opt.LargestOption = False,
    components: Annotated[
        bool,
        typer.Option(
            "--components",
            help="Match all pieces (connected components) of X to those of Y. Maps "
            "count the vertices of the files, and are -1 where a vertex belongs to "
            "no piece with a partner. The file has the pair of each vertex, and the "
            "confidence of each pair.",
        ),
    ] = False,
    partial: opt.PartialOption = False,
    any_unit: opt.AnyUnitOption = False,
    repair: opt.RepairOption = False,
    no_cache: opt.NoCacheOption = False,
    up: opt.UpOption = opt.Up.y,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            help="Print all figures of the certificate, and what was tried.",
        ),
    ] = False,
) -> None:
    """Compute point-to-point maps between two meshes, in both directions.

    Writes T_xy (the vertex of Y for each vertex of X), T_yx (the vertex of X for each
    vertex of Y; both int32, from 0), C_yx (the functional map), certificate_* (evidence
    of quality), confidence_x and confidence_y (the probability that each vertex is
    mapped right), radius_x and radius_y (a length for each vertex, in sqrt(area) of the
    other shape: with 90 % probability its image is less than that off) and info_*
    (which starts were attempted, and how long it took).

    Example: jfsf match cat.off lion.off --out map.npz --report map.html
    """
    from jfsf.batch._pair_list import PairOptions

    paths, exports = (x, y), tuple(export or ())
    can_write(out, ".npz")
    if png is not None:
        can_write(png, ".png")
    if checker and not exports:
        raise ValueError("--checker goes with --export; say which file to write")
    can_export(exports, paths, checker)
    pictures = Pictures(png, exports, report, None, up.value, checker, by_place)
    files = landmarks, landmarks_x, landmarks_y, gt_x, gt_y
    given = PairOptions(orientation.value, largest_component, partial, repair, *files)
    if components:
        options = {"--register": warped, "--report": report, "--base": base}
        options["--any-unit"] = any_unit or None
        own = given._replace(orientation=None)._asdict()
        options |= {f"--{name.replace('_', '-')}": own[name] for name in own}
        check_components_options(options)
    if warped is not None:
        can_export([warped], paths)
        if warped.absolute() in [path.absolute() for path in exports]:
            raise ValueError(f"{warped}: is the file of --export too; name another")
    opt.check_pair(given, report=report is not None)
    opt.check_any_unit(any_unit, partial)
    if report is not None:
        can_write(report, ".html")
    if report is not None or png is not None:
        need_matplotlib()
    if components:
        match_pieces(paths, out, orientation.value, pictures, cache=not no_cache)
        return
    shapes = both_matchable(paths, given)
    mesh_x, mesh_y = (shape.mesh for shape in shapes)
    truth = kept_truth(given, shapes, base)
    known = known_pairs(given, shapes)
    if doubt := check_units(paths, shapes, given, not any_unit):
        say(WARNING + doubt)
    on_y = None
    with stage_bar() as stage:
        matched, seconds = find(
            shapes,
            given,
            known,
            same_unit=not any_unit,
            cache=not no_cache,
            progress=stage,
        )
        stage("writing")
        notes = notes_of(paths, shapes, given, known)
        write_found(out, matched, *shapes, notes=notes)
        notes = draw(pictures, shapes, paths, seen(matched)) + notes
        if warped is not None:
            T, inside = matched.T_xy, matched.matched_x
            on_y = write_registered(warped, mesh_x, mesh_y, T, inside, stage)
        write_page(
            pictures,
            paths,
            [(shape.mesh, shape.index) for shape in shapes],
            matched,
            orientation=orientation.value,
            truth=truth,
            seconds=seconds,
            cache=not no_cache,
            progress=lambda name: stage(f"report: {name}"),
        )
    names = () if known is None else known.names
    shown = []
    lines = in_short(matched.certificate, orientation.value, landmarks=names)
    if matched.overlap_x is not None and matched.overlap_y is not None:
        shares = float(matched.overlap_x), float(matched.overlap_y)
        lines.append(f"matched: {shares[0]:.0%} of X's area, {shares[1]:.0%} of Y's")
    if verbose:
        shown.append(certificate_table(matched.certificate))
        lines += [] if matched.info is None else [attempts(matched.info)]
    doubts = []
    if on_y is not None:
        shown.append(registration_table(on_y, mesh_y, None))
        doubts = registration_warnings(on_y, mesh_y)
    say_result(shown, [*lines, *notes], doubts, (out, png, *exports, warped, report))
