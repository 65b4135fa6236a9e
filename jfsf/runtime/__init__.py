"""Few padded sizes, compiled programs, and how they are run.

Read in this order:

- `_sizes`: the common sizes to which the shapes of a pair are padded
- `_shared`: settings of the whole process, changed by threads that overlap
- `_program_files`: compiled programs on disk
- `_programs`: compile programs early and in less time, and keep them on disk
- `_map_pairs`: one function over many inputs, vmapped and sharded over the devices
- `_runners`: how the stages of a match are run: pair by pair, vmapped, only compiled
"""

from jfsf.runtime._map_pairs import map_pairs

__all__ = ["map_pairs"]
