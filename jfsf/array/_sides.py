"""One function applied to both shapes, compiled once."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def map_sides(
    function: Callable[..., Any], x: tuple[Any, ...], y: tuple[Any, ...]
) -> tuple[Any, Any]:
    """(function(*x), function(*y)).

    When all shapes and types of x and y agree, `function` is traced and compiled once
    and runs in a loop of two steps, in which the arguments are copied. Otherwise it is
    traced twice. Padding both shapes to one size (`pad`) makes them agree.

    Args:
        function: traceable by jax.
        x, y: its positional arguments, trees of arrays; None is allowed.
    """
    if jax.tree.map(jax.typeof, x) != jax.tree.map(jax.typeof, y):
        return function(*x), function(*y)

    def side(first):
        # Not a stack of both: of large shapes that would be twice as much memory.
        return function(*jax.tree.map(lambda a, b: jnp.where(first, a, b), x, y))

    results = jax.lax.map(side, jnp.array([True, False]))
    result = lambda i: jax.tree.map(lambda a: a[i], results)
    return result(0), result(1)
