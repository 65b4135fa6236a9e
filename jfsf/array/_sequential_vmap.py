"""Functions that vmap runs as a loop on a CPU."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap


def sequential_vmap(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function`, except that vmap of it is a loop on a CPU.

    The intermediate arrays of one call fit into the cache of a CPU, and those of a
    batch often do not. On other devices vmap works as usual.

    Args:
        function: of arrays. jax cannot differentiate the loop, so pass its arguments
            through `jax.lax.stop_gradient`.
    """
    batchable = custom_vmap(function)

    @batchable.def_vmap
    def rule(size, batched, *args):
        repeat = lambda x: jnp.broadcast_to(x, (size, *jnp.shape(x)))
        stack = lambda is_batched, x: x if is_batched else repeat(x)
        results = jax.lax.platform_dependent(
            *jax.tree.map(stack, tuple(batched), args),
            cpu=lambda *batch: jax.lax.map(lambda one: function(*one), batch),
            default=jax.vmap(function),
        )
        return results, jax.tree.map(lambda _: True, results)

    return batchable
