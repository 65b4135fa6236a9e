"""How likely a map is right, from evidence that needs no ground truth."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Logistic regression of "the mean geodesic error is below 0.1 of sqrt(area)" on maps of
# FAUST, TOSCA, MakeHuman, its creatures and SHREC'07: experiments/calibration.py.
CONSTANT = 8.2
ORIENTATION = 6.1
ENERGY = -2.9
UNEVENNESS = -16.7
# What a map without an orientation, of a point cloud, counts as having.
UNKNOWN_ORIENTATION = 0.9


def confidence(
    orientation: Float[Array, "..."] | float,
    energy: Float[Array, "..."] | float,
    unevenness: Float[Array, "..."] | float,
) -> Float[Array, "..."]:
    """Probability that the mean geodesic error is below 0.1 of sqrt(area).

    Args:
        orientation: the score, times the sign that was asked for; nan if there is none.
        energy, unevenness: of the final map, see `jfsf.types.Certificate`.

    Returns:
        In [0, 1]; nan where energy or unevenness is nan.
    """
    known = jnp.where(jnp.isnan(orientation), UNKNOWN_ORIENTATION, orientation)
    logit = CONSTANT + ORIENTATION * known + ENERGY * energy + UNEVENNESS * unevenness
    return jax.nn.sigmoid(logit)
