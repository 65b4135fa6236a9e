"""Compile large programs in less time."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import jax

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
