"""A dask cluster for a long run: a local one, or one that is already running."""

import logging
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distributed import Client

# Bytes for each local worker; matching two meshes of 5000 vertices takes less.
MEMORY_PER_WORKER = 2 << 30


@contextmanager
def connect(
    scheduler: str | None = None,
    *,
    workers: int | None = None,
    timeout: float = 20,
) -> "Iterator[Client]":
    """A dask client, closed on exit, together with its cluster if that is local.

    Local processes ignore Ctrl-C: the process that has started them hears it alone.

    Args:
        scheduler: "host:port" of a dask scheduler; when absent a local cluster is
            started.
        workers: processes of the local cluster, each with one task at a time. When
            absent one for each core, but no more than memory allows.
        timeout: seconds to wait for the scheduler.

    Raises:
        ImportError: dask.distributed is not installed.
        OSError: no scheduler answers at that address in time.
        ValueError: `workers` is below 1, or given beside `scheduler`.
    """
    if workers is not None and workers < 1:
        raise ValueError(f"connect: workers is {workers}, it must be 1 or more")
    if workers is not None and scheduler is not None:
        raise ValueError(
            f"connect: the workers are those of {scheduler}; leave out workers"
        )
    try:
        import distributed
    except ImportError:
        raise ImportError(
            "many pairs are run by dask.distributed: pip install 'jfsf[batch]'"
        ) from None
    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=timeout)
        except (OSError, TimeoutError) as error:
            raise OSError(
                f"no dask scheduler answers at {scheduler}; start one with "
                f"'dask scheduler', or leave the address out ({error})"
            ) from None
        with client:
            yield client
        return
    from dask.system import CPU_COUNT
    from distributed.system import MEMORY_LIMIT
    from distributed.utils import LoopRunner

    workers = workers or max(1, min(CPU_COUNT, MEMORY_LIMIT // MEMORY_PER_WORKER))
    runner = LoopRunner()
    with _without_interrupts():
        runner.start()
    cluster = distributed.LocalCluster(
        loop=runner.loop,
        silence_logs=logging.ERROR,  # what it does when a worker dies is no news
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",  # any free port, so that two runs can coexist
        # No limit for each: results are small, so there is nothing to spill to disk,
        # and a large mesh may need more than an equal part of the memory.
        memory_limit=0,
    )
    try:
        with cluster, distributed.Client(cluster) as client:
            yield client
    finally:
        runner.stop()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """A thread that is begun here does not get SIGINT, nor do processes begun by it.

    A terminal sends it to all of them at once, and each would print a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
