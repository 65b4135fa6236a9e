"""How likely a map is right, from evidence that needs no ground truth."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Logistic regressions of "the mean geodesic error is below 0.1 of sqrt(area)" on first
# maps of FAUST, TOSCA, MakeHuman, its creatures and SHREC'07
# (experiments/calibration.py). The orientation counts less than in such a fit: wrong
# maps often mirror if they are first maps, seldom if they come from further starts.
BENT = {
    "constant": -18.0,
    "orientation": 3.0,
    "log_stretch_std": -4.0,
    "residual": -3.5,
}
NOT_BENT = {
    "constant": 8.2,
    "orientation": 6.1,
    "energy": -2.9,
    "log_stretch_std": -16.7,
}
# What a map without an orientation, of a cloud without a surface, counts as having.
UNKNOWN_ORIENTATION = 0.9
# Added to a residual, in sqrt(area): smaller ones say nothing.
LEAST_RESIDUAL = 1e-3


def confidence(
    orientation: Float[Array, "..."] | float,
    energy: Float[Array, "..."] | float,
    log_stretch_std: Float[Array, "..."] | float,
    residual: Float[Array, "..."] | float = jnp.nan,
) -> Float[Array, "..."]:
    """Probability that the mean geodesic error is below 0.1 of sqrt(area).

    p = 1 / (1 + exp(-z)), a logistic regression with the factors b of `BENT` for shapes
    that were bent onto each other, and of `NOT_BENT` for others:

        z = b_constant + b_orientation s + b_log_stretch_std u + b_residual log(r + e)
        z = b_constant + b_orientation s + b_energy E + b_log_stretch_std u

    s is the orientation (`UNKNOWN_ORIENTATION` if nan), u log_stretch_std, r the
    residual, e `LEAST_RESIDUAL` and E the energy.

    Args:
        orientation: the score, times the sign that was asked for; nan if there is none.
        energy, log_stretch_std: of the final map, see `jfsf.types.Certificate`; the
            energy is read where shapes were not bent.
        residual: likewise; nan for shapes that were not bent.

    Returns:
        In [0, 1]; nan where energy or log_stretch_std is nan and was read.
    """
    known = jnp.where(jnp.isnan(orientation), UNKNOWN_ORIENTATION, orientation)
    close = jnp.log(jnp.nan_to_num(residual) + LEAST_RESIDUAL)
    bent = _logit(
        BENT, orientation=known, log_stretch_std=log_stretch_std, residual=close
    )
    not_bent = _logit(
        NOT_BENT, orientation=known, energy=energy, log_stretch_std=log_stretch_std
    )
    return jax.nn.sigmoid(jnp.where(jnp.isnan(residual), not_bent, bent))


def _logit(factors: dict[str, float], **evidence):
    products = [factors[name] * value for name, value in evidence.items()]
    return factors["constant"] + sum(products)
