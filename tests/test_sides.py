"""map_sides against a call for each side."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf.array._loops import map_sides


def side(n, dtype=float):
    rng = np.random.default_rng(n)
    nested = {"a": rng.random((n, 3)).astype(dtype), "b": None}
    return nested, jnp.arange(n)


def scaled(nested, order):
    assert nested["b"] is None
    return nested["a"] * 2, (order[::-1],)


@pytest.mark.parametrize(
    "n_y, dtype, loops", [(5, float, 1), (4, float, 0), (5, "f", 0)]
)
def test_it_equals_two_calls_and_equal_shapes_share_a_loop(n_y, dtype, loops):
    x, y = side(5), side(n_y, dtype)
    for found, alone in zip(map_sides(scaled, x, y), (x, y), strict=True):
        assert found[0].dtype == alone[0]["a"].dtype
        jax.tree.map(np.testing.assert_array_equal, found, scaled(*alone))
    program = jax.make_jaxpr(lambda x, y: map_sides(scaled, x, y))(x, y)
    assert str(program).count("scan[") == loops


def test_gradients_and_vmap_pass_through():
    def total(x, y):
        one, other = map_sides(lambda a: a**2, (x,), (y,))
        return jnp.sum(one) + 3 * jnp.sum(other)

    x, y = jnp.arange(6.0).reshape(2, 3), jnp.ones((2, 3))
    slope_x, slope_y = jax.vmap(jax.grad(total, (0, 1)))(x, y)
    np.testing.assert_allclose(slope_x, 2 * x)
    np.testing.assert_allclose(slope_y, 6 * y)
