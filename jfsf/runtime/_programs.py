"""Compile large programs early and in less time, and keep them on disk.

What is kept is machine code. A fresh process gets the programs of a match of 5000
vertices in 1.2 s, against 15 s from `jax.export`'s StableHLO, which XLA compiles again,
and 20 s by tracing and compiling (`experiments/bench/bench_programs.py`, two cores).
Exports with jax's own cache of compiled programs take 1.4 s, but that is set for the
whole process. It holds machine code too, so a hostile file is no safer there;
`read_private` refuses files that another user can have written.
"""

import threading
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax

from jfsf.runtime._program_files import (
    jax_settings,
    load_program,
    program_lock,
    program_path,
    save_program,
)
from jfsf.storage._cache import NotPrivateError

# Measured on `match`: half of XLA's time to compile for a CPU, and no more to run. With
# jax 0.12, whose XLA has no fusion emitters to leave out, the programs take 63 CPU
# seconds (Python 3.13) for 44 with 0.9.2. Neither xla_cpu_opt_preset (FAST_COMPILE: 66)
# nor xla_llvm_disable_expensive_passes (69) takes less (`bench_compile.py`).
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
    return jax.jit(function, compiler_options=compiler_options(platform), **static)


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


@cache
def compiler_options(platform: str) -> dict[str, Any]:
    """Of `large_jit`, for a program that runs on that platform."""
    return supported(CPU_OPTIONS) if platform == "cpu" else {}


# A program of `match` takes 330 to 640 memory maps, 430 on average, and Linux ends a
# process that has 65 530. This many take a third of these, and half at most; pairs of
# all sizes need some twelve.
MOST_KNOWN = 48
# The programs of this process, the least recently used first.
known: dict[tuple, "Program"] = {}
_known_lock = threading.Lock()
_warned: set[Path] = set()  # folders


class Program:
    """A function for arguments of some shapes, compiled or being compiled.

    Attributes:
        result: shapes and types of what it returns, as `jax.ShapeDtypeStruct`.
    """

    def __init__(
        self,
        result: Any,
        compiled: Callable[[], Callable],
        ready: Callable[[], bool] = lambda: True,
    ) -> None:
        """`compiled` waits for a function from leaves to leaves, if it is not ready."""
        self.result = result
        self.ready = ready
        self._compiled = compiled

    def __call__(self, *args: Any) -> Any:
        """What the function returns."""
        found = self._compiled()(*jax.tree.leaves(args))
        return jax.tree.structure(self.result).unflatten(found)


def compile_ahead(
    function: Callable[..., Any],
    *args: Any,
    keep: bool = True,
    pool: Executor | None = None,
    **options: Any,
) -> Program:
    """`partial(function, **options)` by `large_jit`, already compiled on return.

    So a program can be compiled while its arguments are still being computed.

    A compiled program is kept in `programs_folders`: a new process neither
    traces nor compiles it, and of several processes that ask for it at a time one
    compiles. It is found again by all that it depends on: the code of this package, the
    versions of jax, its settings, the machine's processor, the options and the shapes
    of the arguments. On one CPU device only, and only where no other user can write the
    folder or the file; otherwise a RuntimeWarning says why, once for a folder.

    Args:
        function: of this package; the same object in each call.
        args: arrays, numbers, and records of them, or `jax.ShapeDtypeStruct` for
            arrays. Only shapes and types count.
        keep: False leaves the cache folder alone. So do options that hold a function
            from outside this package, whose code is not known.
        pool: compiles it, beside the caller.
        options: static.
    """
    leaves, tree = jax.tree.flatten(args)
    shapes = tuple(map(_shape, leaves))
    static = tuple(sorted(options.items()))
    asked = function, static, tree, shapes, jax_settings()
    with _known_lock:
        found = known.get(asked)
    if found is None:
        path = program_path(function, options, str(tree), shapes) if keep else None
        with ExitStack() as stack:
            found, path = _kept(path, len(shapes), stack)
            if found is None:
                flat = _Flat(partial(function, **options), tree)
                choices = compiler_options(jax.default_backend())
                lowered = jax.jit(flat, compiler_options=choices).lower(*shapes)
                result = flat.tree_of_result.unflatten(map(_shape, lowered.out_info))
                found = _compiling(lowered, result, path, pool, stack.pop_all())
    with _known_lock:
        known.pop(asked, None)
        known[asked] = found  # the last to be dropped
        while len(known) > MOST_KNOWN:
            del known[next(iter(known))]
    return found


def _shape(leaf) -> jax.ShapeDtypeStruct:
    aval = jax.typeof(leaf)
    return jax.ShapeDtypeStruct(aval.shape, aval.dtype, weak_type=aval.weak_type)


class _Flat:
    """A function of the leaves of its arguments, which notes the tree of its result."""

    def __init__(self, function: Callable[..., Any], tree: Any) -> None:
        self._function, self._tree = function, tree
        self.__name__ = "flat"
        self.tree_of_result: Any = None

    def __call__(self, *leaves: Any) -> tuple:
        result = self._function(*jax.tree.unflatten(self._tree, leaves))
        flat, self.tree_of_result = jax.tree.flatten(result)
        return tuple(flat)


def _kept(
    path: Path | None, count: int, stack: ExitStack
) -> tuple[Program | None, Path | None]:
    """The program of a file, if there is one, and where a new one is to be kept.

    Where there is none, the lock of the file is taken, until `stack` is closed.
    """
    if path is None:
        return None, None
    try:
        kept = load_program(path, count)
        if kept is None:
            stack.enter_context(program_lock(path))
            # Another process may have compiled it by now.
            kept = load_program(path, count)
    except NotPrivateError as error:
        _warn_once(path.parent, error)
        return None, None
    if kept is None:
        return None, path
    loaded, result = kept
    return Program(result, lambda: loaded), path


def _compiling(lowered, result, path, pool, lock) -> Program:
    """The program that is compiled from now on, and then kept."""

    def build():
        with lock:
            compiled = lowered.compile()
            if path is not None:
                save_program(path, compiled, result)
        return compiled

    if pool is None:
        compiled = build()
        return Program(result, lambda: compiled)
    future = pool.submit(build)
    return Program(result, future.result, future.done)


def _warn_once(folder: Path, error: NotPrivateError) -> None:
    if folder not in _warned:
        _warned.add(folder)
        text = f"a compiled program is neither loaded nor kept: {error}"
        warnings.warn(text, RuntimeWarning, stacklevel=4)
