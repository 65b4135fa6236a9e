"""How likely the region that two shapes share, and the map in it, are right.

A regression of "the mean geodesic error is below 0.1 of sqrt(area)" over maps of parts,
right and wrong: with z the `log_odds` of the map between the regions, and c its
`region_cost`,

    p = 1 / (1 + exp(-(b_constant + b_log_odds z + b_region_cost c))).

The factors stand in regions.json beside this file, written by experiments/fit_parts.py.
"""

import json
from importlib.resources import files
from typing import Any

import jax
from jaxtyping import Array, Float

from jfsf.matching._confidence import missed_share
from jfsf.types import Certificate

REGION_FACTORS: dict[str, float] = json.loads(
    (files("jfsf.matching") / "regions.json").read_text(encoding="utf-8")
)["factors"]


def region_confidence(evidence: Certificate, *, settings: Any) -> Float[Array, ""]:
    """p, to the power of 1 + `missed_weight` times the share of landmarks missed.

    Args:
        evidence: `log_odds`, `region_cost` and `landmarks` are read.
        settings: `jfsf.matching.EvidenceSettings`.

    Returns:
        In [0, 1]; nan of shapes that were matched as wholes.
    """
    b = REGION_FACTORS
    z = b["constant"] + b["log_odds"] * evidence.log_odds
    z += b["region_cost"] * evidence.region_cost
    missed = missed_share(evidence, settings=settings)
    return jax.nn.sigmoid(z) ** (1 + settings.missed_weight * missed)
