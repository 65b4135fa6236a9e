"""What vmap makes of a function that a CPU does faster one by one."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap


def one_by_one(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function`, which vmap turns into a loop on a CPU: there the work of one stays in
    the cache, and that of many does not. Elsewhere vmap is as usual.

    Args:
        function: of arrays that no derivative is taken by (`jax.lax.stop_gradient`),
            for jax has none of the loop.
    """
    run = custom_vmap(function)

    @run.def_vmap
    def rule(size, batched, *args):
        repeat = lambda x: jnp.broadcast_to(x, (size, *jnp.shape(x)))
        stack = lambda is_many, x: x if is_many else repeat(x)
        found = jax.lax.platform_dependent(
            *jax.tree.map(stack, tuple(batched), args),
            cpu=lambda *many: jax.lax.map(lambda one: function(*one), many),
            default=jax.vmap(function),
        )
        return found, jax.tree.map(lambda _: True, found)

    return run
