"""One function mapped over many inputs: stacked, vmapped, sharded over the devices.

A call of the compiled program holds a fixed number of inputs, whose axis is sharded
over the devices. Each device loops over its shard, one vmapped batch at a time, and
stops at the last input. Inputs that do not fill a batch are run one by one, so n inputs
cost what n inputs cost.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jfsf.array._jit import jit
from jfsf.runtime._programs import large_jit

PAIRS = 32  # inputs a call, by default
AXIS = "pairs"
# No arrays, so not mapped: a trip count that is not mapped is one of all inputs.
NUMBERS = bool, int, float
STATIC = (0, 1, 2, 3, 4)  # arguments of `_sharded`


def map_pairs(
    function: Callable[..., Any],
    inputs: Iterable[tuple[Any, ...]],
    *,
    devices: Sequence[Any] | None = None,
    pairs: int = PAIRS,
    batch_size: int | None = None,
    fast_compile: bool = False,
    called: str | None = "pair",
    **options: Any,
) -> list[Any]:
    """`function(*input, **options)` for each of `inputs`.

    One program is compiled for each set of shapes and dtypes among the inputs, and with
    a `batch_size` above 1 another for those that do not fill a batch.

    Args:
        function: pure; the same object in each call, or it compiles anew.
        inputs: tuples of records of arrays. Numbers among them, which are no arrays,
            are not stacked: inputs that differ in them do not share a call.
        devices: devices that share the work; all of this process when absent.
        pairs: how many inputs one call of the program takes, rounded up to fill the
            devices; memory grows with it.
        batch_size: inputs vmapped at a time on a device. When absent, the whole shard
            on an accelerator, and one on a CPU, where several compete for the cache.
        fast_compile: compile in less time a program that may run a little longer
            (`large_jit`).
        called: what an input is called, with its number, before the message of an
            error; None leaves the message as it is.
        options: hashable options of `function`; they are static.

    Returns:
        The results in the order of the inputs, as numpy arrays.

    Raises:
        ValueError: `pairs` or `batch_size` is below 1, or what `function` raises, with
            the number of the input before the message.
    """
    check_batch(pairs, batch_size)
    mesh = Mesh(np.array(devices or jax.local_devices()), (AXIS,))
    shard = -(-pairs // mesh.size)
    if batch_size is None:
        batch_size = 1 if mesh.devices[0].platform == "cpu" else shard
    batch_size = min(batch_size, shard)
    shard = -(-shard // batch_size) * batch_size
    sharded = _sharded
    if fast_compile:
        sharded = large_jit(_sharded, mesh.devices[0].platform, static_argnums=STATIC)
    call = partial(sharded, function, tuple(sorted(options.items())), mesh)

    found: dict[int, Any] = {}

    def finish(key):
        group, done = groups[key], 0
        for count, *size in _calls(len(group), batch_size, shard, mesh.size):
            some = group[done : done + count]
            try:
                results = _call(call, mesh, key[:2], size, [own for _, own in some])
            except ValueError as error:
                if called is None:
                    raise
                raise ValueError(f"{called} {some[0][0]}: {error}") from error
            found.update((i, new) for (i, _), new in zip(some, results, strict=True))
            done += count
        group.clear()

    # A group of equal shapes is run as soon as it fills a call, so that no more inputs
    # of each shape are in memory at a time.
    groups: dict[Any, list] = defaultdict(list)
    for i, values in enumerate(inputs):
        leaves, tree = jax.tree.flatten(values)
        numbers = tuple(x if type(x) in NUMBERS else None for x in leaves)
        arrays = [_canonical(x) for x in leaves if type(x) not in NUMBERS]
        kinds = tuple(map(type, leaves))  # 1, True and 1.0 are equal
        key = tree, numbers, kinds, *((array.shape, array.dtype) for array in arrays)
        groups[key].append((i, arrays))
        if len(groups[key]) == shard * mesh.size:
            finish(key)
    for key in list(groups):
        finish(key)
    return [found[i] for i in range(len(found))]


def check_batch(pairs: int, batch_size: int | None) -> None:
    """ValueError for numbers that `map_pairs` does not take."""
    if pairs < 1 or (batch_size is not None and batch_size < 1):
        raise ValueError(
            "map_pairs: pairs and batch_size must be positive, got "
            f"{pairs} and {batch_size}"
        )


def _calls(
    count: int, batch_size: int, shard: int, devices: int
) -> Iterator[tuple[int, int, int]]:
    """(inputs, batch_size, shard) of each call: no batch is filled with copies."""
    even = batch_size * devices if batch_size > 1 else 1
    while count:
        inputs = min(count, shard * devices)
        if inputs >= even:
            inputs = inputs // even * even
            yield inputs, batch_size, shard
        else:
            yield inputs, 1, shard
        count -= inputs


def _call(call, mesh, form, size, inputs):
    """Deal the inputs out to the devices in turn, run, and collect."""
    batch_size, shard = size
    dealt = [inputs[i :: mesh.size] for i in range(mesh.size)]
    counts = np.array([len(some) for some in dealt], np.int32)
    # Copies of the first input fill the shards; they are never computed.
    full = [x for some in dealt for x in (some + inputs[:1] * shard)[:shard]]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *full)
    sharding = NamedSharding(mesh, PartitionSpec(AXIS))
    tree, numbers = form
    form = tree, tuple(number is None for number in numbers)
    arrays = jax.device_put((counts, batch), sharding)
    found = jax.device_get(call(batch_size, form, numbers, *arrays))
    rows = [(i % mesh.size) * shard + i // mesh.size for i in range(len(inputs))]
    return [jax.tree.map(lambda x, row=row: x[row], found) for row in rows]


@jit(static_argnums=STATIC)
def _sharded(function, options, mesh, batch_size, form, numbers, counts, batch):
    tree, array = form
    vectorise = _vmap_of_one if batch_size == 1 else jax.vmap

    def on_device(numbers, count, batch):
        def of_arrays(*arrays):
            left = iter(arrays)
            pairs = zip(array, numbers, strict=True)
            leaves = [next(left) if is_array else number for is_array, number in pairs]
            return function(*tree.unflatten(leaves), **dict(options))

        mapped = vectorise(of_arrays)
        take = lambda x, i: jax.lax.dynamic_slice_in_dim(x, i * batch_size, batch_size)
        run = lambda i: mapped(*(take(x, i) for x in batch))
        shard = len(batch[0])
        blank = jax.tree.map(
            lambda x: jnp.zeros((shard, *x.shape[1:]), x.dtype), jax.eval_shape(run, 0)
        )

        def step(i, found):
            put = lambda all, new: jax.lax.dynamic_update_slice_in_dim(
                all, new, i * batch_size, 0
            )
            return jax.tree.map(put, found, run(i))

        return jax.lax.fori_loop(0, -(-count[0] // batch_size), step, blank)

    spec = PartitionSpec(AXIS)
    # The devices exchange nothing. With the check on, each scan inside `function` would
    # have to declare that its carry varies over the mesh axis.
    spread = jax.shard_map(
        on_device,
        mesh=mesh,
        in_specs=(PartitionSpec(), spec, spec),
        out_specs=spec,
        check_vma=False,
    )
    return spread(numbers, counts, batch)


def _vmap_of_one(function):
    """vmap over one input, without the batch axis.

    Products with a batch axis are slower, and they round differently, which decides
    ties in another way.
    """

    def mapped(*batch):
        found = function(*jax.tree.map(lambda x: x[0], batch))
        return jax.tree.map(lambda x: x[None], found)

    return mapped


def _canonical(array):
    array = np.asarray(array)
    return array.astype(jax.dtypes.canonicalize_dtype(array.dtype))
