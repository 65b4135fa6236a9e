"""The sparse kernel against the dense one it stands for."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logsumexp

from jfsf import testing
from jfsf.convert import _kernel as kernels
from jfsf.convert._kernel import transpose, transpose_plan
from jfsf.neighbours import neighbours
from jfsf.types import Kernel

N_X, N_Y, K0, WIDTH = 23, 31, 5, 3
build = jax.jit(kernels.build, static_argnames=("power", "unilateral_weight"))
log_matvec, matvec, scaled, row_argmax = map(
    jax.jit, (kernels.log_matvec, kernels.matvec, kernels.scaled, kernels.row_argmax)
)
pairs = testing.embedding_pairs(N_X, N_Y, WIDTH)


def near(emb_x, emb_y, valid_x=None, valid_y=None):
    there = neighbours(jnp.asarray(emb_x), jnp.asarray(emb_y), valid_y, k0=K0)
    back = neighbours(jnp.asarray(emb_y), jnp.asarray(emb_x), valid_x, k0=K0)
    return there, back


def sharp(lam):
    return jnp.asarray(lam, jnp.float64)


def dense(kernel: Kernel):
    """log K (n_x, n_y); each entry must be stored once."""
    out = np.full((len(kernel.idx_xy), len(kernel.idx_yx)), -np.inf)
    halves = (
        (kernel.idx_xy, kernel.log_xy, out),
        (kernel.idx_yx, kernel.log_yx, out.T),
    )
    for idx, log, into in halves:
        for i, c in np.argwhere(np.isfinite(log)):
            assert into[i, idx[i, c]] == -np.inf, "an entry is stored twice"
            into[i, idx[i, c]] = log[i, c]
    return out


@pytest.mark.parametrize(
    "power, unilateral_weight",
    [
        (2.0, 0.5),
        *(pytest.param(*p, marks=pytest.mark.slow) for p in ((1.0, 1.0), (1.0, 0.5))),
        pytest.param(2.0, 1.0, marks=pytest.mark.slow),
    ],
)
@given(pair=pairs, lams=st.tuples(st.floats(0, 50), st.floats(0, 50)))
def test_union_of_both_sides(power, unilateral_weight, pair, lams):
    lists = near(*pair)
    ours = build(
        *lists, *map(sharp, lams), power=power, unilateral_weight=unilateral_weight
    )
    truth = oracles.log_kernel(*map(tuple_of, lists), *lams, power, unilateral_weight)
    np.testing.assert_allclose(dense(ours), truth, rtol=1e-12, atol=1e-12)


def tuple_of(found):
    return np.asarray(found.idx), np.asarray(found.dist)


@given(pair=pairs, seed=testing.seeds)
def test_padding_holds_no_entry(pair, seed):
    rng = np.random.default_rng(seed)
    real_x, real_y = rng.random(N_X) < 0.8, rng.random(N_Y) < 0.1
    there, back = near(*pair, jnp.asarray(real_x), jnp.asarray(real_y))
    there = there._replace(dist=jnp.where(real_x[:, None], there.dist, jnp.inf))
    back = back._replace(dist=jnp.where(real_y[:, None], back.dist, jnp.inf))
    # Sharpness 0 must not turn an absent entry into nan.
    for lam in (0.0, 3.0):
        ours = dense(build(there, back, sharp(lam), sharp(lam)))
        truth = oracles.log_kernel(tuple_of(there), tuple_of(back), lam, lam)
        np.testing.assert_allclose(ours, truth, atol=1e-12)
        assert (ours[~real_x] == -np.inf).all() and (ours[:, ~real_y] == -np.inf).all()


def test_unilateral_weight_0_leaves_the_mutual_neighbours():
    lists = near(*draw(0))
    both = dense(build(*lists, sharp(1), sharp(1), unilateral_weight=0.0))
    every = dense(build(*lists, sharp(1), sharp(1)))
    asked = np.zeros((2, N_X, N_Y), bool)
    np.put_along_axis(asked[0], np.asarray(lists[0].idx), True, 1)
    np.put_along_axis(asked[1].T, np.asarray(lists[1].idx), True, 1)
    assert np.array_equal(np.isfinite(both), asked.all(0))
    assert np.array_equal(np.isfinite(every), asked.any(0))


def draw(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(N_X, WIDTH)), rng.normal(size=(N_Y, WIDTH))


def close(ours, truth):
    atol = 1e-12 * np.abs(truth).max() + 1e-300
    np.testing.assert_allclose(ours, truth, atol=atol)


@pytest.mark.slow
@given(pair=pairs, seed=testing.seeds, lam=st.sampled_from([1.0, 30.0, 1e4]))
def test_sums_and_maxima(pair, seed, lam):
    kernel = build(*near(*pair), sharp(lam), sharp(lam / 2), unilateral_weight=0.5)
    rng, log_k = np.random.default_rng(seed), dense(kernel)
    f, g = rng.normal(size=N_X) * 10, rng.normal(size=N_Y) * 10

    for K, L, h in ((kernel, log_k, g), (transpose(kernel), log_k.T, f)):
        np.testing.assert_allclose(
            log_matvec(K, jnp.asarray(h)), logsumexp(L + h, axis=1)
        )
        column, found = row_argmax(K, jnp.asarray(h))
        assert np.array_equal(column, (L + h).argmax(1)) and found.all()

    plan = scaled(kernel, jnp.asarray(f), jnp.asarray(g))
    weights = np.exp(f[:, None] + log_k + g)
    for values in (rng.normal(size=N_Y), rng.normal(size=(N_Y, 2))):
        truth = weights @ values
        # XLA flushes what is below the normal numbers to 0.
        close(matvec(plan, jnp.asarray(values)), truth)
    close(matvec(transpose_plan(plan), jnp.ones(N_X)), weights.T @ np.ones(N_X))


def test_the_transpose_is_the_dense_transpose():
    kernel = build(*near(*draw(1)), sharp(2), sharp(3))
    assert np.array_equal(dense(transpose(kernel)), dense(kernel).T)
    again = transpose(transpose(kernel))
    assert jax.tree.all(jax.tree.map(jnp.array_equal, kernel, again))
    f, g = jnp.arange(N_X) / 10, jnp.arange(N_Y) / 10
    plan, flipped = scaled(kernel, f, g), scaled(transpose(kernel), g, f)
    assert jax.tree.all(jax.tree.map(jnp.array_equal, transpose_plan(plan), flipped))


def test_ties_go_to_the_lowest_column():
    # Row 0 finds column 2 itself; columns 1 and 3 ask for row 0 with the same weight.
    kernel = Kernel(
        jnp.array([[2]]),
        jnp.array([[-1.0]]),
        jnp.zeros((4, 1), int),
        jnp.array([[-2.0], [-1.0], [-jnp.inf], [-1.0]]),
    )
    assert row_argmax(kernel, jnp.zeros(4)) == (1, True)


def test_an_empty_row():
    absent = jnp.full((2, 1), -jnp.inf)
    kernel = Kernel(
        jnp.array([[1], [0]]),
        absent.at[0].set(0),
        jnp.zeros((3, 1), int),
        jnp.full((3, 1), -jnp.inf),
    )
    assert np.array_equal(log_matvec(kernel, jnp.zeros(3)), [0, -np.inf])
    column, found = row_argmax(kernel, jnp.zeros(3))
    assert np.array_equal(column, [1, 0]) and np.array_equal(found, [True, False])


def test_no_overflow_and_no_underflow_in_float32():
    pair = [np.float32(emb) for emb in draw(2)]
    lam = jnp.float32(1e4)
    kernel = build(*near(*pair), lam, lam)
    assert kernel.log_xy.dtype == jnp.float32
    for shift in (-1e4, 1e4):
        total = log_matvec(kernel, jnp.full(N_Y, shift, jnp.float32))
        exact = logsumexp(dense(kernel), axis=1) + shift
        np.testing.assert_allclose(total, exact, rtol=1e-5)
    assert not jnp.exp(kernel.log_xy.min()) > 0  # it would have underflowed


def test_gradients_with_padding():
    there, back = near(*draw(3))
    there = there._replace(dist=there.dist.at[4].set(jnp.inf))
    back = back._replace(dist=back.dist.at[:, 3:].set(jnp.inf))

    def total(lam, dist):
        kernel = build(there._replace(dist=dist), back, lam, lam)
        found = log_matvec(kernel, jnp.zeros(N_Y))
        return jnp.sum(jnp.where(jnp.isfinite(found), found, 0))

    slope, step = jax.grad(total, (0, 1))(sharp(2), there.dist)
    assert jnp.isfinite(slope) and jnp.isfinite(step).all() and not step[4].any()
    h = 1e-6
    gap = total(sharp(2 + h), there.dist) - total(sharp(2 - h), there.dist)
    assert np.isclose(gap / (2 * h), slope)


def test_vmap_equals_the_loop():
    kernels = [build(*near(*draw(seed)), sharp(4), sharp(5)) for seed in (0, 1)]
    g = jnp.asarray(np.random.default_rng(0).normal(size=(2, N_Y)))
    batch = testing.stack(kernels)
    products = lambda K, h: matvec(scaled(K, jnp.zeros(N_X), h), h)
    for run in (products, log_matvec, lambda K, h: row_argmax(K, h)[0]):
        for i in range(2):
            single = run(kernels[i], g[i])
            np.testing.assert_allclose(jax.vmap(run)(batch, g)[i], single, rtol=1e-12)


def test_the_derivative_has_no_nan_on_the_way_where_entries_are_absent():
    emb_x, emb_y = np.random.default_rng(0).normal(size=(2, N_X, WIDTH))
    there, back = near(emb_x, emb_y, jnp.arange(N_X) < 3, jnp.arange(N_X) < 3)

    def value(dist):
        kernel = kernels.build(there._replace(dist=dist), back, *jnp.ones(2))
        return jnp.where(jnp.isfinite(kernel.log_xy), kernel.log_xy, 0).sum()

    with jax.debug_nans(True):
        assert np.isfinite(jax.grad(value)(there.dist)).all()
