"""Refinement with any converter: of functional maps, and of point maps by deformation.

Read in this order:

- `_zoomout`: the basis grows (the method of `match`)
- `_icp`: the functional map is made orthonormal each time
- `_soft`: differentiable steps of both, for losses on pairs
- `_arap`: both shapes are deformed onto each other, as rigid as possible
- `_rest`: a mesh at rest, its rotations, and points that follow it, on the host
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.refine._arap import ArapSettings, arap, deform
from jfsf.refine._icp import icp
from jfsf.refine._soft import (
    soft_functional_map,
    soft_icp_step,
    soft_map,
    soft_sinkhorn,
    soft_zoomout_step,
)
from jfsf.refine._zoomout import zoomout

__all__ = [
    "ArapSettings",
    "arap",
    "deform",
    "icp",
    "soft_functional_map",
    "soft_icp_step",
    "soft_map",
    "soft_sinkhorn",
    "soft_zoomout_step",
    "zoomout",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)
