"""Compiled programs on disk: their names, and how they are read and written."""

import hashlib
import os
import pickle
import platform as machine
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import filelock
import jax
import jax.numpy as jnp
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from jfsf.array._jit import static_text
from jfsf.runtime._shared import shared_context
from jfsf.storage import key
from jfsf.storage._cache import (
    PROGRAM,
    NotPrivateError,
    limit_bytes,
    make_private,
    make_room,
    mark_used,
    programs_folders,
    read_private,
    write_private,
)

PACKAGE = Path(__file__).parents[1]
# All code that is traced, with fitted constants and weights, as they are at import: a
# file may have changed when a program is asked for.
CODE = key(
    *map(version, ("jax", "jaxlib", "jaxopt", "lineax", "optimistix", "equinox")),
    *(
        file.read_bytes()
        for kind in ("*.py", "*.json", "learned/*.npz")
        for file in sorted(PACKAGE.rglob(kind))
        if "apps" not in file.relative_to(PACKAGE).parts
    ),
)
# Packages whose code is known by the above.
OWN = (__name__.partition(".")[0],)
# Seconds to wait for another process that compiles the same program.
LOCK_SECONDS = 120
# What a file of machine code begins with.
MACHINE_CODE = {"darwin": b"\xcf\xfa\xed\xfe"}.get(sys.platform, b"\x7fELF")


def program_path(
    function: Callable, options: Mapping[str, Any], *parts: Any
) -> Path | None:
    """The file of the program of `partial(function, **options)`.

    None if the function, or one that options hold, is from outside this package, whose
    code is not known, or if it is for other devices than one CPU.

    Args:
        function: at the top of its module.
        options: static.
        parts: what else it depends on, beside jax's settings and the processor.

    Raises:
        ValueError: JFSF_CACHE_LIMIT is no number above 0.
    """
    held = function, tuple(sorted(options.items()))
    try:
        text = static_text(held, name_of=own_name)
    except ForeignError:
        return None
    if [d.platform for d in jax.devices()] != ["cpu"]:
        return None
    limit_bytes()  # a wrong limit is found before the work
    name = key(CODE, text, *parts, jax_settings(), _processor())
    return programs_folders()[0] / f"{name}{PROGRAM}"


@contextmanager
def program_lock(path: Path) -> Iterator[None]:
    """While no other process compiles this program; another thread may leave it.

    In a folder without locks several compile the same: slower, and no less right.
    """
    at = path.with_suffix(".lock")
    lock = filelock.FileLock(at, LOCK_SECONDS, mode=0o600, thread_local=False)
    with suppress(OSError, NotImplementedError):  # `filelock.Timeout` is an OSError
        make_private(path.parent)
        lock.acquire()
    try:
        yield
    finally:
        if lock.is_locked:
            with suppress(OSError):
                at.unlink()  # who waits for it will find the program
            lock.release()


def save_program(path: Path, compiled: jax.stages.Compiled, result: Any) -> None:
    """Write a program that returns `result`, if it can be written."""
    try:
        payload = pickle.dumps((serialize(compiled)[0], result))
        # XLA writes what came from jax's own cache without its machine code: it could
        # be read, but not run.
        if (
            jax.config.values["jax_compilation_cache_dir"]
            and MACHINE_CODE not in payload
        ):
            return
        write_private(path, _digest(payload) + payload)
        make_room()
    except Exception:  # not writable; or it calls Python, which jax refuses variously
        pass


def load_program(path: Path, num: int) -> tuple[Callable, Any] | None:
    """The program of `num` arrays in the file, and its `result`.

    None if there is no such file in any of `programs_folders`, or a damaged one.

    Raises:
        NotPrivateError: another user may have written it, so it is not loaded.
    """
    for place in programs_folders():
        if (found := _load(place / path.name, num)) is not None:
            return found
    return None


def _load(path: Path, num: int) -> tuple[Callable, Any] | None:
    try:
        whole = read_private(path)
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
    except NotPrivateError:
        raise
    except Exception:  # of another version, whatever the name says
        return None
    mark_used(path)
    return compiled, result


@shared_context
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


@cache
def _processor() -> str:
    """What machine code depends on beside XLA."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        features = {line for line in lines if line.startswith(("flags", "Features"))}
    except OSError:
        features = {machine.processor()}
    return repr((machine.machine(), sorted(features), os.environ.get("XLA_FLAGS")))


def jax_settings() -> str:
    """jax's settings, but for those of its own cache and of what it prints."""
    other = "jax_compilation_cache", "jax_persistent_cache", "jax_log"
    values = sorted(jax.config.values.items())
    return repr([pair for pair in values if not pair[0].startswith(other)])


def own_name(value: Any) -> str:
    """Where a function or a class of this package is found.

    Raises:
        ForeignError: anything else, or what is not found there: it was made in another
            function, or its name is that of something else.
    """
    module = getattr(value, "__module__", None) or ""
    path = getattr(value, "__qualname__", "")
    found: Any = None
    if module.partition(".")[0] in OWN:
        found = sys.modules.get(module)
        for name in path.split("."):
            found = getattr(found, name, None)
    if found is not value:
        raise ForeignError(f"{value!r} is not of this package")
    return f"{module}.{path}"


class ForeignError(Exception):
    """The code of a static argument is not known, so its program is not kept."""
