"""Converters: aligned embeddings -> point-to-point maps both ways.

Read in this order:

- `_converter`: what a converter is
- `_kernel`: the sparse kernel (eq. 12), its length, and the plan
- `_nearest`: nearest neighbour (eqs. 5 and 6)
- `_updates`: Sinkhorn updates on the kernel
- `_tolerance`: updates until the marginals are met, with implicit gradients
- `_scaling`: updates of either kind, and the maps of the plan
- `_sinkhorn`: the Fast Sinkhorn Filter (algorithm 2), balanced or with a `reach`
- `_precise`: to points on triangles, in place of vertices
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.convert._converter import Converter, HasMaps, maps_of
from jfsf.convert._nearest import nearest
from jfsf.convert._precise import (
    functional_map_precise,
    precise,
    pull_back_precise,
    to_vertex,
)
from jfsf.convert._scaling import plan, pull_back
from jfsf.convert._sinkhorn import authors_sinkhorn, sinkhorn

__all__ = [
    "Converter",
    "HasMaps",
    "authors_sinkhorn",
    "functional_map_precise",
    "maps_of",
    "nearest",
    "plan",
    "precise",
    "pull_back",
    "pull_back_precise",
    "sinkhorn",
    "to_vertex",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)
