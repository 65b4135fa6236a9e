"""What we count on in jax, and that importing jfsf leaves it alone."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest


@pytest.mark.parametrize("rows", [16384, 16385, 20000])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_reductions_of_batched_products_are_right(rows, dtype):
    # jaxlib 0.10.0 and 0.10.1 crash here, 0.10.2 returns wrong rows (issue 39103).
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(2, rows, 8)).astype(dtype)
    vector = rng.normal(size=(2, 8)).astype(dtype)
    product = np.einsum("brk,bk->br", matrix, vector)
    for reduce, truth in (
        (jnp.max, np.max),
        (jnp.sum, np.sum),
        (jnp.argmax, np.argmax),
    ):
        run = jax.jit(jax.vmap(lambda m, v, reduce=reduce: reduce(m @ v)))
        np.testing.assert_allclose(run(matrix, vector), truth(product, 1), rtol=2e-3)
    rows_of = jax.jit(jax.vmap(lambda m, v: jnp.max(m * (m @ v)[:, None], 1)))
    truth = (matrix * product[:, :, None]).max(2)
    np.testing.assert_allclose(rows_of(matrix, vector), truth, atol=1e-4)


def test_importing_jfsf_configures_nothing():
    code = (
        "import jax; before = dict(jax.config.values); import jfsf, jfsf.apps.cli; "
        "after = dict(jax.config.values); "
        "print([k for k in after if after[k] != before.get(k, after[k])])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout.strip() == "[]", run.stdout + run.stderr


def test_hypothesis_is_for_the_tests_alone():
    code = "import sys, jfsf; print('hypothesis' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout.strip() == "False", run.stdout + run.stderr
