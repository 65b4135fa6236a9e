"""Array operations that jax does not have, or has in a slower or less exact form.

Read in this order:

- `_loops`: both shapes in one loop, vmap as a loop, loops inside `jax.shard_map`
- `_jit`: functions that are compiled, with their types, and static arguments by content
- `_precision`: products in full float32 precision, largest entries by maxima
"""

from jfsf.array._jit import jit
from jfsf.array._precision import argmax, einsum, matmul

__all__ = ["argmax", "einsum", "jit", "matmul"]
