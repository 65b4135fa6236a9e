"""Soft steps: they tend to the hard ones, and their slopes are right."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import testing
from jfsf.convert import sinkhorn
from jfsf.initial import fit
from jfsf.refine import (
    icp,
    soft_functional_map,
    soft_icp_step,
    soft_map,
    soft_sinkhorn,
    soft_zoomout_step,
    zoomout,
)
from jfsf.spectral import functional_map, polar, truncate

K, WIDE = 8, 12


def pair():
    """A blob and itself, relabelled, with the truth; spectra of WIDE eigenpairs."""
    spec_x = testing.blob_spectrum(1, WIDE)
    order = np.random.default_rng(0).permutation(len(spec_x.mass))
    spec_y = testing.relabel_spectrum(spec_x, order)
    return spec_x, spec_y, jnp.asarray(np.argsort(order), jnp.int32)


def rough(size=K):
    noise = np.random.default_rng(1).normal(size=(size, size))
    return jnp.eye(size) + 0.05 * jnp.asarray(noise)


SHARP = partial(sinkhorn, k0=10, lam=1e4, num_iters=12, relax=1.0)


def test_a_sharp_soft_map_is_the_map():
    spec_x, spec_y, T_xy = pair()
    found = soft_map(spec_x, spec_y, jnp.eye(WIDE), converter=SHARP)
    assert np.array_equal(found.T_xy, T_xy)
    C = soft_functional_map(found, spec_x, spec_y)
    np.testing.assert_allclose(C, functional_map(T_xy, spec_x, spec_y), atol=1e-6)


@pytest.mark.slow
def test_sharp_steps_are_those_of_zoomout_and_icp():
    spec_x, spec_y, _ = pair()
    # The plan of a sharp kernel has some rows with more than one entry.
    ours = soft_zoomout_step(spec_x, spec_y, rough(), k=WIDE, converter=SHARP)
    hard = zoomout(spec_x, spec_y, rough(), ks=(K, WIDE), converter=SHARP)
    assert jnp.linalg.norm(ours - hard) < 0.1 * jnp.linalg.norm(hard)
    ours = soft_icp_step(spec_x, spec_y, rough(), converter=SHARP)
    hard = icp(spec_x, spec_y, rough(), num_iters=1, converter=SHARP)
    assert jnp.linalg.norm(ours - hard) < 0.1 * jnp.linalg.norm(hard)
    np.testing.assert_allclose(ours.T @ ours, jnp.eye(K), atol=1e-9)


@pytest.mark.parametrize("shape", [(5, 5), (7, 4), (4, 7)])
@pytest.mark.parametrize("repeated", [False, True])
def test_the_slope_of_the_polar_factor(shape, repeated):
    rng = np.random.default_rng(0)
    C, step = (jnp.asarray(rng.normal(size=shape)) for _ in range(2))
    C = polar(C) if repeated else C  # all singular values are 1
    h = 1e-6
    _, found = jax.jvp(polar, (C,), (step,))
    exact = (polar(C + h * step) - polar(C - h * step)) / (2 * h)
    np.testing.assert_allclose(found, exact, atol=1e-7)
    back = jax.vjp(polar, C)[1](jnp.ones(shape))[0]
    np.testing.assert_allclose(jnp.sum(back * step), found.sum(), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("tol", [None, 1e-11])
def test_a_chain_of_steps_has_the_slope_of_its_finite_differences(tol):
    # Two bodies with the sphere's vertices in common.
    spec_x, spec_y = (testing.blob_spectrum(seed, WIDE) for seed in (1, 2))
    desc_x, desc_y = spec_x.vertices, spec_y.vertices
    # Among few neighbours no plan is exact; here all are near.
    converter = partial(soft_sinkhorn, tol=tol, k0=162, lam=2.0, length_gradient=True)
    truth = functional_map(jnp.arange(162, dtype=jnp.int32), spec_x, spec_y)

    def loss(noise):
        C = fit(spec_x, spec_y, desc_x + noise * desc_x**2, desc_y, k=K).C_yx
        C = soft_icp_step(spec_x, spec_y, C, converter=converter)
        C = soft_zoomout_step(spec_x, spec_y, C, k=WIDE, converter=converter)
        return jnp.sum((C - truth) ** 2)

    at, h = jnp.asarray(0.1), 1e-5
    exact = (loss(at + h) - loss(at - h)) / (2 * h)
    assert abs(exact) > 1e-4
    np.testing.assert_allclose(jax.grad(loss)(at), exact, rtol=1e-4)


@pytest.mark.slow
def test_vmap_equals_the_loop():
    spec_x, spec_y, _ = pair()
    starts = jnp.stack([rough(), rough() @ rough(), jnp.eye(K)])
    for step in (soft_icp_step, partial(soft_zoomout_step, k=WIDE)):
        run = partial(step, spec_x, spec_y)
        found = jax.vmap(run)(starts)
        for one, start in zip(found, starts, strict=True):
            np.testing.assert_allclose(one, run(start), atol=1e-9)


def test_errors():
    spec_x, spec_y, _ = pair()
    with pytest.raises(ValueError, match="embeddings: C_yx is"):
        soft_map(truncate(spec_x, 4), spec_y, rough())
    with pytest.raises(ValueError, match="truncate: k is 99"):
        soft_zoomout_step(spec_x, spec_y, rough(), k=99)
