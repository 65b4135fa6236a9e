"""Least squares against scipy, and where rounding hides the descent."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from precisions import FLOATS

from jfsf.solvers import least_squares

SIZE = 20


def problem(seed, dtype):
    rng = np.random.default_rng(seed)
    return tuple(
        jnp.asarray(array, dtype)
        for array in (rng.normal(size=(60, SIZE)), rng.normal(size=60))
    )


def residuals(y, args):
    matrix, right = args
    gap = matrix @ y - right
    return gap / jnp.sqrt(1 + gap**2)


@pytest.mark.parametrize("seed", range(5))
def test_scipy_finds_the_same_minimum(seed):
    args = problem(seed, jnp.float64)
    plain = lambda y: np.asarray(residuals(jnp.asarray(y), args))
    exact = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-15)
    known = scipy.optimize.least_squares(plain, np.zeros(SIZE), **exact)
    start = jnp.asarray(known.x + 0.01)
    found = least_squares(residuals, start, args, tol=1e-10)
    np.testing.assert_allclose(found.value, known.x, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("dtype", FLOATS)
def test_steps_end_where_noise_hides_the_descent(seed, dtype):
    args = problem(seed, dtype)

    def noisy(y, args):
        noise = jax.lax.stop_gradient(jnp.sin(1e6 * args[0] @ y))
        return args[0] @ y - args[1] + 1e-3 * noise

    found = least_squares(noisy, jnp.zeros(SIZE, dtype), args, tol=1e-3)
    assert found.num_steps <= 15  # optimistix by itself: up to 43
    best = np.linalg.lstsq(*map(np.asarray, args), rcond=None)[0]
    np.testing.assert_allclose(found.value, best, atol=2e-3)
