"""Several processes or machines, each with its shard of the work.

They exchange nothing once all have joined: each process computes its shard on its own
devices and keeps the results, so a slow one does not delay the others.
"""

from collections.abc import Sequence
from typing import Any

import jax


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
