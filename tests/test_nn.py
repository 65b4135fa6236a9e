"""Nearest neighbours both ways."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given

from jfsf import testing
from jfsf.convert import nearest
from jfsf.evaluate import spectral_chamfer

N_X, N_Y, WIDTH = 23, 31, 3
pairs = testing.embedding_pairs(N_X, N_Y, WIDTH)


@given(testing.point_sets(N_X, WIDTH), testing.point_sets(N_Y, WIDTH))
def test_brute_force_agrees(emb_x, emb_y):
    maps = nearest(jnp.asarray(emb_x), jnp.asarray(emb_y))
    T_xy, T_yx = oracles.nearest(emb_x, emb_y)
    assert np.array_equal(maps.T_xy, T_xy) and np.array_equal(maps.T_yx, T_yx)
    assert maps.T_xy.dtype == maps.T_yx.dtype == jnp.int32


@given(pairs, testing.permutations(N_X), testing.permutations(N_Y))
def test_relabelling_relabels(pair, order_x, order_y):
    emb_x, emb_y = map(jnp.asarray, pair)
    moved = nearest(emb_x[order_x], emb_y[order_y])
    truth = testing.relabel_maps(nearest(emb_x, emb_y), order_x, order_y)
    assert np.array_equal(moved.T_xy, truth.T_xy)
    assert np.array_equal(moved.T_yx, truth.T_yx)


@given(pairs)
def test_padding_is_never_chosen(pair):
    emb_x, emb_y = map(jnp.asarray, pair)
    plain = nearest(emb_x, emb_y)
    real_x, real_y = (jnp.pad(jnp.ones(n), (0, 4)) for n in (N_X, N_Y))
    padded = nearest(*(jnp.pad(e, ((0, 4), (0, 0))) for e in pair), real_x, real_y)
    assert np.array_equal(padded.T_xy[:N_X], plain.T_xy)
    assert np.array_equal(padded.T_yx[:N_Y], plain.T_yx)


@given(pairs, testing.seeds)
def test_the_two_maps_are_one_relation(pair, seed):
    # Turning both embeddings together, or swapping the shapes, changes nothing.
    emb_x, emb_y = map(jnp.asarray, pair)
    plain, swapped = nearest(emb_x, emb_y), nearest(emb_y, emb_x)
    assert np.array_equal(plain.T_xy, swapped.T_yx)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(WIDTH, WIDTH)))[0]
    turned = nearest(emb_x @ turn, emb_y @ turn)
    assert np.array_equal(plain.T_xy, turned.T_xy)


def test_the_chamfer_distance_is_its_mean():
    emb_x, emb_y = jnp.asarray(np.random.default_rng(0).normal(size=(2, 20, 3)))
    maps = nearest(emb_x, emb_y)
    there = jnp.linalg.norm(emb_x - emb_y[maps.T_xy], axis=1).mean()
    back = jnp.linalg.norm(emb_y - emb_x[maps.T_yx], axis=1).mean()
    assert np.isclose(there + back, spectral_chamfer(emb_x, emb_y))


def test_vmap_equals_the_loop():
    rng = np.random.default_rng(0)
    emb_x, emb_y = (jnp.asarray(rng.normal(size=(3, n, WIDTH))) for n in (N_X, N_Y))
    batch = jax.vmap(nearest)(emb_x, emb_y)
    for i in range(3):
        assert np.array_equal(batch.T_xy[i], nearest(emb_x[i], emb_y[i]).T_xy)
        assert np.array_equal(batch.T_yx[i], nearest(emb_x[i], emb_y[i]).T_yx)


def test_float32():
    rng = np.random.default_rng(0)
    emb_x, emb_y = (jnp.asarray(rng.normal(size=(n, WIDTH))) for n in (N_X, N_Y))
    low = nearest(emb_x.astype(jnp.float32), emb_y.astype(jnp.float32))
    assert np.array_equal(low.T_xy, nearest(emb_x, emb_y).T_xy)


def test_widths_that_differ_are_an_error():
    with pytest.raises(ValueError, match="emb_x has 2 columns, emb_y has 3"):
        nearest(jnp.ones((4, 2)), jnp.ones((5, 3)))
