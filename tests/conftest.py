"""Strict jax for every test: x64, no silent rank or dtype promotion."""

import os
from pathlib import Path

import jax
import pytest
from hypothesis import settings

jax.config.update("jax_enable_x64", True)
# Most of the suite's time is compilation, of programs that run once.
jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

settings.register_profile("jfsf", derandomize=True, deadline=None, max_examples=20)
settings.load_profile("jfsf")

os.environ.setdefault("MPLBACKEND", "Agg")


@pytest.fixture(autouse=True, scope="module")
def free_programs():
    """Drop compiled programs before a process has more memory maps than Linux allows.

    Every program adds some, the limit is 65 530 by default, and beyond it XLA aborts.
    """
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > 25_000:
        jax.clear_caches()
