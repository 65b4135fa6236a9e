"""Where the work of a long run is done: a local dask cluster, or one that is there."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distributed import Client

MEMORY = 2 << 30  # bytes a worker at least: two meshes of 5000 vertices, with room
TIMEOUT = 20  # seconds to wait for a scheduler


@contextmanager
def connect(
    scheduler: str | None = None,
    *,
    workers: int | None = None,
    env: dict[str, str] | None = None,
) -> "Iterator[Client]":
    """A dask client, closed at the end, and its cluster with it if it is local.

    Args:
        scheduler: "host:port" of a dask scheduler; a cluster of this machine's own
            when absent.
        workers: processes of the local cluster, each with one task at a time; when
            absent one a core, as far as memory goes.
        env: environment variables of the local workers, set before they start.

    Raises:
        ImportError: dask.distributed is not installed.
        OSError: no scheduler answers there.
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
            client = distributed.Client(scheduler, timeout=TIMEOUT)
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

    workers = workers or max(1, min(CPU_COUNT, MEMORY_LIMIT // MEMORY))
    cluster = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",  # any port: two runs do not collide
        # Results are small: nothing to spill, and a large mesh may take what is free.
        memory_limit=0,
        env=env or {},
    )
    with cluster, distributed.Client(cluster) as client:
        yield client
