"""Array operations that jax does not have, or has in a slower or less exact form.

Read in this order:

- `_precision`: products in full float32 precision, and division that leaves out 0
- `_top_k`: indices of the largest entries, by vectorised maxima
- `_sides`: one function applied to both shapes, compiled once
- `_sequential_vmap`: functions that vmap runs as a loop
- `_static`: static arguments by their content, as keys and as text
"""

from jfsf.array._precision import HIGHEST, einsum, matmul, safe_divide
from jfsf.array._sequential_vmap import sequential_vmap
from jfsf.array._sides import map_sides
from jfsf.array._static import static_key, static_text
from jfsf.array._top_k import TOP_K_LIMIT, argmax, max_with_index, top_k

__all__ = [
    "HIGHEST",
    "TOP_K_LIMIT",
    "argmax",
    "einsum",
    "map_sides",
    "matmul",
    "max_with_index",
    "safe_divide",
    "sequential_vmap",
    "static_key",
    "static_text",
    "top_k",
]
