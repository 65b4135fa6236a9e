"""jfsf batch: many pairs, through dask.distributed."""

from enum import StrEnum
from functools import partial as bound
from pathlib import Path
from typing import Annotated, Any

import typer

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._batch_jobs import (
    forget_outdated,
    is_complete,
    options_of_pairs,
    prepare,
    prepared_kinds,
    work,
)
from jfsf.apps.cli._files import can_write_in, need_matplotlib
from jfsf.apps.cli._known import landmark_names
from jfsf.apps.cli._print import said, say_result
from jfsf.apps.cli._runs import (
    bars,
    batch_index,
    begin,
    doubtful_first,
    note_drawing,
    raising_interrupts,
    summary_row,
    summary_table,
    write_summary,
)

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
    scheduler: opt.SchedulerOption = None,
    workers: opt.WorkersOption = None,
    orientation: opt.OrientationOption = opt.Orientation.preserve,
    landmarks: opt.LandmarksOption = None,
    landmarks_x: opt.LandmarksXOption = None,
    landmarks_y: opt.LandmarksYOption = None,
    largest_component: opt.LargestOption = False,
    partial: opt.PartialOption = False,
    any_unit: opt.AnyUnitOption = False,
    repair: opt.RepairOption = False,
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
    checker: opt.CheckerOption = False,
    by_place: opt.ByPlaceOption = False,
    report: Annotated[
        bool,
        typer.Option(
            "--report", help="A page a pair, and index.html with links to all."
        ),
    ] = False,
    base: opt.BaseOption = None,
    no_cache: opt.NoCacheOption = False,
    up: opt.UpOption = opt.Up.y,
) -> None:
    """Match many pairs of meshes, as match does each; needs dask.distributed.

    Writes X__Y.npz a pair, and summary.csv and summary.json of all, the least
    confident first. Run it again to continue a stopped run, or to add pairs: results
    that are not older than their files, and whose line says the same, are kept. Exit
    code 1 if a pair failed; the others are matched all the same.

    Example: jfsf batch pairs.csv --out maps --report
    """
    from jfsf.batch._cluster import connect
    from jfsf.batch._jobs import Job, run_jobs
    from jfsf.batch._pair_list import PairOptions, read_pairs

    suffixes = tuple(f".{one.value}" for one in exports or [])
    if report or png:
        need_matplotlib()
    if checker and (not suffixes or ".ply" in suffixes):
        raise ValueError("--checker goes with --export obj and --export glb only")
    listed = read_pairs(pairs)
    settings: dict[str, Any] = {
        "orientation": orientation.value,
        "largest_component": largest_component,
        "partial": partial,
        "repair": repair,
    }
    files: dict[str, Any] = {
        "landmarks": landmarks,
        "landmarks_x": landmarks_x,
        "landmarks_y": landmarks_y,
    }
    usual = PairOptions(**settings, **files)
    options = options_of_pairs(pairs, listed, usual, pages=report)
    opt.check_any_unit(any_unit, any(own.partial for own in options.values()))
    can_write_in(out)
    if (summary := out / "summary.csv").exists() and summary.samefile(pairs):
        raise ValueError(f"{pairs}: would be overwritten by the results; name another")
    # Absolute, because each worker has its own working folder.
    jobs = []
    for pair in listed:
        own, inputs = options[pair.name], (pair.x.absolute(), pair.y.absolute())
        known = own.landmarks, own.landmarks_x, own.landmarks_y
        extras = tuple(path for path in known if path is not None)
        jobs.append(Job(inputs, out.absolute() / f"{pair.name}.npz", extras, own))
    looks = {"up": up.value, "checker": checker, "by_place": by_place}
    wanted = {"report": report, "png": png, "suffixes": suffixes, **looks}
    ways, cache = (largest_component, repair), not no_cache
    others = prepared_kinds(jobs, ways)
    how = {"base": base, "cache": cache, "same_unit": not any_unit}
    rows = {}
    with raising_interrupts(), connect(scheduler, workers=workers) as client:
        begin(out, settings | ({"same_unit": False} if any_unit else {}))
        forget_outdated(out, options, PairOptions(**settings))
        if report or png or suffixes:
            note_drawing(out, looks | {"base": base})
        with bars() as shown:
            spectra = shown.add_task("spectra", total=None)
            done = shown.add_task("pairs", total=len(jobs))
            outcomes = run_jobs(
                jobs,
                client,
                prepare=bound(prepare, usual=ways, others=others, cache=cache),
                work=bound(work, wanted=wanted, **how),
                done=bound(is_complete, wanted=wanted),
                progress=lambda n, all: shown.update(spectra, completed=n, total=all),
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
    notes = list(dict.fromkeys(line for row in ordered for line in row["notes"]))
    if len(notes) > MOST_NOTES:
        more = f"{len(notes) - MOST_NOTES + 1} more such lines in {written[0]}"
        notes = [*notes[: MOST_NOTES - 1], more]
    failed = [row for row in ordered if row["reason"]]
    notes += [f"failed: {row['x']}, {row['y']}: {row['reason']}" for row in failed]
    say_result([summary_table(ordered)], notes, (), written)
    if failed:
        raise typer.Exit(1)


def _row(outcome) -> dict[str, Any]:
    """The row of a pair in the summary."""
    options = outcome.job.options
    names = () if outcome.reason is not None else landmark_names(options)
    return summary_row(outcome, options.orientation, landmarks=names)
