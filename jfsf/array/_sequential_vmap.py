"""Functions that vmap runs as a loop: on a CPU, or everywhere."""

from collections.abc import Callable
from typing import Any

import jax
from jax.custom_batching import custom_vmap


def sequential_vmap(
    function: Callable[..., Any], *, everywhere: bool = False
) -> Callable[..., Any]:
    """`function`, except that vmap of it is a loop, on a CPU or everywhere.

    On a CPU, the intermediate arrays of one call fit into the cache, and those of a
    batch often do not. Everywhere, because a `jax.lax.cond` of a batched predicate
    evaluates both branches; in a loop each element takes its own.

    Args:
        function: of arrays. jax cannot differentiate the loop, so pass its arguments
            through `jax.lax.stop_gradient`.
        everywhere: loop on all devices, also where vmaps are nested. If not, vmap works
            as usual but on a CPU, and there the outermost alone is a loop.
    """
    batchable = custom_vmap(function)

    @batchable.def_vmap
    def rule(_, batched, *args):
        leaves, tree = jax.tree.flatten(args)
        flags = jax.tree.leaves(tuple(batched))
        of_batch = [x for flag, x in zip(flags, leaves, strict=True) if flag]

        def one(function, some):
            rest = iter(some)
            picked = (
                next(rest) if flag else x for flag, x in zip(flags, leaves, strict=True)
            )
            return function(*tree.unflatten(picked))

        if everywhere:
            # `batchable` itself, so that vmap of the loop is a loop in the loop.
            results = jax.lax.map(lambda some: one(batchable, some), of_batch)
        else:
            results = jax.lax.platform_dependent(
                of_batch,
                cpu=lambda batch: jax.lax.map(lambda some: one(function, some), batch),
                default=jax.vmap(lambda some: one(function, some)),
            )
        return results, jax.tree.map(lambda _: True, results)

    return batchable
