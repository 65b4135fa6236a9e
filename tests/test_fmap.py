"""Functional maps: the definition, the adjoint, and what is exact in the full basis."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given

from jfsf import testing
from jfsf.convert import nearest
from jfsf.runtime._sizes import pad
from jfsf.spectral import (
    embeddings,
    farthest_points,
    functional_map,
    polar,
    restrict,
    truncate,
    truncate_pair,
    uniform,
)

N_X, N_Y, K_X, K_Y = 162, 42, 20, 15
spectra_x = testing.spectra(K_X)
spectra_y = testing.spectra(K_Y, subdivisions=1)


def random_map(seed, n_x=N_X, n_y=N_Y):
    return jnp.asarray(np.random.default_rng(seed).integers(n_y, size=n_x), jnp.int32)


@given(spectra_x, spectra_y, testing.seeds)
def test_weighted_least_squares(spec_x, spec_y, seed):
    T_xy = random_map(seed)
    ours = functional_map(T_xy, spec_x, spec_y)
    truth = oracles.functional_map(T_xy, *spec_x[1:2], spec_y.evecs, spec_x.mass)
    np.testing.assert_allclose(ours, truth, atol=1e-10)
    # A sample's eigenvectors are not orthonormal, and some of its masses are 0.
    mass = jnp.asarray(np.random.default_rng(seed).uniform(-0.2, 1, N_X).clip(0))
    other = spec_x._replace(mass=mass)
    truth = oracles.functional_map(T_xy, spec_x.evecs, spec_y.evecs, mass)
    np.testing.assert_allclose(functional_map(T_xy, other, spec_y), truth, atol=1e-8)


@given(spectra_x, spectra_y, testing.seeds)
def test_D_is_the_adjoint_in_the_mass_inner_products(spec_x, spec_y, seed):
    C_yx = functional_map(random_map(seed), spec_x, spec_y)
    rng = np.random.default_rng(seed)
    f_y, g_x = spec_y.evecs @ rng.normal(size=K_Y), spec_x.evecs @ rng.normal(size=K_X)
    pulled = spec_x.evecs @ C_yx @ spec_y.evecs.T @ (spec_y.mass * f_y)
    pushed = spec_y.evecs @ C_yx.T @ spec_x.evecs.T @ (spec_x.mass * g_x)
    there = jnp.sum(spec_y.mass * pushed * f_y)
    assert np.isclose(there, jnp.sum(spec_x.mass * g_x * pulled))


@given(testing.seeds)
def test_deltas_go_to_deltas_in_the_full_basis(seed):
    # Theorem 1: D maps the delta at x to the delta at T(x), exactly.
    spec_x, spec_y = full(2), full(1)
    T_xy = random_map(seed)
    C_yx = functional_map(T_xy, spec_x, spec_y)
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs)
    np.testing.assert_allclose(emb_x, emb_y[T_xy], atol=1e-8)
    assert np.array_equal(nearest(emb_x, emb_y).T_xy, T_xy)
    deltas = spec_y.evecs @ C_yx.T @ spec_x.evecs.T
    truth = np.zeros((N_Y, N_X))
    truth[T_xy, np.arange(N_X)] = 1 / np.asarray(spec_y.mass)[T_xy]
    np.testing.assert_allclose(deltas, truth, atol=1e-6 * truth.max())


def full(subdivisions):
    n = 10 * 4**subdivisions + 2
    return testing.blob_spectrum(0, n, subdivisions)


def test_the_identity_is_the_identity():
    spec = full(2)
    C = functional_map(jnp.arange(N_X), truncate(spec, 9), truncate(spec, 7))
    np.testing.assert_allclose(C, np.eye(9, 7), atol=1e-10)


@given(spectra_x, spectra_y, testing.seeds)
def test_embeddings(spec_x, spec_y, seed):
    C_yx = functional_map(random_map(seed), spec_x, spec_y)[:9, :8]
    phi_x, phi_y = spec_x.evecs, spec_y.evecs
    emb_x, emb_y = embeddings(C_yx, phi_x, phi_y)
    np.testing.assert_allclose(emb_x, phi_x[:, :9] @ C_yx, atol=1e-12)
    assert np.array_equal(emb_y, phi_y[:, :8])
    emb_x, emb_y = embeddings(C_yx, phi_x, phi_y, space="direct")
    assert np.array_equal(emb_x, phi_x[:, :9])
    np.testing.assert_allclose(emb_y, phi_y[:, :8] @ C_yx.T, atol=1e-12)


@given(spectra_x, testing.seeds)
def test_the_spaces_agree_where_C_is_orthonormal(spec, seed):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(K_X, K_X)))[0]
    maps = [
        nearest(*embeddings(jnp.asarray(turn), spec.evecs, spec.evecs, space=space))
        for space in ("adjoint", "direct")
    ]
    assert np.array_equal(maps[0].T_xy, maps[1].T_xy)
    assert np.array_equal(maps[0].T_yx, maps[1].T_yx)


@given(spectra_x, spectra_y, testing.seeds, testing.signs(K_X), testing.signs(K_Y))
def test_signs_change_nothing_but_C(spec_x, spec_y, seed, by_x, by_y):
    T_xy = random_map(seed)
    C_yx = functional_map(T_xy, spec_x, spec_y)
    other_x, other_y = (
        testing.flip_signs(*s) for s in ((spec_x, by_x), (spec_y, by_y))
    )
    flipped = functional_map(T_xy, other_x, other_y)
    np.testing.assert_allclose(flipped, testing.flip_map(C_yx, by_x, by_y), atol=1e-10)
    plain = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs))
    turned = nearest(*embeddings(flipped, other_x.evecs, other_y.evecs))
    assert np.array_equal(plain.T_xy, turned.T_xy)


@given(spectra_x, spectra_y, testing.seeds, testing.permutations(N_X))
def test_relabelling_and_padding_leave_C_alone(spec_x, spec_y, seed, order):
    T_xy = random_map(seed)
    C_yx = functional_map(T_xy, spec_x, spec_y)
    moved = functional_map(T_xy[order], testing.relabel_spectrum(spec_x, order), spec_y)
    np.testing.assert_allclose(moved, C_yx, atol=1e-10)
    padded = functional_map(
        jnp.pad(T_xy, (0, 6)), pad(spec_x, N_X + 6, 330), pad(spec_y, N_Y + 3, 90)
    )
    np.testing.assert_allclose(padded, C_yx, atol=1e-12)


def test_polar_is_the_nearest_orthonormal_matrix():
    rng = np.random.default_rng(0)
    for shape in ((6, 4), (4, 6)):
        C = jnp.asarray(rng.normal(size=shape))
        nearest_C = polar(C)
        gram = (
            nearest_C.T @ nearest_C if shape[0] > shape[1] else nearest_C @ nearest_C.T
        )
        np.testing.assert_allclose(gram, np.eye(4), atol=1e-12)
        gap = jnp.linalg.norm(C - nearest_C)
        for _ in range(20):
            q = np.linalg.qr(rng.normal(size=(6, 4)))[0]
            other = q if shape[0] > shape[1] else q.T
            assert gap < jnp.linalg.norm(C - other)
        np.testing.assert_allclose(polar(nearest_C), nearest_C, atol=1e-12)


def test_truncate_and_uniform():
    spec = full(1)
    few = truncate(spec, 5)
    assert few.evecs.shape == (N_Y, 5) and few.evals.shape == (5,)
    for pair in ((spec, few), (few, spec)):
        assert all(np.array_equal(s.evals, few.evals) for s in truncate_pair(*pair))
    assert np.array_equal(
        uniform(jnp.array([0.5, 0.0, 0.1, 0.4])), [1 / 3, 0, 1 / 3, 1 / 3]
    )


def test_vmap_equals_the_loop():
    specs_x = [testing.blob_spectrum(s, K_X, 2) for s in range(3)]
    specs_y = [testing.blob_spectrum(s, K_Y, 1) for s in range(3)]
    maps = jnp.stack([random_map(s) for s in range(3)])
    batch = jax.vmap(functional_map)(
        maps, testing.stack(specs_x), testing.stack(specs_y)
    )
    for i in range(3):
        single = functional_map(maps[i], specs_x[i], specs_y[i])
        np.testing.assert_allclose(batch[i], single, atol=1e-10)


def test_float32():
    x, y = testing.blob_spectrum(0, K_X, 2), testing.blob_spectrum(0, K_Y, 1)
    low = functional_map(random_map(0), *(testing.cast(s, jnp.float32) for s in (x, y)))
    assert low.dtype == jnp.float32
    np.testing.assert_allclose(low, functional_map(random_map(0), x, y), atol=1e-5)


def test_errors():
    spec = full(1)
    with pytest.raises(ValueError, match=r"T_xy has shape \(3,\), X has 42 vertices"):
        functional_map(jnp.zeros(3, int), spec, spec)
    with pytest.raises(
        ValueError, match=r"C_yx is \(50, 5\), the bases have 42 and 42"
    ):
        embeddings(jnp.zeros((50, 5)), spec.evecs, spec.evecs)
    with pytest.raises(ValueError, match="'adjoint' or 'direct', not 'other'"):
        embeddings(jnp.eye(3), spec.evecs, spec.evecs, space="other")  # type: ignore
    for k in (0, 43):
        with pytest.raises(ValueError, match=f"k is {k}, there are 42 eigenpairs"):
            truncate(spec, k)


def test_fewer_points_than_functions_are_an_error():
    spec = testing.blob_spectrum(0, 60)
    few = restrict(spec, farthest_points(spec, num=30))
    with pytest.raises(ValueError, match="60 eigenfunctions is read at 30 points"):
        functional_map(jnp.zeros(30, int), few, spec)
