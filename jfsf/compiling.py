"""jit for programs so large that compiling them takes longer than running them."""

from collections.abc import Callable
from functools import cache
from typing import Any

import jax

# Measured on `match`: half of XLA's time to compile for a CPU, and no more to run.
CPU_OPTIONS = {
    "xla_backend_optimization_level": 1,
    "xla_cpu_use_fusion_emitters": False,
    "xla_disable_hlo_passes": "tree_reduction_rewriter",
}


@cache
def large_jit(function: Callable, platform: str, **static: Any) -> Callable:
    """`jax.jit(function, **static)` that compiles faster; not for use inside a jit.

    Args:
        function: the same object in each call, or it compiles anew.
        platform: that it will run on; "cpu" is what there are options for.
        static: `static_argnames` and `static_argnums`.
    """
    options = _known() if platform == "cpu" else {}
    return jax.jit(function, compiler_options=options, **static)


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
