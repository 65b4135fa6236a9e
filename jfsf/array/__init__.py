"""Array operations that jax does not have, or has in a slower or less exact form.

Read in this order:

- `_jit`: functions that are compiled, with their types, and static arguments by content
- `_precision`: products in full float32 precision, and division that leaves out 0
- `_top_k`: indices of the largest entries, by vectorised maxima
- `_loops`: both shapes in one loop, vmap as a loop, loops inside `jax.shard_map`
"""

from jfsf.array._jit import jit
from jfsf.array._precision import einsum, matmul
from jfsf.array._top_k import argmax

__all__ = ["argmax", "einsum", "jit", "matmul"]
