"""Compile large programs early and in less time, and keep them on disk."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from jfsf.array import describe
from jfsf.storage._cache import fetch, key

PACKAGE = Path(__file__).parents[1]
# All code that is traced, as it is at import: a file may have changed when a program is
# asked for.
CODE = key(
    *map(version, ("jax", "jaxlib", "jaxopt", "lineax")),
    *(file.read_bytes() for file in sorted(PACKAGE.rglob("*.py"))),
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
        platform: that it will run on; there are options for "cpu" only.
        static: `static_argnames` and `static_argnums`.
    """
    options = _cpu_options() if platform == "cpu" else {}
    return jax.jit(function, compiler_options=options, **static)


class Program(NamedTuple):
    """A function lowered for arguments of some shapes.

    run: the function.
    lowered: by jax, to be compiled.
    """

    run: Callable
    lowered: Any

    @property
    def result(self) -> Any:
        """Shapes and types of what it returns."""
        return self.lowered.out_info

    def __call__(self, *args: Any) -> Any:
        """What the function returns."""
        return self.run(*args)


def compile_ahead(
    function: Callable,
    *args: Any,
    records: tuple[type, ...],
    keep: bool = True,
    pool: Executor | None = None,
    **options: Any,
) -> Program:
    """`partial(function, **options)` by `large_jit`, already compiled on return.

    So a program can be compiled while its arguments are still being computed.

    Where jax keeps compiled programs on disk (`jax_compilation_cache_dir`), a new
    process still traces and lowers for seconds to find out which of them it needs. So
    the lowered program is kept too, in the folder of `jfsf.storage.folder`. It is found
    again by all that it depends on: the code of this package, the versions of jax, its
    settings, the options and the shapes of the arguments. On a CPU only.

    Args:
        function: of this package; the same object in each call.
        args: arrays, numbers, and records of them, or `jax.ShapeDtypeStruct` for
            arrays. Only shapes and types count.
        records: the classes of NamedTuple among arguments and results.
        keep: False leaves the cache folder alone. So do options that hold a function
            from outside this package, whose code is not known.
        pool: compiles it, beside the caller; it is ready when the pool is shut down.
        options: static.
    """
    platform = jax.default_backend()
    config = jax.config.values
    text = _describe_own(options)
    keep = keep and platform == "cpu" and bool(config["jax_compilation_cache_dir"])
    leaves, tree = jax.tree.flatten(args)
    shapes = tuple(map(jax.typeof, leaves))
    static, named = (tuple(sorted(d.items())) for d in (options, config))
    kept = None
    if keep and text is not None:
        kept = records, program_key(function, text, str(tree), shapes, repr(named))
    found = _lowered(function, static, tree, shapes, kept, platform, repr(named))
    if pool is None:
        _compile(found.lowered)
    else:
        pool.submit(_compile, found.lowered)
    return found


def program_key(function: Callable, *parts: Any, code: str = CODE) -> str:
    """The name on disk of a program of `function` that depends on `parts`."""
    return key(code, function.__module__, function.__qualname__, *parts)


def supported(options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of XLA's compiler options for CPUs that the installed XLA knows."""
    known = {}
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        probe = jax.jit(lambda x: x).lower(0.0)
    for name, value in options.items():
        try:
            probe.compile(compiler_options={name: value})
        except jax.errors.JaxRuntimeError:
            continue
        known[name] = value
    return known


class _Lowered(NamedTuple):
    program: np.ndarray  # bytes


@cache
def _cpu_options() -> dict[str, Any]:
    return supported(CPU_OPTIONS)


@cache
def _lowered(function, options, tree, shapes, kept, platform, _config) -> Program:
    args = jax.tree.unflatten(tree, shapes)
    program = partial(function, **dict(options))
    if kept is not None:
        program = _kept(program, args, *kept)
    run = large_jit(program, platform)
    return Program(run, run.lower(*args))


@cache
def _compile(lowered) -> None:
    # jax finds what it compiled here when the program is called.
    lowered.compile()


def _kept(function, args, records, name) -> Callable:
    """`function` as the first process that needed it has lowered it."""
    for record in records:
        _register(record)

    def lower():
        program = export.export(jax.jit(function))(*args)
        return _Lowered(np.frombuffer(program.serialize(), np.uint8))

    try:
        found = fetch(name, _Lowered, lower)
    except NotImplementedError:  # it cannot be exported: it prints, say
        return function
    # A program that was not lowered in this process has no LAPACK, and crashes (jax
    # issue 29610).
    jax.jit(jnp.linalg.cholesky).lower(jnp.eye(1))
    return export.deserialize(bytearray(found.program)).call


def _register(record: type) -> None:
    """Tell jax under which name a program on disk holds this record."""
    name = f"{record.__module__}.{record.__qualname__}"
    with suppress(ValueError):  # it has a name already
        export.register_namedtuple_serialization(record, serialized_name=name)


def _describe_own(options: dict[str, Any]) -> str | None:
    """The text of static options; None if they hold a function of somebody else's."""
    own = __name__.partition(".")[0]

    def name_of(function):
        module = getattr(function, "__module__", None) or ""
        if module.partition(".")[0] != own:
            raise _ForeignFunctionError
        return f"{module}.{function.__qualname__}"

    try:
        return describe(tuple(sorted(options.items())), name_of=name_of)
    except _ForeignFunctionError:
        return None


class _ForeignFunctionError(Exception):
    pass
