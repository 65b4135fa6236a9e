"""Programs compiled with options are the same programs."""

import jax.numpy as jnp
import numpy as np

from jfsf import compiling


def centred(x, *, axis):
    return x - x.mean(axis, keepdims=True)


def test_the_result_is_that_of_jit():
    x = jnp.arange(12.0).reshape(3, 4)
    run = compiling.large_jit(centred, "cpu", static_argnames="axis")
    np.testing.assert_allclose(run(x, axis=1), centred(x, axis=1))


def test_it_compiles_once():
    runs = [
        compiling.large_jit(centred, "cpu", static_argnames="axis") for _ in range(2)
    ]
    assert runs[0] is runs[1]


def test_options_that_this_xla_lacks_are_left_out(monkeypatch):
    known = {"xla_backend_optimization_level": 1}
    monkeypatch.setattr(compiling, "CPU_OPTIONS", known | {"xla_of_another_year": 1})
    assert compiling._known.__wrapped__() == known
