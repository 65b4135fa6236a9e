"""jit for programs so large that compiling them takes longer than running them."""

from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from jfsf import cache as disk

# Of all that is traced, as it is now: a file may have changed by the time it is asked.
CODE = disk.key(
    *map(version, ("jax", "jaxlib", "jaxopt", "lineax")),
    *(file.read_bytes() for file in sorted(Path(__file__).parent.rglob("*.py"))),
)
# Measured on `match`: half of XLA's time to compile for a CPU, and no more to run.
CPU_OPTIONS = {
    "xla_backend_optimization_level": 1,
    "xla_cpu_use_fusion_emitters": False,
    "xla_disable_hlo_passes": "tree_reduction_rewriter",
}


@cache
def large_jit(function: Callable, platform: str, **static: Any) -> jax.stages.Wrapped:
    """`jax.jit(function, **static)` that compiles faster; not for use inside a jit.

    Args:
        function: the same object in each call, or it compiles anew.
        platform: that it will run on; "cpu" is what there are options for.
        static: `static_argnames` and `static_argnums`.
    """
    options = _known() if platform == "cpu" else {}
    return jax.jit(function, compiler_options=options, **static)


def ready(
    function: Callable,
    *args: Any,
    records: tuple[type, ...],
    keep: bool = True,
    **options: Any,
) -> Callable:
    """`partial(function, **options)` by `large_jit`, compiled when it is returned.

    So it can compile while its arguments are still being computed.

    Where jax keeps compiled programs on disk (`jax_compilation_cache_dir`), a new
    process still traces and lowers, for seconds, to find out which one it needs. There
    the lowered program is kept too, in the cache folder of `jfsf.cache`, for each code,
    settings and shapes. On a CPU only.

    Args:
        function: of this package, whose files tell its programs apart, but not what is
            put in the place of its constants later; the same object in each call.
        args: arrays, numbers, and records of them, or `jax.ShapeDtypeStruct` for
            arrays: of those that the program will be called with the shapes count.
        records: the classes of NamedTuple among arguments and results.
        keep: False leaves the cache folder alone.
        options: static.
    """
    platform = jax.default_backend()
    settings = jax.config.values
    keep = keep and platform == "cpu" and bool(settings["jax_compilation_cache_dir"])
    leaves, tree = jax.tree.flatten(args)
    shapes = tuple(map(jax.typeof, leaves))
    static, named = (tuple(sorted(d.items())) for d in (options, settings))
    given = tree, shapes, records if keep else None, platform, repr(named)
    return _ready(function, static, *given)


class _Lowered(NamedTuple):
    program: np.ndarray  # bytes


@cache
def _ready(function, options, tree, shapes, records, platform, settings) -> Callable:
    args = jax.tree.unflatten(tree, shapes)
    program = partial(function, **dict(options))
    if records is not None:
        what = function.__module__, function.__qualname__, options, str(tree), shapes
        program = _kept(program, args, records, disk.key(CODE, *what, settings))
    run = large_jit(program, platform)
    # jax remembers what it compiled here when it is called.
    run.lower(*args).compile()
    return run


def _kept(function, args, records, key) -> Callable:
    """`function` as it was lowered by whichever process was the first."""
    for record in records:
        _name(record)

    def lower():
        program = export.export(jax.jit(function))(*args)
        return _Lowered(np.frombuffer(program.serialize(), np.uint8))

    try:
        found = disk.fetch(key, _Lowered, lower)
    except NotImplementedError:  # no program to keep: it prints, say
        return function
    # A program that was not lowered here has no LAPACK, and crashes (jax issue 29610).
    jax.jit(jnp.linalg.cholesky).lower(jnp.eye(1))
    return export.deserialize(bytearray(found.program)).call


def _name(record: type) -> None:
    """Tell jax how a program on disk names it."""
    name = f"{record.__module__}.{record.__qualname__}"
    with suppress(ValueError):  # it has a name already
        export.register_namedtuple_serialization(record, serialized_name=name)


@cache
def _known() -> dict[str, Any]:
    """Of `CPU_OPTIONS` those that this XLA has."""
    known = {}
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        probe = jax.jit(lambda x: x).lower(0.0)
    for name, value in CPU_OPTIONS.items():
        try:
            probe.compile(compiler_options={name: value})
        except jax.errors.JaxRuntimeError:
            continue
        known[name] = value
    return known
