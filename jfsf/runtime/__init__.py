"""Few padded sizes, compiled programs, and how they are run.

Read in this order:

- `_sizes`: the common sizes to which the shapes of a pair are padded
- `_shared`: settings of the whole process, changed by threads that overlap
- `_compiler`: compile large programs in less time
- `_program_files`: compiled programs on disk
- `_programs`: compile programs early, and keep them on disk
- `_map_pairs`: one function over many inputs, vmapped and sharded over the devices
- `_runners`: how the stages of a match are run: pair by pair, vmapped, only compiled
"""

from jfsf.runtime._compiler import large_jit
from jfsf.runtime._map_pairs import PAIRS, check_batch, map_pairs
from jfsf.runtime._programs import Program, compile_ahead
from jfsf.runtime._runners import CompileOnly, OneByOne, Runner, Vmapped
from jfsf.runtime._shared import one_blas_thread, shared_context
from jfsf.runtime._sizes import (
    PaddedShape,
    common_size,
    pad,
    padded,
    padded_pair,
    padded_shapes,
    spectrum_like,
    with_rows,
)

__all__ = [
    "PAIRS",
    "CompileOnly",
    "OneByOne",
    "PaddedShape",
    "Program",
    "Runner",
    "Vmapped",
    "check_batch",
    "common_size",
    "compile_ahead",
    "large_jit",
    "map_pairs",
    "one_blas_thread",
    "pad",
    "padded",
    "padded_pair",
    "padded_shapes",
    "shared_context",
    "spectrum_like",
    "with_rows",
]
