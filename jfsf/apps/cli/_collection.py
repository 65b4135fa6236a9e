"""jfsf collection: a folder of meshes to one topology and a shape model.

This file is long because it declares the options, and the steps share what is kept.
"""

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._collection_carried import (
    carried_of,
    write_carried,
)
from jfsf.apps.cli._collection_frozen import (
    check_new,
    columns_of,
    frozen_of,
    odd_beside,
)
from jfsf.apps.cli._collection_jobs import Sketches
from jfsf.apps.cli._collection_marks import read_marks, write_marks
from jfsf.apps.cli._collection_onto import STAGES_ONTO, join_onto, write_scores_of
from jfsf.apps.cli._collection_results import (
    COLUMNS,
    forget_pages,
    in_doubt,
    rows_of,
    table,
    write_index_page,
    write_model_of,
)
from jfsf.apps.cli._collection_runner import (
    KEPT,
    PARTS,
    STAGES,
    OnFiles,
    forget,
    jobs_of_shapes,
    kept_shapes,
    known_before,
    look,
    mirror_back,
    number_of,
    outcomes,
)
from jfsf.apps.cli._collection_symmetry import (
    SYMMETRY,
    pairs_of,
)
from jfsf.apps.cli._collection_templates import OTHERS, put_others
from jfsf.apps.cli._files import can_write_in, need_matplotlib
from jfsf.apps.cli._look import doubts
from jfsf.apps.cli._print import counted, say_result
from jfsf.apps.cli._runs import begin, stopping, write_table
from jfsf.apps.cli._stages import stages
from jfsf.mesh._read import CLOUDS, format_of, stem_of


class Mirrored(StrEnum):
    """`jfsf.collection`'s mirror, as choices of an option."""

    named = "name"
    auto = "auto"


