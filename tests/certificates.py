"""Certificates for tests, of the figures that a test is about."""

import jax.numpy as jnp
import numpy as np

from jfsf.types import Certificate


def certificate(**figures):
    """A certificate that knows these figures, and no others."""
    arrays = {name: np.asarray(value) for name, value in figures.items()}
    return Certificate.unknown()._replace(**arrays)


# Of a map without doubt.
GOOD = certificate(
    coverage_xy=0.93,
    coverage_yx=0.93,
    bijectivity_x=0.01,
    bijectivity_y=0.01,
    orientation=0.97,
    gap=0.93,
    recall=0.93,
    residual=0.01,
    shear=0.1,
    normal_gap=0.02,
    spectrum_gap=0.1,
    log_odds=0.93,
    share=0.93,
    rivals=0,
    mirrored=0.0,
    confidence=0.93,
)


def with_figures(known, **figures):
    """The certificate with other figures."""
    arrays = {name: jnp.asarray(value) for name, value in figures.items()}
    return known._replace(**arrays)
