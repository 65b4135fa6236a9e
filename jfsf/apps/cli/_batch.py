"""jfsf batch: many pairs, through dask.distributed.

This file is long because it declares the options of the command, with their help.
"""

import functools
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from jfsf.apps.cli._batch_jobs import is_complete, prepare, work
from jfsf.apps.cli._batch_options import (
    forget_outdated,
    landmark_files,
    options_of_pairs,
    prepared_kinds,
)
from jfsf.apps.cli._exports import (
    ByPlaceOption,
    CheckerOption,
    Looks,
    Up,
    UpAxis,
)
from jfsf.apps.cli._files import (
    AnyUnitOption,
    BaseOption,
    Orientation,
    OrientationOption,
    can_write_in,
    need_matplotlib,
)
from jfsf.apps.cli._landmarks import landmark_names
from jfsf.apps.cli._pages import batch_index
from jfsf.apps.cli._runs import (
    SchedulerOption,
    WorkersOption,
    bars,
    begin,
    note_drawing,
    raising_interrupts,
)
from jfsf.apps.cli._summary import (
    doubtful_first,
    summary_row,
    summary_table,
    write_summary,
)
from jfsf.apps.cli._words import said

MOST_NOTES = 20  # lines on the meshes that are printed


class Format(StrEnum):
    """Formats of exported meshes, as choices of an option."""

    ply = "ply"
    obj = "obj"
    glb = "glb"