def collection(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Meshes: two files or more.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    template: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The mesh whose topology all shapes get; by default the most central "
            "one.",
        ),
    ] = None,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|FOLDER",
            help="Landmarks of --template, which are carried to all shapes: .mrk.json, "
            ".fcsv, .pp, .tps, .pts, .csv or .txt. Or a folder of such files, named as "
            "the template and as other shapes, which then are templates too. Writes "
            "landmarks.csv and landmarks.tps of all, for geomorph and Morpho, "
            ".mrk.json and .fcsv of each, and how sure they are.",
        ),
    ] = None,
    check_landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Landmark files that people placed on some of the shapes, named as "
            "these: says how far those of --landmarks are from them.",
        ),
    ] = None,
    templates: Annotated[
        int,
        typer.Option(
            min=1,
            help="Carry --landmarks by so many templates, and take the median: "
            "--template, those that --landmarks has files of, and the most central "
            "shapes.",
        ),
    ] = 1,
    labels: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Labels of --template, one for each vertex or each face, which are "
            "carried to all shapes: .npy, .csv, .txt or .seg, or .json of parts.",
        ),
    ] = None,
    values: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Numbers of the vertices of --template, which are carried to all "
            "shapes: .npy, .csv or .txt.",
        ),
    ] = None,
    semilandmarks: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Points on curves and patches of --template, which follow on "
            "--landmarks: a curve of 3D Slicer (.mrk.json), or a table (.csv) with "
            "lines curve,NAME,NUMBER,LANDMARK,LANDMARK,... (along the surface from "
            "landmark to landmark) and patch,NAME,NUMBER,LANDMARK,... (within this "
            "rim). Writes curveslide.csv and surfslide.csv too, for geomorph. May be "
            "given several times.",
        ),
    ] = None,
    symmetric: Annotated[
        bool,
        typer.Option(
            "--symmetric",
            help="Pair the left and right --landmarks by the template's own symmetry. "
            "Writes landmark_pairs.csv; landmarks that are not in it are on the "
            "midline.",
        ),
    ] = False,
    onto: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="The --out of a finished collection, which stays as it is: each new "
            "shape gets its template, and scores in its model.",
        ),
    ] = None,
    scheduler: opt.SchedulerOption = None,
    workers: opt.WorkersOption = None,
    orientation: opt.OrientationOption = opt.Orientation.preserve,
    mirror: Annotated[
        Mirrored,
        typer.Option(
            help="What to do with shapes that are mirror images of the template, such "
            "as left bones among right ones: name them and leave them out (name), or "
            "mirror them back in x (auto). Only with --orientation preserve.",
        ),
    ] = Mirrored.named,
    scale: Annotated[
        bool,
        typer.Option("--scale", help="Remove differences of size from the model."),
    ] = False,
    largest_component: Annotated[
        bool,
        typer.Option(
            "--largest-component",
            help="Use only the component with the largest area of each shape.",
        ),
    ] = False,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair", help="Repair all meshes first, as jfsf info --help says."
        ),
    ] = False,
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Write index.html with all shapes and pairs, a report of each shape, "
            "and model.html with sliders for the modes.",
        ),
    ] = False,
) -> None:
    """Give all meshes of a folder one topology, and fit a shape model.

    Checks all files first, and says what is unfit and which option mends it: it may be
    added later, in the same folder. Matches a sparse graph of pairs, leaves out maps
    that disagree with the others, and deforms the most central shape, the template,
    onto every other. Writes registered/*.ply (the template on each shape), maps/*.npz,
    summary.csv, model.npz (mean, modes, variances, scores), scores.csv, mean.ply and
    mode_*.ply. Shapes that no trusted map reaches are named and left out. Run it again
    to continue a stopped run (Ctrl-C says what is kept), or to add shapes; --onto adds
    some and moves none of the others. Exit code 1 if a shape was left out.

    Example: jfsf collection scans --out model --report
    """
    from jfsf.apps.collections._engine import join_shapes, mirrored, reason
    from jfsf.batch._cluster import connect
    from jfsf.mesh import read

    if report:
        need_matplotlib()
    given = {"landmarks": landmarks, "labels": labels, "values": values}
    for option, path in given.items():
        if path is not None and template is None:
            raise ValueError(
                f"{path}: --{option} are those of the template; name it: --template"
            )
    frozen = None if onto is None else frozen_of(onto)
    if frozen is not None and scale:
        raise ValueError(f"{onto}: its model says whether size counts; omit --scale")
    paths = _meshes_in(folder)
    if out.is_dir() and out.samefile(folder):
        raise ValueError(
            f"{out}: is the folder of the meshes, and what is written there would be "
            "read as shapes; name another one"
        )
    if frozen is not None:
        check_new(frozen, paths, out, template, orientation.value)
    elif template is not None:
        template, paths = _with_template(template, paths)
    loading = largest_component, repair
    files = {
        "check": check_landmarks,
        "semilandmarks": semilandmarks or (),
        "loading": loading,
    }
    marks = read_marks(landmarks, template, paths, frozen, **files)
    several = max(templates, 0 if marks is None else len(marks.given)) > 1
    if several and marks is None:
        raise ValueError(
            f"--templates {templates} carries landmarks; give --landmarks, or leave it "
            "out"
        )
    if several and frozen is not None:
        raise ValueError(
            f"{onto}: has one template; leave --templates out, and name one file as "
            "--landmarks"
        )
    if symmetric and marks is None:
        raise ValueError("--symmetric pairs landmarks; give --landmarks too")
    carried = carried_of(template, labels=labels, values=values)
    odd = []
    if frozen is not None and not carried:
        carried, odd = columns_of(frozen)
    can_write_in(out)
    out = out.absolute()
    jobs = jobs_of_shapes(out, paths)
    settings = {"orientation": orientation.value, "mirror": mirror.value}
    if frozen is not None:
        settings["onto"] = str(frozen.folder)
    least, steps = (2, STAGES) if frozen is None else (1, STAGES_ONTO)
    steps = (*steps[:2], SYMMETRY, *steps[2:]) if symmetric else steps
    steps = (*steps[:-1], OTHERS, steps[-1]) if several else steps
    with stages(steps) as shown, stopping(out, KEPT, shown):
        begin(out, settings)
        for part in PARTS:
            (out / part).mkdir(exist_ok=True)
        reasons = look(jobs, shown, *loading, least=least)
        with connect(scheduler, workers=workers) as client:
            run = partial(outcomes, client, shown)
            shapes, reasons = kept_shapes(jobs, run, reasons, *loading, least=least)
            names = list(shapes)
            if frozen is None:
                where = [str(paths[name]) for name in names]
                odd += doubts(where, shapes.values())
            else:
                odd += odd_beside(frozen, paths, shapes)
            base = number_of(shapes, reasons, template if frozen is None else None)
            if symmetric and marks is not None:
                own = frozen.kept_template if frozen else jobs[names[base or 0]].out
                pairs, line = pairs_of(out, own, marks.points, run)
                marks = marks._replace(lists=marks.lists | {"pairs": pairs})
                odd.append(line)
            for line in odd:
                shown.say(line)
            if frozen is None:
                runner = OnFiles(out, names, orientation.value, report, run)
                graph, failed = join_shapes(
                    Sketches(shapes),
                    runner,
                    template=base,
                    orientation=orientation.value,
                    mirror=mirror.value,
                )
                given = () if marks is None else marks.given
                others = put_others(shapes, graph, runner, templates - 1, given)
            else:
                how = {"mirror": mirror.value, "report": report}
                shapes, graph, failed = join_onto(frozen, out, shapes, run, **how)
                names, others = list(shapes), []
        shown.begin("model", 1)
        shapes = mirror_back(out, shapes, graph)
        reasons |= {
            names[i]: reason(graph, names, i)
            for i in np.flatnonzero(~graph.joined).tolist()
        }
        reasons |= {names[i]: why for i, why in failed.items()}
        forget(out, {*reasons, *(known_before(out) - set(paths))})
        rows = rows_of(out, paths, shapes, graph, reasons)
        name = names[graph.paths.template]
        mesh = shapes[name].mesh
        if frozen is None:
            kinds = {"scale": scale, "report": report}
            written, notes = write_model_of(out, rows, mesh.faces, **kinds)
        else:
            written, notes = write_scores_of(out, rows, frozen)
        write_table(out / "summary.csv", COLUMNS, rows)
        written.insert(0, out / "summary.csv")
        tables, of_marks = [], []
        if marks is not None:
            own = write_marks(out, marks, rows, shapes, graph, others)
            written, tables, of_marks = written + own[0], *own[1:]
        turned = {names[i] for i in graph.mirrored_back}
        file = paths.get(name, template)
        whole = read(file, finite=False) if file is not None and carried else mesh
        written += write_carried(out, rows, paths, shapes, name, carried, turned, whole)
        if report:
            written.append(write_index_page(out, rows, shapes, graph))
        else:
            forget_pages(out)
        shown.advance("model")
    of = ", ".join([f"template {name}", *(f"also {other}" for other in others)])
    summary = table(rows, f"{of}, {counted(len(graph.matched), 'pair', 'pairs')}")
    lines = ([] if marks is None else marks.said) + odd
    lines += [
        f"{path}: {line}"
        for n, path in paths.items()
        if n in shapes
        for line in shapes[n].said
    ]
    lines += in_doubt(rows)
    lines += [f"left out: {paths[name]}: {why}" for name, why in reasons.items()]
    lines += [
        f"mirrored back: {paths[names[i]]}: {mirrored(graph, names, i)}"
        for i in sorted(graph.mirrored_back)
    ]
    say_result([summary, *tables], lines + of_marks, notes, written)
    if reasons:
        raise typer.Exit(1)


def _meshes_in(folder: Path) -> dict[str, Path]:
    """The mesh files of a folder by their names without endings, in order.

    Files of point clouds are passed over: collections are of surfaces.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: is no folder; give one with two meshes or more")
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):  # as macOS keeps beside each file
            continue
        if format_of(path) not in ("", *CLOUDS) and path.is_file():
            name = stem_of(path)
            if name in found:
                raise ValueError(f"{path}: has the name of {found[name]}; rename one")
            found[name] = path.absolute()
    return found


def _with_template(
    template: Path, paths: dict[str, Path]
) -> tuple[Path, dict[str, Path]]:
    """The template's file, and all files: one that is not in the folder comes first."""
    if not template.is_file():
        raise ValueError(f"{template}: is no file; check the path")
    for path in paths.values():
        if path.samefile(template):
            return path, paths
    name = stem_of(template)
    if name in paths:
        raise ValueError(f"{template}: has the name of {paths[name]}; rename one")
    return template, {name: template.absolute(), **paths}
