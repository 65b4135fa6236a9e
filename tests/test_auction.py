"""Auction: one to one, at the least total squared distance; scipy is the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from experiments.paper.baselines import auction
from experiments.paper.baselines._auction import KEEP, assign
from jfsf import testing
from jfsf.convert import nearest
from jfsf.refine import icp
from jfsf.spectral import functional_map

# Methods of others, for a table of the experiments: they seldom change.
pytestmark = pytest.mark.slow

N_X, N_Y, WIDTH = 23, 31, 3
pairs = testing.embedding_pairs(N_X, N_Y, WIDTH)
TIGHT = 1e-9  # tells apart any two assignments of these small sets


def squares(emb_x, emb_y):
    return ((np.asarray(emb_x)[:, None] - np.asarray(emb_y)[None]) ** 2).sum(2)


def least(cost):
    return cost[linear_sum_assignment(cost)].sum()


def spread(*embs):
    rows = np.concatenate(embs)
    return ((rows - rows.mean(0)) ** 2).sum(1).mean()


@given(
    testing.point_sets(N_X, WIDTH),
    testing.point_sets(N_X, WIDTH),
    st.sampled_from((1e-2, 1e-5)),
)
def test_a_permutation_within_n_eps_of_the_optimum(emb_x, emb_y, eps):
    maps = auction(jnp.asarray(emb_x), jnp.asarray(emb_y), eps=eps)
    cost, T_xy = squares(emb_x, emb_y), np.asarray(maps.T_xy)
    assert np.array_equal(np.sort(T_xy), np.arange(N_X))
    assert np.array_equal(np.asarray(maps.T_yx)[T_xy], np.arange(N_X))
    excess = cost[np.arange(N_X), T_xy].sum() - least(cost)
    assert -1e-9 <= excess <= N_X * eps * spread(emb_x, emb_y) + 1e-9
    assert maps.T_xy.dtype == maps.T_yx.dtype == jnp.int32


@given(
    testing.point_sets(N_X, WIDTH),
    testing.point_sets(N_Y, WIDTH),
    st.sampled_from((1e-2, 1e-5)),
)
def test_the_smaller_side_is_injective_and_optimal(emb_x, emb_y, eps):
    maps = auction(jnp.asarray(emb_x), jnp.asarray(emb_y), eps=eps)
    cost, T_xy, T_yx = squares(emb_x, emb_y), *map(np.asarray, maps)
    assert len(np.unique(T_xy)) == N_X
    assert np.array_equal(T_yx[T_xy], np.arange(N_X))
    excess = cost[np.arange(N_X), T_xy].sum() - least(cost)
    assert -1e-9 <= excess <= N_X * eps * spread(emb_x, emb_y) + 1e-9
    # The rest of the larger side: nearest neighbours, up to ties.
    rest = np.setdiff1d(np.arange(N_Y), T_xy)
    assert np.allclose(cost[T_yx[rest], rest], cost[:, rest].min(0))


@given(pairs)
def test_swapping_the_shapes_swaps_the_maps(pair):
    emb_x, emb_y = map(jnp.asarray, pair)
    plain = auction(emb_x, emb_y, eps=TIGHT)
    swapped = auction(emb_y, emb_x, eps=TIGHT)
    assert np.array_equal(plain.T_xy, swapped.T_yx)
    assert np.array_equal(plain.T_yx, swapped.T_xy)


@given(pairs, testing.permutations(N_X), testing.permutations(N_Y))
def test_relabelling_relabels(pair, order_x, order_y):
    emb_x, emb_y = map(jnp.asarray, pair)
    moved = auction(emb_x[order_x], emb_y[order_y], eps=TIGHT)
    plain = auction(emb_x, emb_y, eps=TIGHT)
    truth = testing.relabel_maps(plain, order_x, order_y)
    assert np.array_equal(moved.T_xy, truth.T_xy)
    assert np.array_equal(moved.T_yx, truth.T_yx)


@given(pairs, testing.seeds)
def test_padding_is_invisible(pair, seed):
    emb_x, emb_y = map(jnp.asarray, pair)
    plain = auction(emb_x, emb_y)
    rng = np.random.default_rng(seed)
    # Padding amid the rest, and where it would be the best choice.
    at_x, at_y = (np.sort(rng.permutation(n + 4)[:n]) for n in (N_X, N_Y))
    wide_x, wide_y = (np.tile(e[0], (len(e) + 4, 1)) for e in pair)
    wide_x[at_x], wide_y[at_y] = pair
    real_x, real_y = np.zeros(N_X + 4), np.zeros(N_Y + 4)
    real_x[at_x], real_y[at_y] = 1, 1
    T_xy, T_yx = map(
        np.asarray, auction(*map(jnp.asarray, (wide_x, wide_y, real_x, real_y)))
    )
    assert np.array_equal(T_xy[at_x], at_y[plain.T_xy])
    assert np.array_equal(T_yx[at_y], at_x[plain.T_yx])
    assert not T_xy[real_x == 0].any() and not T_yx[real_y == 0].any()


def test_a_known_permutation_is_recovered_where_nearest_neighbours_collide():
    # More rows than a bidder remembers, and a shift that nearest neighbours fall for.
    n = KEEP + 150
    rng = np.random.default_rng(0)
    emb_x, order = rng.normal(size=(n, 2)), rng.permutation(n)
    emb_y = emb_x[order] + np.array([0.3, 0.0])
    maps = auction(jnp.asarray(emb_x), jnp.asarray(emb_y), eps=1e-7)
    # The shift costs the same for every assignment.
    assert np.array_equal(maps.T_yx, order)
    assert np.array_equal(maps.T_xy, np.argsort(order))
    near = nearest(jnp.asarray(emb_x), jnp.asarray(emb_y))
    assert (np.asarray(near.T_yx) == order).mean() < 0.2


@pytest.mark.parametrize("n", [1, 50, 500, 599, 600])
def test_large_sets_reach_scipys_optimum(n):
    rng = np.random.default_rng(n)
    flat = rng.uniform(size=(600, 2))
    benefit = -squares(rng.uniform(size=(n, 2)) ** 2, flat)
    eps = 1e-6
    item = assign(benefit, eps=eps, start=0.1)
    assert len(np.unique(item)) == n
    short = -least(-benefit) - benefit[np.arange(n), item].sum()
    assert -1e-9 <= short <= n * eps


def test_tiny_and_degenerate_sets():
    one, five = jnp.ones((1, 2)), jnp.ones((5, 2))
    assert auction(one, one).T_xy.tolist() == [0]
    assert np.array_equal(np.sort(auction(five, five).T_xy), np.arange(5))
    assert len(np.unique(auction(five, jnp.ones((7, 2))).T_xy)) == 5
    none = auction(one, five, jnp.zeros(1), jnp.ones(5))
    assert none.T_xy.tolist() == [0] and not none.T_yx.any()


def test_rows_that_are_not_finite_count_as_padding():
    emb = jnp.asarray(np.random.default_rng(0).normal(size=(6, 2)))
    broken = emb.at[2].set(jnp.nan)
    assert auction(broken, emb[::-1]).T_xy.tolist() == [5, 4, 0, 2, 1, 0]


def test_float32_agrees():
    rng = np.random.default_rng(0)
    emb_x, emb_y = (jnp.asarray(rng.normal(size=(n, WIDTH))) for n in (N_X, N_Y))
    low = auction(emb_x.astype(jnp.float32), emb_y.astype(jnp.float32), eps=TIGHT)
    assert np.array_equal(low.T_xy, auction(emb_x, emb_y, eps=TIGHT).T_xy)


def test_it_converts_inside_jit_and_vmap():
    rng = np.random.default_rng(0)
    emb_x, emb_y = (jnp.asarray(rng.normal(size=(3, n, WIDTH))) for n in (N_X, N_Y))
    batch = jax.jit(jax.vmap(auction))(emb_x, emb_y)
    for i in range(3):
        alone = auction(emb_x[i], emb_y[i])
        assert np.array_equal(batch.T_xy[i], alone.T_xy)
        assert np.array_equal(batch.T_yx[i], alone.T_yx)


def test_icp_takes_it_as_a_converter():
    spec = testing.blob_spectrum(0, 8)
    truth = np.random.default_rng(0).permutation(len(spec.mass))
    other = testing.relabel_spectrum(spec, truth)
    C_yx = functional_map(jnp.argsort(jnp.asarray(truth)), spec, other)
    C_yx = C_yx + 0.05 * np.random.default_rng(1).normal(size=C_yx.shape)
    C_yx = icp(spec, other, C_yx, num_iters=3, converter=auction)
    maps = auction(spec.evecs @ C_yx, other.evecs)
    assert np.array_equal(maps.T_yx, truth)


def test_wrong_input_is_an_error():
    with pytest.raises(ValueError, match=r"emb_x is \(4, 2\) and emb_y \(5, 3\)"):
        auction(jnp.ones((4, 2)), jnp.ones((5, 3)))
    with pytest.raises(ValueError, match=r"marginal_y has shape \(4,\), emb_y has 5"):
        auction(jnp.ones((4, 2)), jnp.ones((5, 2)), jnp.ones(4), jnp.ones(4))
    with pytest.raises(ValueError, match="eps is 0, it must be positive"):
        auction(jnp.ones((4, 2)), jnp.ones((5, 2)), eps=0)
    with pytest.raises(ValueError, match="5 bidders for 4 items"):
        assign(np.ones((5, 4)), eps=1e-3, start=1)
