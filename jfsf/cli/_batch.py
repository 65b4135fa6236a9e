"""jfsf batch: many pairs, through dask.distributed."""

import functools
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from jfsf.cli._files import (
    AnyUnitOption,
    Orientation,
    OrientationOption,
    can_write_in,
    kept_match,
    matchable,
    need_matplotlib,
    write_found,
)
from jfsf.cli._pages import batch_index, pages_of, pair_page
from jfsf.cli._runs import (
    SchedulerOption,
    WorkersOption,
    bars,
    begin,
    raising_interrupts,
)
from jfsf.cli._summary import (
    doubtful_first,
    summary_row,
    summary_table,
    write_summary,
)


def batch(
    pairs: Annotated[
        Path,
        typer.Argument(
            metavar="PAIRS.csv",
            help="Two mesh paths a line, with a comma between, relative to this file.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    scheduler: SchedulerOption = None,
    workers: WorkersOption = None,
    orientation: OrientationOption = Orientation.preserve,
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
    report: Annotated[
        bool,
        typer.Option(
            "--report", help="A page a pair, and index.html with links to all."
        ),
    ] = False,
) -> None:
    """Match many pairs of meshes, as match does each; needs dask.distributed.

    Writes X__Y.npz a pair, and summary.csv and summary.json of all, the least
    confident first. Run it again to continue a stopped run, or to add pairs: results
    that are not older than their meshes are kept. Exit code 1 if a pair failed; the
    others are matched all the same.

    Example: jfsf batch pairs.csv --out maps --report
    """
    from jfsf.batch import Job, connect, read_pairs, run_jobs

    if report:
        need_matplotlib()
    listed = read_pairs(pairs)
    can_write_in(out)
    jobs = {
        # Absolute, because each worker has its own working folder.
        pair.name: Job(
            (pair.x.absolute(), pair.y.absolute()),
            out.absolute() / f"{pair.name}.npz",
        )
        for pair in listed
    }
    options = {
        "orientation": orientation.value,
        "largest_component": largest_component,
        "partial": partial,
        "repair": repair,
    }
    if any_unit:
        if not partial:
            raise ValueError(
                "--any-unit goes with --partial; sizes of wholes never matter"
            )
        options["same_unit"] = False
    rows = {}
    with raising_interrupts(), connect(scheduler, workers=workers) as client:
        begin(out, options)
        with bars() as shown:
            shapes = shown.add_task("spectra", total=None)
            done = shown.add_task("pairs", total=len(jobs))
            outcomes = run_jobs(
                list(jobs.values()),
                client,
                prepare=functools.partial(
                    prepare, largest=largest_component, mend=repair
                ),
                work=functools.partial(work, report=report, **options),
                done=_is_reported if report else _is_done,
                progress=lambda n, total: shown.update(
                    shapes, completed=n, total=total
                ),
            )
            for outcome in outcomes:
                rows[outcome.job.out.name] = summary_row(outcome, orientation.value)
                shown.advance(done)
    ordered = doubtful_first(
        [
            {"x": str(pair.x), "y": str(pair.y), **rows[f"{pair.name}.npz"]}
            for pair in listed
        ]
    )
    written = write_summary(out, ordered, options)
    if report:
        written = *written, batch_index(out, ordered)
    console = Console()
    console.print(summary_table(ordered))
    failed = [row for row in ordered if row["reason"]]
    for row in failed:
        text = f"failed: {row['x']}, {row['y']}: {row['reason']}"
        console.print(text, soft_wrap=True, markup=False)
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)
    if failed:
        raise typer.Exit(1)


def prepare(path: Path, largest: bool, mend: bool = False) -> None:
    """Check a mesh and put its spectrum into the cache, for all of its pairs."""
    from jfsf.matching import basis

    basis(matchable(path, largest, mend).mesh, name=str(path))


def work(
    job,
    orientation: str,
    largest_component: bool,
    partial: bool = False,
    repair: bool = False,
    report: bool = False,
    same_unit: bool = True,
) -> None:
    """Match a pair and write it, and its page, as `jfsf match` does."""
    from jfsf.mapfiles import read_match
    from jfsf.matching import match

    x, y = (matchable(path, largest_component, repair) for path in job.inputs)
    if report and _is_done(job):
        # Only its page is missing.
        result, seconds = kept_match(read_match(job.out), x, y), {}
    else:
        started = perf_counter()
        options: dict[str, Any] = {"orientation": orientation, "partial": partial}
        if not same_unit:
            options["same_unit"] = False
        result = match(x.mesh, y.mesh, **options)
        seconds = {"matching": perf_counter() - started}
        write_found(job.out, result, x, y)
    if report:
        shapes = zip(job.inputs, (x, y), strict=True)
        inputs = [(path, own.mesh, own.index) for path, own in shapes]
        pair_page(job.out, inputs, result, orientation=orientation, seconds=seconds)


def _is_done(job) -> bool:
    from jfsf.batch import is_done
    from jfsf.mapfiles import MapFileError, read_match

    try:
        return is_done(job) and bool(np.size(read_match(job.out).T_xy))
    except MapFileError:  # damaged, say by a crash of the machine: made again
        return False


def _is_reported(job) -> bool:
    if not _is_done(job):
        return False
    made = job.out.stat().st_mtime_ns
    files = pages_of(job.out)
    return all(f.exists() and f.stat().st_mtime_ns >= made for f in files)
