"""Thousands of jobs through dask.distributed: resumable, and each fails on its own.

A job makes one file from some inputs and is done when that file exists and is not older
than its inputs, as with make. So a run that was killed can be continued. An input is
prepared (its spectrum is put into the disk cache) once for all jobs that share it.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import is_zipfile

if TYPE_CHECKING:
    from distributed import Client


class Job(NamedTuple):
    """Make `out` from `inputs`.

    out: to be written atomically (`write_atomically`), because a file that
        exists counts as done.
    extras: further files that it is made from, which need no preparation.
    options: what else the work is told, hashable.
    """

    inputs: tuple[Path, ...]
    out: Path
    extras: tuple[Path, ...] = ()
    options: Any = None


class Outcome(NamedTuple):
    """The result of a job.

    reason: why the job failed; None if it succeeded.
    earlier: whether it was done before this run.
    seconds: seconds that the work took; nan if none was done.
    """

    job: Job
    reason: str | None
    earlier: bool
    seconds: float


def run_jobs(
    jobs: Sequence[Job],
    client: "Client",
    *,
    prepare: Callable[[Path], None],
    work: Callable[[Job], None],
    done: Callable[[Job], bool] | None = None,
    progress: Callable[[int, int], None] | None = None,
    say: Callable[[Exception], str] = str,
) -> Iterator[Outcome]:
    """Do the jobs that are not done yet, and yield the outcome of each as it ends.

    dask replaces a worker that dies and gives its job to another worker. A job that
    kills several workers is run again with no other job beside it, and fails if it then
    kills its workers too.

    Args:
        jobs: each with an `out` of its own.
        client: from `connect`. Workers must see the inputs and the folders of `out`
            under the same paths.
        prepare: called once an input, before any work. If it raises, the jobs of that
            input fail for that reason.
        work: writes job.out. Both are functions of a module that workers can import.
        done: whether a job needs no work; `is_done` when absent.
        progress: called with the number of inputs prepared, from 0 on, and of all.
        say: the message of an error, for `Outcome.reason`. As `prepare` and `work` it
            is a function of a module that workers can import.

    Yields:
        One outcome a job, as they end.

    Raises:
        ValueError: two jobs have the same `out`.
    """
    outs = {}
    for job in jobs:
        if (twin := outs.setdefault(job.out, job)) is not job:
            raise ValueError(
                f"run_jobs: {job.out} is the file of {_named(twin)} and of "
                f"{_named(job)}"
            )
    left = []
    for job in jobs:
        if (done or is_done)(job):
            yield Outcome(job, None, True, math.nan)
        else:
            left.append(job)
    inputs = list(dict.fromkeys(path for job in left for path in job.inputs))
    reasons = {}
    calls = {path: (timed, prepare, path, say) for path in inputs}
    if progress is not None:
        progress(0, len(inputs))
    for count, (path, (reason, _)) in enumerate(_results(client, calls), 1):
        reasons[path] = reason
        if progress is not None:
            progress(count, len(inputs))
    calls = {}
    for job in left:
        reason = next(filter(None, (reasons[path] for path in job.inputs)), None)
        if reason is not None:
            yield Outcome(job, reason, False, math.nan)
        else:
            calls[job] = (timed, work, job, say)
    for job, (reason, seconds) in _results(client, calls):
        yield Outcome(job, reason, False, seconds)


def _results(client, calls: dict) -> Iterator[tuple[Any, tuple[str | None, float]]]:
    """(name, reason and seconds) of each call as it ends."""
    from distributed import KilledWorker, as_completed

    submit = lambda name: client.submit(*calls[name], pure=False)
    waiting, running, suspects = deque(calls), {}, []
    # By default as_completed takes the event loop of the latest client.
    futures = as_completed(loop=client.loop)

    # When a worker dies, dask counts the death against every task assigned to it. So no
    # more tasks are submitted than the workers can run at once.
    def submit_next():
        threads = max(1, sum(client.nthreads().values()))
        while waiting and len(running) < threads:
            name = waiting.popleft()
            future = submit(name)
            running[future] = name
            futures.add(future)

    submit_next()
    for future in futures:
        name = running.pop(future)
        if isinstance(_error(future), KilledWorker):
            suspects.append(name)
        else:
            yield name, _result(future)
        submit_next()
    # Calls that shared a worker with a deadly one are suspects too. Run one at a time,
    # only the deadly ones fail.
    for name in suspects:
        yield name, _result(submit(name))


def _error(future) -> BaseException | None:
    return future.exception() if future.status == "error" else None


def _result(future) -> tuple[str | None, float]:
    try:
        return future.result()
    except Exception as error:  # of dask: `timed` catches those of the work
        return _reason(error, str), math.nan


def is_done(job: Job) -> bool:
    """Whether `out` exists and all inputs and extras exist and are not newer.

    A `.npz` that is cut short, say by a crash of the machine, does not count.
    """
    try:
        if job.out.suffix == ".npz" and not is_zipfile(job.out):
            return False
        made = job.out.stat().st_mtime_ns
        used = *job.inputs, *job.extras
        return all(path.stat().st_mtime_ns <= made for path in used)
    except OSError:
        return False


def timed(function, argument, say) -> tuple[str | None, float]:
    """Why a call failed, None if it did not, and the seconds that it took."""
    start = time.perf_counter()
    try:
        function(argument)
    except Exception as error:
        return _reason(error, say), time.perf_counter() - start
    return None, time.perf_counter() - start


def _reason(error: Exception, say: Callable[[Exception], str]) -> str:
    text = " ".join(say(error).split())
    # The messages of this package are complete sentences; others need their type.
    if isinstance(error, ValueError | OSError) and text:
        return text
    return f"{type(error).__name__}: {text}"


def _named(job: Job) -> str:
    return " and ".join(map(str, job.inputs))
