"""Several processes or machines, each with its share of the work.

Nothing is exchanged once all have joined: each process computes its share on its own
devices and keeps the results, and one that is slow holds up no other.
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
        process_id: this one's number, from 0.

    Raises:
        ValueError: only some of the three are given.
        RuntimeError: jax has run already, or the others did not come.
    """
    given = coordinator, num_processes, process_id
    if None in given and given != (None, None, None):
        raise ValueError(
            "join: give coordinator, num_processes and process_id, or none of them; "
            f"got {given}"
        )
    jax.distributed.initialize(coordinator, num_processes, process_id)


def share(items: Sequence[Any]) -> list[Any]:
    """This process's part of `items`: every num_processes-th, from its own number on.

    The parts of all processes make up `items`, each once; alone, a process has all.
    """
    return list(items[jax.process_index() :: jax.process_count()])
