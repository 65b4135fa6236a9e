"""What begins a loop inside `jax.shard_map`, typed as what the loop makes of it.

`jax.shard_map` keeps track of the mesh axes over which a value differs from device to
device. A loop's carry may not gain one on the way. So where it begins with a constant,
or with fewer arguments than the loop reads, its start is declared to vary, too.
"""

from typing import Any, TypeVar

import jax

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
