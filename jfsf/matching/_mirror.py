"""How likely the mirror image of a map is the right one.

A regression of "one of the shapes is mirrored", over pairs where the map and its mirror
image were compared. With s the share of the mirror image in the odds of both
(`share_among`), and E and E' the energies (`Certificate.energy`) of map and mirror
image, on coarse copies:

    p = 1 / (1 + exp(-(b_constant + b_margin log(s / (1 - s)) + b_energy log(E / E'))))

The factors stand in mirror.json beside this file, written by experiments/fit_mirror.py.
Shapes that are symmetric, such as bodies, fit as well either way: p is near 0.
"""

import json
from importlib.resources import files

import numpy as np
from jaxtyping import Float
from scipy.special import expit, logit

from jfsf.matching._confidence import MOST_SHARE
from jfsf.types import ArrayLike

# Of the mirror image: above, it is more likely right than the map.
MIRRORED = 0.5
MIRROR_FACTORS: dict[str, float] = json.loads(
    (files("jfsf.matching") / "mirror.json").read_text(encoding="utf-8")
)["factors"]


def mirror_columns(
    share: ArrayLike, energy_ratio: ArrayLike
) -> Float[np.ndarray, "... 2"]:
    """log(s / (1 - s)) and log(E / E'), as the regression reads them.

    s counts as 0.999 at most, and as 0.001 at least.
    """
    share = np.clip(share, 1 - MOST_SHARE, MOST_SHARE)
    return np.stack([logit(share), np.log(energy_ratio)], -1)


def mirror_probability(share: float, energy_ratio: float) -> float:
    """p, in [0, 1].

    Args:
        share: s, in [0, 1].
        energy_ratio: E / E', positive.
    """
    b = MIRROR_FACTORS
    margin, energy = mirror_columns(share, energy_ratio)
    return float(expit(b["constant"] + b["margin"] * margin + b["energy"] * energy))
