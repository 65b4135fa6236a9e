"""How likely a map is right, from evidence that needs no ground truth.

Regressions of "the mean geodesic error is below 0.1 of sqrt(area)". Their factors stand
in confidence.json beside this file, with the data they were fitted to and the scores on
data that they were not (experiments/fit/calibration.py).

Of a map alone, with the evidence e_f of `Certificate`, as `regressor` reads it:

    p = 1 / (1 + exp(-z)),  z = b_constant + sum_f b_f e_f

Among several maps of one pair, whatever makes its shapes hard to match is the same for
all, so other evidence tells most. Their odds are as exp(r),

    r = sum_f a_f e_f.

Of a map that was compared so, with s its share of these odds (`share_among`):

    p = min(min(s / l, 1) / (1 + exp(-z')), (1 + s) / 2),
    z' = c_constant + c_log_odds z + c_margin min(log(s / (1 - s)), m),

l being the least share of a right map in the data. Half of what the other maps have is
doubt, however good the map looks alone: they may be as right as it, or right instead.

Evidence cannot tell a map from its rivals, and n of these leave it 1 / (1 + n) at most.
A map of the orientation that was asked for is likely wrong where its mirror image fits
far better: with t the probability of this one (`mirror_probability`), it has 1 - t at
most. And nothing is known of shapes that differ more than those which the constants
were fitted to: with g the `spectrum_gap`, it has 1/2 + 1/2 / (1 + exp(a (g - u))) at
most.

The mirror image of a map is right with the probability

    t = 1 / (1 + exp(-(m_constant + m_energy (E - E')))),

E and E' being the energies (`Certificate.energy`) of map and mirror image, on coarse
copies: a regression of "one of the shapes is mirrored" (mirror.json, by
experiments/fit/fit_mirror.py). Shapes that are symmetric, such as bodies, fit as well
either way: t is near 0. The difference tells more than the ratio: bodies in one pose
have little energy, so a mirrored pose changes its ratio much and its difference little.

The region that two parts share, and the map in it, are right with the probability

    p = 1 / (1 + exp(-(r_constant + r_log_odds z + r_region_cost c))),

z being the log odds of the map between the regions and c its `region_cost`; of people
r_of_people + r_person_agreement a is added, a being its `person_agreement`
(regions.json, by experiments/fit/fit_parts.py).
"""

import json
from importlib.resources import files
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from scipy.special import expit

from jfsf.matching._kept_landmarks import MISSED
from jfsf.types import Certificate

# Added before a logarithm is taken: smaller numbers say nothing.
LEAST = 1e-3
# Figures of the certificate that are read without a logarithm.
_AS_IT_IS = ("orientation", "nn_agreement", "person_agreement")
# Those that are nan of all maps of a pair: without a plan, or of what is no person.
_MAY_LACK = ("nn_agreement", "person_agreement")
# a and u above. Of 228 pairs with a right map, of which 31 are creatures with other
# limbs, the largest gaps are 1.09, 1.07, 0.99; a torus, a rod, an ellipsoid or a bent
# one differ from bodies by 1.6 or more, and a rod from a torus or a box by 1.14.
STEEP, UNLIKE = 30.0, 1.12
# Shares beyond this, and below 1 minus this, count as this.
MOST_SHARE = 0.999


# A map that misses all landmarks counts as so many doubtful ones more: little against a
# map that is nearly certain, since a landmark may be wrong too.
MISSED_WEIGHT = 3.0
# Of the mirror image: above, it is more likely right than the map.
MIRRORED = 0.5


def read_constants(name: str) -> dict[str, Any]:
    """What a script has fitted and written to the file NAME.json beside this one."""
    file = files("jfsf.matching") / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8"))


_CONSTANTS = read_constants("confidence")
FACTORS: dict[str, float] = _CONSTANTS["alone"]
RANK_FACTORS: dict[str, float] = _CONSTANTS["rank"]
COMPARED: dict[str, float] = _CONSTANTS["compared"]
MIRROR_FACTORS: dict[str, float] = read_constants("mirror")["factors"]
REGION_FACTORS: dict[str, float] = read_constants("regions")["factors"]


def regressor(name: str, value: Any, xp: Any = jnp) -> Any:
    """A figure of the certificate as the regressions read it.

    Orientation, `nn_agreement` and `person_agreement` are read as they are, others as
    log(value + `LEAST`); of the last two nan counts as 0.

    Args:
        name, value: of the figure.
        xp: numpy on the host, to compute in float64.
    """
    value = xp.asarray(value)
    if name in _MAY_LACK:  # of all maps of a pair
        value = xp.nan_to_num(value)
    return value if name in _AS_IT_IS else xp.log(xp.maximum(value, 0) + LEAST)


def log_odds(**figures: Float[Array, "..."] | float) -> Float[Array, "..."]:
    """z of a map alone, log(p / (1 - p)).

    Args:
        figures: of the certificate, by name, more than are needed; the orientation
            times the sign that was asked for.

    Returns:
        nan where a figure that is needed is nan: without a surface there is none.
    """
    factors = dict(FACTORS)
    z = factors.pop("constant")
    return jnp.asarray(z + _weighed(factors, figures))


def rank(xp: Any = jnp, **figures: Float[Array, "..."] | float) -> Any:
    """r of a map among others of the same pair; more is better.

    Args:
        xp: numpy on the host, to compute in float64.
        figures: of the certificate, by name, more than are needed.
    """
    return xp.asarray(_weighed(RANK_FACTORS, figures, xp))


