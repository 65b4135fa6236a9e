"""Both precisions, for parametrised tests."""

import jax.numpy as jnp
import pytest

# Nearly all other tests run in float64, so what is left for the slow ones is the same.
FLOATS = [jnp.float32, pytest.param(jnp.float64, marks=pytest.mark.slow)]
