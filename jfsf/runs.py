"""Thousands of jobs through dask.distributed: resumable, and no bad one stops the rest.

A job makes one file from some inputs and is done when that file is there, newer than
its inputs, as with make. So a run that was killed goes on where it was. What an input
needs first (its spectrum, into the disk cache) is done once for all jobs that share it.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

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
    several workers died of, also when it was alone, has failed.

    Args:
        jobs: each with an `out` of its own.
        client: of `cluster.connect`. Workers must see the inputs and the folders of
            `out` under the same paths.
        prepare: run once an input, before any work; what it raises is why the jobs of
            that input fail.
        work: writes job.out. Both are functions of a module that workers can import.
        done: whether a job needs no work; `is_done` when absent.
        progress: called with how many inputs are prepared, and of how many.

    Yields:
        One outcome a job, as they end.

    Raises:
        ValueError: two jobs have one `out`.
    """
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
    bad = {}
    calls = {path: (_timed, prepare, path) for path in inputs}
    for count, (path, (reason, _)) in enumerate(_results(client, calls), 1):
        bad[path] = reason
        if progress is not None:
            progress(count, len(inputs))
    calls = {}
    for job in left:
        reason = next((bad[path] for path in job.inputs if bad[path]), None)
        if reason is not None:
            yield Outcome(job, reason, False, math.nan)
        else:
            calls[job] = (_timed, work, job)
    for job, (reason, seconds) in _results(client, calls):
        yield Outcome(job, reason, False, seconds)


def _results(client, calls: dict) -> Iterator[tuple[Any, tuple[str | None, float]]]:
    """(name, reason and seconds) of each call as it ends."""
    from distributed import KilledWorker, as_completed

    submit = lambda name: client.submit(*calls[name], pure=False)
    waiting, going, suspects = deque(calls), {}, []
    # Without its loop it would take that of whichever client is the latest.
    futures = as_completed(loop=client.loop)

    # dask blames whatever a worker had when it died, so no worker is to have more than
    # it can do at once.
    def feed():
        room = max(1, sum(client.nthreads().values()))
        while waiting and len(going) < room:
            name = waiting.popleft()
            future = submit(name)
            going[future] = name
            futures.add(future)

    feed()
    for future in futures:
        name = going.pop(future)
        if isinstance(_error(future), KilledWorker):
            suspects.append(name)
        else:
            yield name, _result(future)
        feed()
    # One by one the guilty kill only themselves.
    for name in suspects:
        yield name, _result(submit(name))


def _error(future) -> BaseException | None:
    return future.exception() if future.status == "error" else None


def _result(future) -> tuple[str | None, float]:
    try:
        return future.result()
    except Exception as error:  # the worker's, not the work's: that is caught there
        return _reason(error), math.nan


def is_done(job: Job) -> bool:
    """Whether `out` is there and none of the inputs is newer, or gone."""
    try:
        made = job.out.stat().st_mtime_ns
        return all(path.stat().st_mtime_ns <= made for path in job.inputs)
    except OSError:
        return False


def _timed(function, argument) -> tuple[str | None, float]:
    start = time.perf_counter()
    try:
        function(argument)
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