def batch(
    pairs: Annotated[
        Path,
        typer.Argument(
            metavar="PAIRS.csv",
            help="Two mesh paths a line, relative to this file, with a comma, a "
            "semicolon or a tab between. Titles in the first line name further "
            "columns: orientation, "
            "largest_component, partial, repair, landmarks, landmarks_x, landmarks_y, "
            "gt_x, gt_y. What a line says goes before the options.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    scheduler: SchedulerOption = None,
    workers: WorkersOption = None,
    orientation: OrientationOption = Orientation.preserve,
    landmarks: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Known pairs of vertices; see match."),
    ] = None,
    landmarks_x: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Landmarks of X, for all pairs whose line names those of Y.",
        ),
    ] = None,
    landmarks_y: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Landmarks of Y for all pairs, such as those of one template.",
        ),
    ] = None,
    largest_component: Annotated[
        bool,
        typer.Option(
            "--largest-component", help="Match the largest pieces only; see match."
        ),
    ] = False,
    partial: Annotated[
        bool,
        typer.Option(
            "--partial",
            help="Of each pair one shape is a part of the other, or both overlap; see "
            "match.",
        ),
    ] = False,
    any_unit: AnyUnitOption = False,
    repair: Annotated[
        bool, typer.Option("--repair", help="Repair all meshes first; see match.")
    ] = False,
    png: Annotated[
        bool, typer.Option("--png", help="A picture of each map (needs matplotlib).")
    ] = False,
    exports: Annotated[
        list[Format] | None,
        typer.Option(
            "--export",
            metavar="FORMAT",
            help="X in the colours of Y, a file a pair: ply, obj or glb. May be given "
            "several times.",
        ),
    ] = None,
    checker: CheckerOption = False,
    by_place: ByPlaceOption = False,
    report: Annotated[
        bool,
        typer.Option(
            "--report", help="A page a pair, and index.html with links to all."
        ),
    ] = False,
    base: BaseOption = None,
    no_cache: Annotated[
        bool,
        typer.Option(
            "--no-cache",
            help="Leave the cache folder alone: each pair makes its spectra anew.",
        ),
    ] = False,
    up: UpAxis = Up.y,
) -> None:
    """Match many pairs of meshes, as match does each; needs dask.distributed.

    Writes X__Y.npz a pair, and summary.csv and summary.json of all, the least
    confident first. Run it again to continue a stopped run, or to add pairs: results
    that are not older than their files, and whose line says the same, are kept. Exit
    code 1 if a pair failed; the others are matched all the same.

    Example: jfsf batch pairs.csv --out maps --report
    """
    from jfsf.batch import connect, read_pairs
    from jfsf.batch._jobs import Job, run_jobs
    from jfsf.batch._pair_list import PairOptions

    suffixes = tuple(f".{one.value}" for one in exports or [])
    if report or png:
        need_matplotlib()
    if checker and (not suffixes or ".ply" in suffixes):
        raise ValueError("--checker goes with --export obj and --export glb only")
    listed = read_pairs(pairs)
    settings = {
        "orientation": orientation.value,
        "largest_component": largest_component,
        "partial": partial,
        "repair": repair,
    }
    usual = PairOptions(
        **settings,
        landmarks=landmarks,
        landmarks_x=landmarks_x,
        landmarks_y=landmarks_y,
    )
    options = options_of_pairs(pairs, listed, usual, pages=report)
    if any_unit and not any(own.partial for own in options.values()):
        raise ValueError("--any-unit goes with --partial; sizes of wholes never matter")
    can_write_in(out)
    if (summary := out / "summary.csv").exists() and summary.samefile(pairs):
        raise ValueError(f"{pairs}: would be overwritten by the results; name another")
    jobs = [
        # Absolute, because each worker has its own working folder.
        Job(
            (pair.x.absolute(), pair.y.absolute()),
            out.absolute() / f"{pair.name}.npz",
            tuple(path for path in landmark_files(options[pair.name]) if path),
            options[pair.name],
        )
        for pair in listed
    ]
    looks = Looks(up.value, checker, by_place)
    wanted = {"report": report, "png": png, "suffixes": suffixes}
    rows = {}
    with raising_interrupts(), connect(scheduler, workers=workers) as client:
        begin(out, settings | ({"same_unit": False} if any_unit else {}))
        forget_outdated(out, options, PairOptions(**settings))
        if report or png or suffixes:
            note_drawing(out, looks._asdict() | {"base": base})
        with bars() as shown:
            shapes = shown.add_task("spectra", total=None)
            done = shown.add_task("pairs", total=len(jobs))
            outcomes = run_jobs(
                jobs,
                client,
                prepare=functools.partial(
                    prepare,
                    usual=(largest_component, repair),
                    others=prepared_kinds(jobs, (largest_component, repair)),
                    cache=not no_cache,
                ),
                work=functools.partial(
                    work,
                    looks=looks,
                    base=base,
                    cache=not no_cache,
                    same_unit=not any_unit,
                    **wanted,
                ),
                done=functools.partial(is_complete, **wanted),
                progress=lambda n, total: shown.update(
                    shapes, completed=n, total=total
                ),
                say=said,
            )
            for outcome in outcomes:
                rows[outcome.job.out.name] = _row(outcome)
                shown.advance(done)
    ordered = doubtful_first(
        [
            {"x": str(pair.x), "y": str(pair.y), **rows[f"{pair.name}.npz"]}
            for pair in listed
        ]
    )
    written = write_summary(out, ordered, settings)
    if report:
        written = *written, batch_index(out, ordered)
    console = Console()
    console.print(summary_table(ordered))
    notes = list(dict.fromkeys(line for row in ordered for line in row["notes"]))
    if len(notes) > MOST_NOTES:
        more = f"{len(notes) - MOST_NOTES + 1} more such lines in {written[0]}"
        notes = [*notes[: MOST_NOTES - 1], more]
    failed = [row for row in ordered if row["reason"]]
    notes += [f"failed: {row['x']}, {row['y']}: {row['reason']}" for row in failed]
    for line in (*notes, *(f"wrote {path}" for path in written)):
        console.print(line, soft_wrap=True, markup=False)
    if failed:
        raise typer.Exit(1)


def _row(outcome) -> dict[str, Any]:
    """The row of a pair in the summary."""
    options = outcome.job.options
    names = ()
    if outcome.reason is None:
        names = landmark_names(landmark_files(options))
    return summary_row(outcome, options.orientation, landmarks=names)
