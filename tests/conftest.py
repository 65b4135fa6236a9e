"""Strict jax for every test: x64, no silent rank or dtype promotion."""

import os

import jax
from hypothesis import settings

jax.config.update("jax_enable_x64", True)
# Most of the suite's time is compilation, of programs that run once.
jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

settings.register_profile("jfsf", derandomize=True, deadline=None, max_examples=20)
settings.load_profile("jfsf")

os.environ.setdefault("MPLBACKEND", "Agg")
