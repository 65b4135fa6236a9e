"""Compile large programs early and in less time, and keep them on disk."""

import hashlib
import os
import pickle
import platform as machine
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import filelock
import jax
import jax.numpy as jnp
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from jfsf.array import describe
from jfsf.storage._atomic import write_atomically
from jfsf.storage._cache import folder, key

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
# Seconds to wait for another process that compiles the same program.
LOCK_SECONDS = 120
# The programs of this process.
known: dict[tuple, "Program"] = {}


@cache
def large_jit(function: Callable, platform: str, **static: Any) -> jax.stages.Wrapped:
    """`jax.jit(function, **static)` that compiles faster; not for use inside a jit.

    Args:
        function: the same object in each call, or it compiles anew.
        platform: that it will run on; there are options for "cpu" only.
        static: `static_argnames` and `static_argnums`.
    """
    return jax.jit(function, compiler_options=_compiler_options(platform), **static)


class Program:
    """A function for arguments of some shapes, compiled or being compiled.

    Attributes:
        result: shapes and types of what it returns, as `jax.ShapeDtypeStruct`.
    """

    def __init__(self, result: Any, compiled: Callable[[], Callable]) -> None:
        """`compiled` waits for a function from leaves to leaves."""
        self.result = result
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

    A compiled program is kept in the folder of `jfsf.storage.folder`: a new process
    neither traces nor compiles it, and of several processes that ask for it at a time
    one compiles. It is found again by all that it depends on: the code of this package,
    the versions of jax, its settings, the machine's processor, the options and the
    shapes of the arguments. On one CPU device only.

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
    config = _config()
    text = _describe_own(options)
    path = None
    if keep and text is not None and [d.platform for d in jax.devices()] == ["cpu"]:
        name = program_key(function, text, str(tree), shapes, config, _processor())
        path = folder() / f"{name}.program"
    asked = function, static, tree, shapes, config
    if asked not in known:
        known[asked] = _compiled(partial(function, **options), tree, shapes, path, pool)
    return known[asked]


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


@cache
def _compiler_options(platform: str) -> dict[str, Any]:
    return supported(CPU_OPTIONS) if platform == "cpu" else {}


@cache
def _processor() -> str:
    """What machine code depends on beside XLA."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        features = {line for line in lines if line.startswith(("flags", "Features"))}
    except OSError:
        features = {machine.processor()}
    return repr((machine.machine(), sorted(features), os.environ.get("XLA_FLAGS")))


def _config() -> str:
    """jax's settings, but for those of its own cache and of what it prints."""
    other = "jax_compilation_cache", "jax_persistent_cache", "jax_log"
    values = sorted(jax.config.values.items())
    return repr([pair for pair in values if not pair[0].startswith(other)])


def _shape(leaf) -> jax.ShapeDtypeStruct:
    aval = jax.typeof(leaf)
    return jax.ShapeDtypeStruct(aval.shape, aval.dtype, weak_type=aval.weak_type)


def _compiled(function, tree, shapes, path, pool) -> Program:
    kept = None if path is None else _load(path, len(shapes))
    if kept is not None:
        return kept
    release = _lock(path) if path is not None else lambda: None
    # Another process may have compiled it by now.
    kept = None if path is None else _load(path, len(shapes))
    if kept is not None:
        release()
        return kept
    trees = []

    def flat(*leaves):
        found, out = jax.tree.flatten(function(*jax.tree.unflatten(tree, leaves)))
        trees.append(out)
        return tuple(found)

    options = _compiler_options(jax.default_backend())
    try:
        lowered = jax.jit(flat, compiler_options=options).lower(*shapes)
    except BaseException:
        release()
        raise
    result = trees[-1].unflatten(map(_shape, lowered.out_info))

    def build():
        try:
            compiled = lowered.compile()
            if path is not None:
                _save(path, result, compiled)
        finally:
            release()
        return compiled

    if pool is None:
        compiled = build()
        return Program(result, lambda: compiled)
    return Program(result, pool.submit(build).result)


def _lock(path: Path) -> Callable[[], None]:
    """Wait until no other process compiles this program; returns what lets them go on.

    In a folder without locks several compile the same: slower, and no less right.
    """
    at = path.with_suffix(".lock")
    # Another thread than this one may release it.
    lock = filelock.FileLock(at, timeout=LOCK_SECONDS, thread_local=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except (OSError, NotImplementedError):  # `filelock.Timeout` is an OSError
        return lambda: None

    def release():
        with suppress(OSError):
            at.unlink()  # who waits for it will find the program
        lock.release()

    return release


def _save(path: Path, result, compiled) -> None:
    try:
        payload = pickle.dumps((serialize(compiled)[0], result))
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, lambda file: file.write(_digest(payload) + payload))
    except Exception:  # not writable; or it calls Python, which jax refuses variously
        pass


def _load(path: Path, num: int) -> Program | None:
    """The program of `num` arrays in the file; None for none, or a damaged one."""
    try:
        whole = path.read_bytes()
        head = len(_digest(b""))
        if whole[:head] != _digest(whole[head:]):
            return None
        # A process that has lowered no program has no LAPACK, and one that it loads
        # crashes (jax issue 29610).
        jax.jit(jnp.linalg.cholesky).lower(jnp.eye(1))
        payload, result = pickle.loads(whole[head:])
        into = jax.tree.structure(((0,) * num, {}))
        out = jax.tree.structure((0,) * len(jax.tree.leaves(result)))
        with _without_messages():
            compiled = deserialize_and_load(payload, into, out)
    except Exception:  # of another version, whatever the name says
        return None
    return Program(result, lambda: compiled)


@contextmanager
def _without_messages() -> Iterator[None]:
    """XLA logs two long lines for each program that it loads, which mean nothing."""
    name = "jax_logging_level"
    before = jax.config.values[name]
    levels = dict(enumerate(("INFO", "WARNING", "ERROR", "CRITICAL")))
    # jax sets nothing back to "not set", so first to what it had from the environment.
    cpp = levels.get(int(os.environ.get("TF_CPP_MIN_LOG_LEVEL") or 1), "WARNING")
    jax.config.update(name, "CRITICAL")
    try:
        yield
    finally:
        jax.config.update(name, cpp)
        jax.config.update(name, before)


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


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
