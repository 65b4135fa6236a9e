"""Strict jax for every test: x64, no silent rank or dtype promotion."""

import gc
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import jax
import pytest
from hypothesis import settings

# Most of the suite's time is compilation, of programs that run once. These take a
# third of it, in one thread a worker.
FAST_COMPILE = (
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
)


def set_xla_flags(flags: str) -> None:
    """Of this process and those that it starts, if the installed XLA knows them.

    XLA ends a process that sets an unknown flag, so another process tries them.
    """
    before = os.environ.get("XLA_FLAGS", "")
    if flags in before:  # set by the process that has started this one
        return
    flags = f"{before} {flags}".strip()
    probe = [sys.executable, "-c", "import jax; jax.devices()"]
    tried = subprocess.run(
        probe, env=os.environ | {"XLA_FLAGS": flags}, capture_output=True
    )
    if tried.returncode == 0:
        os.environ["XLA_FLAGS"] = flags


set_xla_flags(FAST_COMPILE)

# Tracing makes many objects and few cycles: to look for them takes 7 % of the time.
gc.set_threshold(50_000, 20, 20)

# Nor does anyone read from which line of Python a program's operations come: to write
# that down takes an eighth of the time, here and in the processes that tests start.
for name in ("traceback_in_locations_limit", "include_full_tracebacks_in_locations"):
    jax.config.update(f"jax_{name}", 0)
    os.environ[f"JAX_{name.upper()}"] = "0"

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

settings.register_profile("jfsf", derandomize=True, deadline=None, max_examples=12)
# Other draws in every run, and more: --hypothesis-profile=anew.
settings.register_profile("anew", deadline=None, max_examples=100, print_blob=True)
settings.load_profile("jfsf")

os.environ.setdefault("MPLBACKEND", "Agg")


# A process takes a whole file (--dist loadfile). The longest go first, in this order:
# one of them begun at the end would keep a single process busy for minutes.
LONGEST = """
match examples cli among_tiles parts sinkhorn unbalanced zoomout attempt mutual
manual extremities tolerance runs nonlinear_fit report fuzz batch arap viz soft
""".split()


def pytest_collection_modifyitems(items):
    """Sort the files, not what is in them."""
    order = {f"test_{name}.py": i for i, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.name, len(order)))


@contextmanager
def quick_compiler():
    """Programs of `match` compile in a fifth of the time, and run three times as long.

    For what compiles many of them and runs each once or twice.
    """
    from jfsf.runtime import _programs

    def forget():
        _programs.compiler_options.cache_clear()
        _programs.large_jit.cache_clear()

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(_programs.CPU_OPTIONS, "xla_backend_optimization_level", 0)
        forget()
        yield
    forget()


@pytest.fixture
def run_once():
    """In one test."""
    with quick_compiler():
        yield


@pytest.fixture(scope="module")
def all_run_once():
    """In all tests of a file."""
    with quick_compiler():
        yield


@pytest.fixture(autouse=True, scope="module")
def free_programs():
    """Drop compiled programs before a process has more memory maps than Linux allows.

    Every program adds some, the limit is 65 530 by default, and beyond it XLA aborts.
    """
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > 25_000:
        from jfsf.runtime import _programs

        _programs.known.clear()
        jax.clear_caches()
