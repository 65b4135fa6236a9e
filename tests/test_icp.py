"""Spectral ICP against the plain loop, and what must not change it."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import assume, given, settings

from jfsf import testing
from jfsf.convert import nearest
from jfsf.refine import icp
from jfsf.runtime._sizes import pad
from jfsf.spectral import embeddings, functional_map, polar, restrict, truncate

N_X, N_Y, K_X, K_Y = 162, 42, 20, 15
spectra_x = testing.spectra(K_X)
spectra_y = testing.spectra(K_Y, subdivisions=1)
run = partial(icp, num_iters=4, converter=nearest)


def start(spec_x, spec_y, seed=0):
    T_xy = np.random.default_rng(seed).integers(N_Y, size=N_X)
    return functional_map(jnp.asarray(T_xy, jnp.int32), spec_x, spec_y)


def lowest_singular_value(spec_x, spec_y, C):
    """Of all functional maps on the way. Of one without full rank the polar factor, and
    so what ICP makes of it, is not unique."""
    least = np.inf
    for _ in range(4):
        T_xy = nearest(*embeddings(C, spec_x.evecs, spec_y.evecs)).T_xy
        found = functional_map(T_xy, spec_x, spec_y)
        least = min(least, np.linalg.svd(found, compute_uv=False).min())
        C = polar(found)
    return least


def pair(seed):
    return testing.blob_spectrum(seed, K_X), testing.blob_spectrum(seed, K_Y, 1)


@settings(max_examples=8)
@given(spectra_x, spectra_y, testing.seeds)
def test_the_plain_loop_agrees(spec_x, spec_y, seed):
    C = start(spec_x, spec_y, seed)
    ours = run(spec_x, spec_y, C)
    np.testing.assert_allclose(ours, oracles.icp(spec_x, spec_y, C, 4), atol=1e-7)
    np.testing.assert_allclose(ours.T @ ours, np.eye(K_Y), atol=1e-10)


def test_no_iteration_changes_nothing():
    C = start(*pair(0))
    assert np.array_equal(icp(*pair(0), C, num_iters=0, converter=nearest), C)


def test_a_known_permutation_is_recovered():
    spec_x = testing.blob_spectrum(2, K_X)
    order = np.random.default_rng(0).permutation(N_X)
    spec_y = testing.relabel_spectrum(spec_x, order)
    truth = jnp.asarray(np.argsort(order), jnp.int32)
    rough = functional_map(truth.at[:20].set(truth[50:70]), spec_x, spec_y)
    for space in ("adjoint", "direct"):
        C = icp(spec_x, spec_y, rough, num_iters=6, converter=nearest, space=space)
        maps = nearest(*embeddings(C, spec_x.evecs, spec_y.evecs, space=space))
        assert np.array_equal(maps.T_xy, truth) and np.array_equal(maps.T_yx, order)


@settings(max_examples=8)
@given(spectra_x, spectra_y, testing.permutations(N_X), testing.signs(K_X))
def test_labels_signs_and_padding_change_nothing_but_C(spec_x, spec_y, order, by):
    C, keep = start(spec_x, spec_y), np.ones(K_Y)
    assume(lowest_singular_value(spec_x, spec_y, C) > 1e-6)
    plain = testing.flip_map(run(spec_x, spec_y, C), by, keep)
    other = testing.flip_signs(testing.relabel_spectrum(spec_x, order), by)
    turned = testing.flip_map(C, by, keep)
    np.testing.assert_allclose(run(other, spec_y, turned), plain, atol=1e-8)
    wide = pad(other, N_X + 5, 330), pad(spec_y, N_Y + 3, 90)
    np.testing.assert_allclose(run(*wide, turned), plain, atol=1e-8)


def test_eigenpairs_beyond_C_are_left_out():
    spec_x, spec_y = pair(1)
    C = start(spec_x, spec_y)[:8, :6]
    few = run(truncate(spec_x, 8), truncate(spec_y, 6), C)
    np.testing.assert_allclose(run(spec_x, spec_y, C), few, atol=1e-12)


def test_vmap_equals_the_loop():
    pairs = [pair(seed) for seed in range(3)]
    starts = [start(*p) for p in pairs]
    batch = [testing.stack(list(s)) for s in zip(*pairs, strict=True)]
    found = jax.vmap(run)(*batch, jnp.stack(starts))
    for i, (p, C) in enumerate(zip(pairs, starts, strict=True)):
        np.testing.assert_allclose(found[i], run(*p, C), atol=1e-8)


def test_pairs_of_equal_size_compile_once():
    run(*pair(0), start(*pair(0)))
    before = icp._jitted._cache_size()
    run(*pair(1), start(*pair(1)))
    assert icp._jitted._cache_size() == before


def test_float32():
    low = [testing.cast(s, jnp.float32) for s in pair(0)]
    C = run(*low, start(*low))
    assert C.dtype == jnp.float32
    np.testing.assert_allclose(C.T @ C, np.eye(K_Y), atol=1e-5)


def test_errors():
    with pytest.raises(
        ValueError, match="icp: num_iters is -1, it must not be negative"
    ):
        icp(*pair(0), jnp.eye(5), num_iters=-1, converter=nearest)
    with pytest.raises(ValueError, match="k is 21, there are 20 eigenpairs"):
        icp(*pair(0), jnp.ones((21, 5)), converter=nearest)


@pytest.mark.parametrize("start", [np.eye(K_X, dtype=int), np.eye(K_X)])
def test_the_start_may_have_another_precision(start):
    spec = testing.cast(testing.blob_spectrum(0, K_X), jnp.float32)
    found = run(spec, spec, jnp.asarray(start))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, np.eye(K_X), atol=1e-3)


def test_fewer_points_than_functions_are_an_error():
    few = restrict(testing.blob_spectrum(0, 40), jnp.arange(25))
    with pytest.raises(ValueError, match="40 eigenfunctions is read at 25 points"):
        run(few, few, jnp.eye(40))