def _weighed(factors: dict[str, float], figures: dict[str, Any], xp: Any = jnp):
    return sum(b * regressor(name, figures[name], xp) for name, b in factors.items())


def confidence(
    log_odds: Float[Array, "..."],
    share: Float[Array, "..."] | float = jnp.nan,
    missed: Float[Array, "..."] | float = 0.0,
    left_and_right: Bool[Array, "..."] | bool = True,
    rivals: Float[Array, "..."] | float = jnp.nan,
    mirrored: Float[Array, "..."] | float = jnp.nan,
    spectrum_gap: Float[Array, "..."] | float = jnp.nan,
    *,
    missed_weight: float = 3.0,
    limited: bool = True,
) -> Float[Array, "..."]:
    """Probability that the mean geodesic error is below 0.1 of sqrt(area).

    Args:
        log_odds: of the map alone, by its own evidence.
        share: of the odds of all distinct maps that were compared, see
            `share_among`; nan if none were.
        missed: share of the landmarks that the map misses.
        left_and_right: whether these can be told. If not, a map and its mirror image
            are equally likely, and the probability is half of it.
        rivals: how many other maps are as likely, see `rivals_among`.
        mirrored: probability that the mirror image is the right map, see
            `mirror_probability`; nan if it was not tried.
        spectrum_gap: how unlike the shapes are, see `Certificate`.
        missed_weight: a map that misses all landmarks counts as so many doubtful ones
            more.
        limited: whether it is at most (1 + share) / 2. Which of the maps of a pair is
            the most likely is decided without.

    Returns:
        In [0, 1]; nan where `log_odds` is nan.
    """
    known = jnp.clip(jnp.nan_to_num(share, nan=0.5), 1 - MOST_SHARE, MOST_SHARE)
    margin = jnp.minimum(jnp.log(known / (1 - known)), COMPARED["most_margin"])
    compared = COMPARED["constant"] + COMPARED["log_odds"] * log_odds
    compared += COMPARED["margin"] * margin
    likely = jax.nn.sigmoid(jnp.where(jnp.isnan(share), log_odds, compared))
    # `known` is one half where the share is not: that takes nothing away.
    likely *= jnp.minimum(known / COMPARED["least_share"], 1)
    if limited:
        likely = jnp.minimum(likely, (1 + jnp.nan_to_num(share, nan=1.0)) / 2)
    number, other, gap = (
        jnp.nan_to_num(jnp.asarray(known, likely.dtype))
        for known in (rivals, mirrored, spectrum_gap)
    )
    likely = jnp.minimum(likely, jnp.minimum(1 / (1 + number), 1 - other))
    likely = jnp.minimum(likely, (1 + jax.nn.sigmoid(STEEP * (UNLIKE - gap))) / 2)
    likely **= 1 + missed_weight * missed
    return jnp.where(left_and_right, likely, likely / 2)


def missed_share(evidence: Certificate) -> Float[Array, ""]:
    """Share of the landmarks that a map misses; 0 without any.

    Args:
        evidence: `landmarks` are read.
    """
    missed = jnp.mean((evidence.landmarks > MISSED).astype(float))
    return jnp.nan_to_num(missed).astype(evidence.log_odds.dtype)


def confidence_of(
    evidence: Certificate,
    left_and_right: Any,
    *,
    missed_weight: float = MISSED_WEIGHT,
    limited: bool = True,
) -> Float[Array, ""]:
    """The confidence of a map with this evidence.

    Args:
        evidence: `log_odds`, `share`, `rivals`, `mirrored`, `spectrum_gap` and
            `landmarks` are read.
        left_and_right: as `confidence`. Landmarks that the map meets tell them, too.
        missed_weight, limited: as `confidence`.
    """
    missed = missed_share(evidence)
    told = left_and_right | (evidence.landmarks.size > 0)
    return confidence(
        evidence.log_odds,
        evidence.share,
        missed,
        told,
        evidence.rivals,
        evidence.mirrored,
        evidence.spectrum_gap,
        missed_weight=missed_weight,
        limited=limited,
    )


def region_confidence(
    evidence: Certificate, *, missed_weight: float = MISSED_WEIGHT
) -> Float[Array, ""]:
    """Probability that the region of two parts is right, to the power of 1 + w m.

    m is the share of the landmarks that are missed, and w is `missed_weight`.

    Args:
        evidence: `log_odds`, `region_cost`, `person_agreement` and `landmarks` are
            read.
        missed_weight: as `confidence`.

    Returns:
        In [0, 1]; nan of shapes that were matched as wholes.
    """
    b = REGION_FACTORS
    z = b["constant"] + b["log_odds"] * evidence.log_odds
    z += b["region_cost"] * evidence.region_cost
    agreed = evidence.person_agreement
    of_people = b["of_people"] + b["person_agreement"] * agreed
    z += jnp.where(jnp.isnan(agreed), 0, of_people)
    missed = missed_share(evidence)
    return jax.nn.sigmoid(z) ** (1 + missed_weight * missed)


def mirror_probability(energy_gap: float) -> float:
    """Probability that the mirror image of a map is the right one.

    Args:
        energy_gap: E - E', of the map beyond its mirror image.
    """
    b = MIRROR_FACTORS
    return float(expit(b["constant"] + b["energy"] * energy_gap))
