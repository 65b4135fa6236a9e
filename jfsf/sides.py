"""What is done to X and to Y alike, compiled once."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def both(function: Callable[..., Any], x: tuple, y: tuple) -> tuple[Any, Any]:
    """(function(*x), function(*y)).

    Arguments of equal shapes and types go through a loop of two rounds: half the
    program to trace and to compile, for the cost of a copy. Pad the shapes to one size
    (`padding.pad`) to have that.
    """
    if jax.tree.map(jax.typeof, x) != jax.tree.map(jax.typeof, y):
        return function(*x), function(*y)
    stacked = jax.tree.map(lambda *pair: jnp.stack(pair), x, y)
    found = jax.lax.map(lambda side: function(*side), stacked)
    of = lambda i: jax.tree.map(lambda a: a[i], found)
    return of(0), of(1)
