"""How likely a map is right, from evidence that needs no ground truth."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Factors(NamedTuple):
    """Of a logistic regression; that of the residual multiplies its logarithm."""

    constant: float
    orientation: float
    energy: float
    unevenness: float
    residual: float


# Logistic regression of "the mean geodesic error is below 0.1 of sqrt(area)" on maps of
# FAUST, TOSCA, MakeHuman, its creatures and SHREC'07: experiments/calibration.py.
BENT = Factors(-18.22, 1.32, 3.69, -10.54, -3.86)
NOT_BENT = Factors(8.2, 6.1, -2.9, -16.7, 0.0)
# What a map without an orientation, of a point cloud, counts as having.
UNKNOWN_ORIENTATION = 0.9
# Added to a residual, in sqrt(area): smaller ones say nothing.
LEAST_RESIDUAL = 1e-3


def confidence(
    orientation: Float[Array, "..."] | float,
    energy: Float[Array, "..."] | float,
    unevenness: Float[Array, "..."] | float,
    residual: Float[Array, "..."] | float = jnp.nan,
) -> Float[Array, "..."]:
    """Probability that the mean geodesic error is below 0.1 of sqrt(area).

    Args:
        orientation: the score, times the sign that was asked for; nan if there is none.
        energy, unevenness: of the final map, see `jfsf.types.Certificate`.
        residual: likewise; nan for shapes that were not bent.

    Returns:
        In [0, 1]; nan where energy or unevenness is nan.
    """
    known = jnp.where(jnp.isnan(orientation), UNKNOWN_ORIENTATION, orientation)

    def logit(factors: Factors, residual):
        return (
            factors.constant
            + factors.orientation * known
            + factors.energy * energy
            + factors.unevenness * unevenness
            + factors.residual * jnp.log(residual + LEAST_RESIDUAL)
        )

    bent = ~jnp.isnan(residual)
    seen = logit(BENT, jnp.where(bent, residual, 1.0))
    return jax.nn.sigmoid(jnp.where(bent, seen, logit(NOT_BENT, 1.0)))
