"""Array operations that jax does not have, or has in a slower or less exact form.

Read in this order:

- `_varying`: what begins a loop inside `jax.shard_map`
- `_jit`: functions that are compiled, with their types, and static arguments by content
- `_precision`: products in full float32 precision, and division that leaves out 0
- `_top_k`: indices of the largest entries, by vectorised maxima
- `_sides`: one function applied to both shapes, compiled once
- `_sequential_vmap`: functions that vmap runs as a loop
"""

from jfsf.array._jit import jit
from jfsf.array._precision import einsum, matmul
from jfsf.array._top_k import argmax

__all__ = ["argmax", "einsum", "jit", "matmul"]
