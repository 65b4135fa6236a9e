"""Converters: aligned embeddings -> point-to-point maps both ways.

Read in this order:

- `_kernel`: the sparse kernel (eq. 12), its length, and the plan
- `_checks`: what the filter and its steps refuse
- `_converter`: what a converter is, and the nearest neighbour (eqs. 5 and 6)
- `_updates`: Sinkhorn updates on the kernel
- `_tolerance`: updates until the marginals are met, with implicit gradients
- `_scaling`: updates of either kind, and the maps of the plan
- `_sinkhorn`: the kernel between two embeddings, and the Fast Sinkhorn Filter on it,
  balanced or with a `reach`
- `_variants`: algorithm 2 to the letter, the authors' settings, kernels of one's own
- `_precise`: to points on triangles, in place of vertices
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.convert._converter import Converter, HasMaps, maps_of, nearest
from jfsf.convert._precise import (
    functional_map_precise,
    precise,
    pull_back_precise,
    to_vertex,
)
from jfsf.convert._scaling import plan, pull_back, scale_kernel
from jfsf.convert._sinkhorn import sinkhorn
from jfsf.convert._variants import algorithm_2, authors_sinkhorn, build_kernel

__all__ = [
    "Converter",
    "HasMaps",
    "algorithm_2",
    "authors_sinkhorn",
    "build_kernel",
    "functional_map_precise",
    "maps_of",
    "nearest",
    "plan",
    "precise",
    "pull_back",
    "pull_back_precise",
    "scale_kernel",
    "sinkhorn",
    "to_vertex",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)
