"""Loops: over both shapes, in place of a vmap, and inside `jax.shard_map`.

`jax.shard_map` keeps track of the mesh axes over which a value differs from device to
device. A loop's carry may not gain one on the way. So where it begins with a constant,
or with fewer arguments than the loop reads, `varying_as` declares its start to vary.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap

T = TypeVar("T")


def varying_as(start: T, *read: Any) -> T:
    """`start`, declared to vary over all mesh axes that the others vary over.

    Its values stay as they are, and outside of `jax.shard_map` it is returned as it is.

    Args:
        start: a tree of arrays.
        read: trees of arrays, of which the loop reads the values.
    """
    axes = frozenset().union(*map(_axes, jax.tree.leaves(read)))
    if not axes:
        return start

    def cast(leaf):
        missing = tuple(sorted(axes - _axes(leaf)))
        return jax.lax.pcast(leaf, missing, to="varying") if missing else leaf

    return jax.tree.map(cast, start)


def _axes(leaf: Any) -> frozenset[Any]:
    return getattr(jax.typeof(leaf), "vma", frozenset())


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
