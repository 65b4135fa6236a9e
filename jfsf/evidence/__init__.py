"""How likely a map is right, from evidence that needs no ground truth.

Read in this order:

- `_bending`: how well shapes bent onto each other coincide
- `_landmarks`: whether it agrees with landmarks, and features without those it misses
- `_confidence`: the probability that a map is right
- `_vertices`: the probability that a vertex is mapped right
- `_certificate`: all the evidence that `match` returns
"""

from jfsf.evidence._bending import bending_residual
from jfsf.evidence._certificate import certify
from jfsf.evidence._confidence import LEAST_RESIDUAL, confidence
from jfsf.evidence._landmarks import (
    MISSED,
    Landmarks,
    kept_landmarks,
    landmark_distances,
)
from jfsf.evidence._vertices import (
    SURE,
    VERTEX_EVIDENCE,
    WITHIN,
    vertex_confidence,
    vertex_evidence,
)

__all__ = [
    "LEAST_RESIDUAL",
    "MISSED",
    "SURE",
    "VERTEX_EVIDENCE",
    "WITHIN",
    "Landmarks",
    "bending_residual",
    "certify",
    "confidence",
    "kept_landmarks",
    "landmark_distances",
    "vertex_confidence",
    "vertex_evidence",
]
