"""The methods that the paper compares with, re-implemented from their publications.

`auction` and `cpd` are converters: they work inside `icp`, `zoomout` and `match`. The
others refine maps, on the host, and are not jitted as a whole.

Read in this order:

- `_auction`: one-to-one maps of least total distance, by the auction algorithm
- `_cpd`: maps by coherent point drift
- `_deblur`: maps to points on triangles, denoised by functional maps
- `_pmf`: one-to-one maps of largest density, by the product manifold filter
- `_rhm`: reversible harmonic maps
- `_bcicp`: bijective and continuous ICP
"""

from experiments.paper.baselines._auction import auction
from experiments.paper.baselines._bcicp import bcicp
from experiments.paper.baselines._cpd import cpd
from experiments.paper.baselines._deblur import deblur
from experiments.paper.baselines._pmf import pmf
from experiments.paper.baselines._rhm import rhm

__all__ = ["auction", "bcicp", "cpd", "deblur", "pmf", "rhm"]
