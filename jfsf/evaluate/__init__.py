"""How good a map is: against ground truth, by its own properties, or by its evidence.

Read in this order:

- `_geodesics`: distances on a mesh, by the heat method or exact
- `_map_metrics`: error, bijectivity, coverage and smoothness of a map; error curves
- `_functional_metrics`: orthogonality, commutativity and energy of a functional map
- `_bending`: how well shapes bent onto each other coincide
- `_landmarks`: whether it agrees with landmarks
- `_confidence`: the probability that a map is right
- `_certificate`: the evidence that `match` returns, without ground truth
- `_evaluate`: all figures of one map in one call
"""

from jfsf.evaluate._bending import bending_residual
from jfsf.evaluate._certificate import certify
from jfsf.evaluate._confidence import LEAST_RESIDUAL, confidence
from jfsf.evaluate._evaluate import MEASURED, Figures, evaluate
from jfsf.evaluate._functional_metrics import (
    laplacian_commutativity,
    orthogonality,
    spectral_chamfer,
    zoomout_energy,
)
from jfsf.evaluate._geodesics import (
    Progress,
    geodesics,
    pair_distances,
    vertex_indices,
)
from jfsf.evaluate._landmarks import MISSED, landmark_distances
from jfsf.evaluate._map_metrics import (
    auc,
    bijectivity,
    coverage,
    error_curve,
    geodesic_error,
    smoothness,
)

__all__ = [
    "LEAST_RESIDUAL",
    "MEASURED",
    "MISSED",
    "Figures",
    "Progress",
    "auc",
    "bending_residual",
    "bijectivity",
    "certify",
    "confidence",
    "coverage",
    "error_curve",
    "evaluate",
    "geodesic_error",
    "geodesics",
    "landmark_distances",
    "laplacian_commutativity",
    "orthogonality",
    "pair_distances",
    "smoothness",
    "spectral_chamfer",
    "vertex_indices",
    "zoomout_energy",
]
