"""Thousands of jobs through dask.distributed: resumable, and no bad one stops the rest.

A job makes one file from some inputs and is done when that file is there, newer than
its inputs, as with make. So a run that was killed goes on where it was. What an input
needs first (its spectrum, into the disk cache) is done once for all jobs that share it.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from uuid import uuid4

if TYPE_CHECKING:
    from distributed import Client


class Job(NamedTuple):
    """Make `out` from `inputs`.

    out: written whole or not at all: under another name, then renamed.
    """

    inputs: tuple[Path, ...]
    out: Path


class Outcome(NamedTuple):
    """What became of a job.

    reason: why it failed; None when `out` is there.
    earlier: `out` was there before this run.
    seconds: what the work took; nan when there was none.
    """

    job: Job
    reason: str | None
    earlier: bool
    seconds: float


def run(
    jobs: Sequence[Job],
    client: "Client",
    *,
    prepare: Callable[[Path], None],
    work: Callable[[Job], None],
    done: Callable[[Job], bool] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Outcome]:
    """Do what is not done yet, and tell of each job as it ends.

    A worker that dies is replaced and its job given to another, by dask; a job that
    several workers died of has failed.

    Args:
        jobs: each with an `out` of its own.
        client: of `cluster.connect`. Workers must see the inputs and the folders of
            `out` under the same paths.
        prepare: run once an input, before the work of its jobs; what it raises is why
            they fail.
        work: writes job.out. Both are functions of a module that workers can import.
        done: whether a job needs no work; `is_done` when absent.
        progress: called with how many inputs are prepared, and of how many.

    Yields:
        One outcome a job, in the order in which they end.

    Raises:
        ValueError: two jobs have one `out`.
    """
    from distributed import as_completed

    outs = {}
    for job in jobs:
        if (twin := outs.setdefault(job.out, job)) is not job:
            raise ValueError(
                f"run: {job.out} is the file of {_named(twin)} and of {_named(job)}"
            )
    left = []
    for job in jobs:
        if (done or is_done)(job):
            yield Outcome(job, None, True, math.nan)
        else:
            left.append(job)
    inputs = list(dict.fromkeys(path for job in left for path in job.inputs))
    submit = lambda label, *call, **options: client.submit(
        *call, key=f"{label}-{uuid4().hex}", pure=False, **options
    )
    # Prepared first of all: bad inputs show at once.
    ready = {p: submit(p.name, _prepared, prepare, p, priority=1) for p in inputs}
    futures = {
        submit(job.out.name, _worked, work, job, [ready[p] for p in job.inputs]): job
        for job in left
    }
    prepared = 0
    for future in as_completed([*ready.values(), *futures]):
        job = futures.pop(future, None)
        if job is None:
            prepared += 1
            if progress is not None:
                progress(prepared, len(inputs))
            continue
        try:
            reason, seconds = future.result()
        except Exception as error:  # the worker died, not the work
            reason, seconds = _reason(error), math.nan
        yield Outcome(job, reason, False, seconds)


def is_done(job: Job) -> bool:
    """Whether `out` is there and none of the inputs is newer, or gone."""
    try:
        made = job.out.stat().st_mtime_ns
        return all(path.stat().st_mtime_ns <= made for path in job.inputs)
    except OSError:
        return False


def _prepared(prepare, path) -> str | None:
    try:
        prepare(path)
    except Exception as error:
        return _reason(error)


def _worked(work, job, reasons) -> tuple[str | None, float]:
    start = time.perf_counter()
    reason = next(filter(None, reasons), None)
    if reason is not None:
        return reason, math.nan
    try:
        work(job)
    except Exception as error:
        return _reason(error), time.perf_counter() - start
    return None, time.perf_counter() - start


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    # The project's own messages say all; of others the kind is half the message.
    if isinstance(error, ValueError | OSError) and text:
        return text
    return f"{type(error).__name__}: {text}"


def _named(job: Job) -> str:
    return " and ".join(map(str, job.inputs))
