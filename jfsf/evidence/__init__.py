"""How likely a map is right, from evidence that needs no ground truth.

Read in this order:

- `_bending`: how well shapes bent onto each other coincide, and at what cost
- `_landmarks`: whether it agrees with landmarks, and features without those it misses
- `_confidence`: the probability that a map is right
- `_mirror`: how likely its mirror image is right
- `_rivals`: how a map stands among others that fit nearly as well
- `_regions`: the probability that the region of two parts is right
- `_vertices`: the probability that a vertex is mapped right
- `_certificate`: all the evidence that `match` returns
"""

from jfsf.evidence._bending import Bending, bending
from jfsf.evidence._certificate import certify, spectrum_gap
from jfsf.evidence._confidence import (
    COMPARED,
    FACTORS,
    LEAST,
    RANK_FACTORS,
    UNLIKE,
    column,
    confidence,
    log_odds,
    of_certificate,
    rank,
)
from jfsf.evidence._landmarks import (
    MISSED,
    Landmarks,
    kept_landmarks,
    landmark_distances,
)
from jfsf.evidence._mirror import MIRRORED, mirror_columns, mirror_probability
from jfsf.evidence._regions import REGION_FACTORS, region_confidence
from jfsf.evidence._rivals import (
    Standing,
    map_distances,
    ranks,
    rivals_among,
    share_among,
)
from jfsf.evidence._vertices import (
    SURE,
    VERTEX_EVIDENCE,
    WITHIN,
    vertex_confidence,
    vertex_evidence,
    with_likely,
)

__all__ = [
    "COMPARED",
    "FACTORS",
    "LEAST",
    "MIRRORED",
    "MISSED",
    "RANK_FACTORS",
    "REGION_FACTORS",
    "SURE",
    "UNLIKE",
    "VERTEX_EVIDENCE",
    "WITHIN",
    "Bending",
    "Landmarks",
    "Standing",
    "bending",
    "certify",
    "column",
    "confidence",
    "kept_landmarks",
    "landmark_distances",
    "log_odds",
    "map_distances",
    "mirror_columns",
    "mirror_probability",
    "of_certificate",
    "rank",
    "ranks",
    "region_confidence",
    "rivals_among",
    "share_among",
    "spectrum_gap",
    "vertex_confidence",
    "vertex_evidence",
    "with_likely",
]
