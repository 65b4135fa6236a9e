"""How good a map is: against ground truth, or by its own properties.

Read in this order:

- `_map_metrics`: error, bijectivity, coverage and smoothness of a map; error curves
- `_functional_metrics`: orthogonality, commutativity and energy of a functional map
- `_evaluate`: all figures of one map in one call
"""

from jfsf.evaluate._evaluate import Figures, evaluate
from jfsf.evaluate._functional_metrics import (
    laplacian_commutativity,
    orthogonality,
    spectral_chamfer,
    zoomout_energy,
)
from jfsf.evaluate._map_metrics import (
    auc,
    bijectivity,
    coverage,
    error_curve,
    geodesic_error,
    smoothness,
)

__all__ = [
    "Figures",
    "auc",
    "bijectivity",
    "coverage",
    "error_curve",
    "evaluate",
    "geodesic_error",
    "laplacian_commutativity",
    "orthogonality",
    "smoothness",
    "spectral_chamfer",
    "zoomout_energy",
]
