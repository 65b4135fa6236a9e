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
    distortion: float


# Logistic regression of "the mean geodesic error is below 0.1 of sqrt(area)" on maps of
# FAUST, TOSCA, MakeHuman, its creatures and SHREC'07: experiments/calibration.py.
BENT = Factors(-10.05, 1.62, 3.21, -6.89, -3.0, -11.95)
NOT_BENT = Factors(8.2, 6.1, -2.9, -16.7, 0.0, 0.0)
# What a map without an orientation, of a point cloud, counts as having.
UNKNOWN_ORIENTATION = 0.9
# Of shapes that coincide, in sqrt(area): far below any edge.
LEAST_RESIDUAL = 1e-4


def confidence(
    orientation: Float[Array, "..."] | float,
    energy: Float[Array, "..."] | float,
    unevenness: Float[Array, "..."] | float,
    residual: Float[Array, "..."] | float = jnp.nan,
    distortion: Float[Array, "..."] | float = jnp.nan,
) -> Float[Array, "..."]:
    """Probability that the mean geodesic error is below 0.1 of sqrt(area).

    Args:
        orientation: the score, times the sign that was asked for; nan if there is none.
        energy, unevenness: of the final map, see `jfsf.types.Certificate`.
        residual, distortion: likewise; nan for shapes that were not bent.

    Returns:
        In [0, 1]; nan where energy or unevenness is nan.
    """
    known = jnp.where(jnp.isnan(orientation), UNKNOWN_ORIENTATION, orientation)

    def logit(factors: Factors, residual, distortion):
        return (
            factors.constant
            + factors.orientation * known
            + factors.energy * energy
            + factors.unevenness * unevenness
            + factors.residual * jnp.log(jnp.maximum(residual, LEAST_RESIDUAL))
            + factors.distortion * distortion
        )

    bent = ~jnp.isnan(residual)
    seen = jnp.where(bent, residual, 1.0), jnp.where(bent, distortion, 0.0)
    return jax.nn.sigmoid(jnp.where(bent, logit(BENT, *seen), logit(NOT_BENT, *seen)))
