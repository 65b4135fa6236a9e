"""Farthest points against the plain loop, and spectra restricted to them."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given, settings

from jfsf import testing
from jfsf.runtime._sizes import pad
from jfsf.spectral import farthest_points, restrict, tile_points
from jfsf.spectral._sampling import biharmonic, even_points

N, K, NUM = 162, 20, 25
spectra = testing.spectra(K)


@given(spectra)
def test_one_by_one_the_farthest(spec):
    ours = farthest_points(spec, num=NUM)
    points = np.asarray(biharmonic(spec))
    assert np.array_equal(ours, oracles.farthest_points(points, np.ones(N, bool), NUM))
    assert len(set(ours.tolist())) == NUM and ours.dtype == jnp.int32


def test_all_vertices_once():
    spec = testing.blob_spectrum(0, K, 2)
    assert sorted(farthest_points(spec, num=N).tolist()) == list(range(N))


@settings(max_examples=8)
@given(spectra, testing.permutations(N), testing.signs(K))
def test_labels_and_signs_change_nothing(spec, order, by):
    plain = farthest_points(spec, num=NUM)
    moved = testing.flip_signs(testing.relabel_spectrum(spec, order), by)
    assert np.array_equal(order[farthest_points(moved, num=NUM)], plain)


@given(spectra)
def test_padding_is_never_chosen(spec):
    padded = pad(spec, N + 30, 400)
    assert np.array_equal(
        farthest_points(padded, num=NUM), farthest_points(spec, num=NUM)
    )
    # Not even when there is nothing else.
    every = farthest_points(padded, num=N + 10)
    assert set(every.tolist()) == set(range(N))
    few = restrict(padded, every)
    assert np.isclose(few.mass.sum(), 1) and np.isfinite(few.evecs).all()


@given(spectra)
def test_each_sample_weighs_its_cell(spec):
    at = farthest_points(spec, num=NUM)
    few = restrict(spec, at)
    points = np.asarray(biharmonic(spec))
    cell = oracles.neighbours(points, points[at], 1)[0][:, 0]
    truth = np.bincount(cell, np.asarray(spec.mass), NUM)
    np.testing.assert_allclose(few.mass, truth, atol=1e-14)
    assert np.isclose(few.mass.sum(), 1) and (few.mass > 0).all()
    assert np.array_equal(few.evecs, spec.evecs[at]) and few.faces.shape == (0, 3)
    assert np.array_equal(few.evals, spec.evals)
    hidden = restrict(pad(spec, N + 30, 400), at)
    np.testing.assert_allclose(hidden.mass, few.mass)


def test_vmap_equals_the_loop():
    specs = [testing.blob_spectrum(seed, K, 2) for seed in range(3)]
    batch = testing.stack(specs)
    at = jax.vmap(lambda s: farthest_points(s, num=NUM))(batch)
    few = jax.vmap(restrict)(batch, at)
    for i, spec in enumerate(specs):
        assert np.array_equal(at[i], farthest_points(spec, num=NUM))
        np.testing.assert_allclose(few.mass[i], restrict(spec, at[i]).mass)


def test_float32():
    spec = testing.cast(testing.blob_spectrum(0, K, 2), jnp.float32)
    at = farthest_points(spec, num=NUM)
    assert np.array_equal(at, farthest_points(testing.blob_spectrum(0, K, 2), num=NUM))
    assert restrict(spec, at).mass.dtype == jnp.float32


def test_farthest_points_of_some_vertices_only():
    spec = testing.blob_spectrum(0, K, 2)
    points = np.asarray(biharmonic(spec))
    among = np.random.default_rng(3).permutation(N)[:60].astype(np.int32)
    at = farthest_points(spec, among, num=NUM)
    wanted = oracles.farthest_points(points[among], np.ones(60, bool), NUM)
    assert np.array_equal(at, among[wanted])
    with pytest.raises(ValueError, match="num is 61, there are 60 vertices"):
        farthest_points(spec, among, num=61)


def test_even_points_of_a_small_shape_are_all_its_vertices():
    spec = testing.blob_spectrum(0, K, 2)
    padded = pad(spec, 300, len(spec.faces))
    assert sorted(even_points(padded, num=256)[:N].tolist()) == list(range(N))
    assert np.array_equal(even_points(padded, num=64), tile_points(padded, num=64))


@pytest.mark.parametrize("num", [0, 163])
def test_num_out_of_range_is_an_error(num):
    with pytest.raises(ValueError, match=f"num is {num}, there are 162 vertices"):
        farthest_points(testing.blob_spectrum(0, K, 2), num=num)


def test_tile_points_are_spread():
    spec = testing.blob_spectrum(0, 30)
    at = np.asarray(tile_points(spec, num=32))
    assert 32 <= len(at) <= 64 and len(np.unique(at)) == len(at)
    # No vertex is much farther from a sample than farthest-point samples leave it.
    points = np.asarray(biharmonic(spec))
    worst = lambda at: np.linalg.norm(points[:, None] - points[at], axis=2).min(1).max()
    assert worst(at) < 2 * worst(np.asarray(farthest_points(spec, num=len(at))))


def test_tile_points_leave_padding_out():
    spec = testing.blob_spectrum(0, 30)
    n = len(spec.mass)
    padded = pad(spec, n + 50, len(spec.faces))
    assert tile_points(padded, num=20).max() < n
    with pytest.raises(ValueError, match=f"num is {n + 1}, the shape has {n}"):
        tile_points(spec, num=n + 1)
