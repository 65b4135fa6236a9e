"""Several processes or machines: each with its shard, or through a dask cluster.

Processes that have joined exchange nothing: each computes its shard on its own devices
and keeps the results, so a slow one does not delay the others.
"""

import logging
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import jax

if TYPE_CHECKING:
    from distributed import Client


def join(
    coordinator: str | None = None,
    num_processes: int | None = None,
    process_id: int | None = None,
) -> None:
    """Make this process one of several, before anything else is done with jax.

    On clusters that jax knows (Slurm, Open MPI, TPU pods, ...) no argument is needed.

    Args:
        coordinator: "host:port" of process 0, reachable from all.
        num_processes: how many there are.
        process_id: the number of this one, from 0.

    Raises:
        ValueError: only some of the three are given.
        RuntimeError: jax has run already, or the others did not join.
    """
    given = coordinator, num_processes, process_id
    if None in given and given != (None, None, None):
        raise ValueError(
            "join: give coordinator, num_processes and process_id, or none of them; "
            f"got {given}"
        )
    jax.distributed.initialize(coordinator, num_processes, process_id)


def local_shard(items: Sequence[Any]) -> list[Any]:
    """The shard of this process: every num_processes-th item, from its own number on.

    Each of `items` is in the shard of exactly one process. A single process has all.
    """
    return list(items[jax.process_index() :: jax.process_count()])


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
