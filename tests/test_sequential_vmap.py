"""vmap as a loop gives the results of vmap."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf.array._loops import sequential_vmap


def nearest_entry(x, y):
    """Index and distance of the entry of y nearest to each entry of x."""
    gap = jnp.abs(x[:, None] - y[None])
    return gap.argmin(1), gap.min(1)


looped = sequential_vmap(nearest_entry)


def sides(*shape):
    rng = np.random.default_rng(0)
    return jnp.asarray(rng.normal(size=(*shape, 7))), jnp.asarray(rng.normal(size=5))


@pytest.mark.parametrize("axes", [(0, None), (1, None), (None, 0), (0, 0)])
def test_vmap_equals_vmap_of_the_plain_function(axes):
    rng = np.random.default_rng(0)
    args = [
        jnp.asarray(rng.normal(size=(n,) if axis is None else (n, n)))
        for n, axis in zip((6, 6), axes, strict=True)
    ]
    found = jax.vmap(looped, axes)(*args)
    wanted = jax.vmap(nearest_entry, axes)(*args)
    jax.tree.map(np.testing.assert_array_equal, found, wanted)


def test_nested_vmaps_agree():
    x, y = sides(2, 3)
    twice = lambda f: jax.vmap(jax.vmap(f, (0, None)), (0, None))
    wanted = twice(nearest_entry)(x, y)
    jax.tree.map(np.testing.assert_array_equal, twice(looped)(x, y), wanted)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="of CPUs only")
def test_a_cpu_loops_over_the_batch():
    x, y = sides(3)
    lowered = lambda f: jax.jit(jax.vmap(f, (0, None))).lower(x, y).as_text()
    assert "stablehlo.while" in lowered(looped)
    assert "stablehlo.while" not in lowered(nearest_entry)


def test_derivatives_beside_it():
    x, y = sides(3)

    def loss(x, y):
        at, _ = looped(*jax.lax.stop_gradient((x, y)))
        return jnp.sum((x - y[at]) ** 2)

    found = jax.vmap(jax.grad(loss), (0, None))(x, y)
    outside = jax.grad(lambda x: jax.vmap(loss, (0, None))(x, y).sum())(x)
    for i in range(3):
        np.testing.assert_allclose(found[i], jax.grad(loss)(x[i], y))
    np.testing.assert_allclose(outside, found)
