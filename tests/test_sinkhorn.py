"""The filter against dense Sinkhorn, the authors' arithmetic, and POT."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from precisions import FLOATS
from problems import FULL, K0, N_X, N_Y, NUM, WIDTH, dense, draw, filtered, weights

from jfsf import testing
from jfsf.convert import (
    algorithm_2,
    authors_sinkhorn,
    nearest,
    plan,
    pull_back,
    sinkhorn,
)
from jfsf.convert._kernel import length
from jfsf.convert._scaling import plan_entries, scale_kernel
from jfsf.convert._variants import quick_sinkhorn
from jfsf.mesh import read
from jfsf.refine import zoomout
from jfsf.spectral import embeddings, functional_map, spectrum, truncate
from jfsf.spectral._laplacian import operators
from jfsf.types import Kernel, Neighbours

pairs = testing.embedding_pairs(N_X, N_Y, WIDTH)
OTHER = {"scale": "max", "unilateral_weight": 0.5}  # one more program


def truth_for(emb_x, emb_y, a, b, relax, *, lam, k0, scale, unilateral_weight=1.0):
    """The dense log plan and marginal gap, from the definitions."""
    k0 = min(k0, N_X)
    near = [oracles.neighbours(*e, k0) for e in ((emb_x, emb_y), (emb_y, emb_x))]
    if scale == "max":
        lengths = [dist.max() for _, dist in near]
    else:
        one = np.sqrt(np.prod([np.median(dist[:, 0]) for _, dist in near]))
        lengths = [one, one]
    log_k = oracles.log_kernel(
        *near, lam / lengths[0], lam / lengths[1], unilateral_weight=unilateral_weight
    )
    return oracles.sinkhorn(log_k, a, b, NUM, relax)


def check_maps(filtered, log_plan, tol=1e-9):
    """Both maps are an argmax of the plan, ties aside."""
    T_xy, T_yx = np.asarray(filtered.T_xy), np.asarray(filtered.T_yx)
    rows, columns = np.arange(len(T_xy)), np.arange(len(T_yx))
    assert (log_plan[rows, T_xy] >= log_plan.max(1) - tol).all()
    assert (log_plan[T_yx, columns] >= log_plan.max(0) - tol).all()


@pytest.mark.parametrize(
    "options",
    [
        {"lam": 5.0},
        {"lam": 5.0, "k0": FULL},
        {"lam": 30.0, **OTHER},
        pytest.param({"lam": 30.0, "k0": FULL, **OTHER}, marks=pytest.mark.slow),
    ],
)
@given(pair=pairs, seed=testing.seeds, relax=st.sampled_from([1.0, 1.7]))
def test_the_dense_oracle_agrees(options, pair, seed, relax):
    a, b = weights(seed, N_X), weights(seed + 1, N_Y)
    ours = filtered(*map(jnp.asarray, pair), a, b, relax=relax, **options)
    f, g, log_plan, gap = truth_for(
        *(*pair, a, b, relax), **({"k0": K0, "scale": "nearest"} | options)
    )
    check_maps(ours, log_plan)
    np.testing.assert_allclose(ours.f, f, atol=1e-8)
    np.testing.assert_allclose(ours.g, g, atol=1e-8)
    np.testing.assert_allclose(ours.marginal_error, gap, atol=1e-10)
    np.testing.assert_allclose(dense(ours), np.exp(log_plan), atol=1e-12)
    assert ours.empty_x == ours.empty_y == 0


def test_pot_agrees():
    ot = pytest.importorskip("ot")
    emb_x, emb_y = draw(n_x=N_X, n_y=N_Y)
    a, b = weights(0, N_X), weights(1, N_Y)
    ours = filtered(emb_x, emb_y, a, b, lam=1.0, k0=FULL, num_iters=500)
    cost = np.linalg.norm(np.asarray(emb_x)[:, None] - np.asarray(emb_y)[None], axis=2)
    unit = np.sqrt(np.median(cost.min(0)) * np.median(cost.min(1)))
    theirs = ot.sinkhorn(
        np.asarray(a),
        np.asarray(b),
        cost,
        unit,
        numItermax=500,
        stopThr=0,
        warn=False,
    )
    np.testing.assert_allclose(dense(ours), theirs, atol=1e-10)


@pytest.mark.parametrize("dtype", FLOATS)
@given(seed=st.integers(0, 50))
def test_the_authors_settings(dtype, seed):
    emb_x, emb_y = (np.asarray(e, np.float64) for e in draw(seed, 60, 80, dtype))
    *_, truth = oracles.authors_filter(emb_x, emb_y, 10, 500.0, 11)
    embs = jnp.asarray(emb_x, dtype), jnp.asarray(emb_y, dtype)
    ours = authors_sinkhorn(*embs, k0=10)
    # Columns that receive all mass of several rows tie, up to rounding.
    tol = 1e-8 if dtype == jnp.float64 else 2e-2
    with np.errstate(divide="ignore"):
        check_maps(ours, np.log(truth), tol)
    np.testing.assert_allclose(dense(ours), truth, atol=tol / 10)


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("lam", [0.0, 1e-3, 1e3, 1e4, 1e6])
def test_no_sharpness_makes_nan(dtype, lam):
    emb_x, emb_y = draw(dtype=dtype)
    ours = filtered(emb_x, emb_y, lam=lam)
    for value in (ours.f, ours.g, ours.marginal_error, *plan_entries(ours)):
        assert np.isfinite(value).all()
    assert ours.f.dtype == ours.marginal_error.dtype == dtype
    assert ours.marginal_error < 2.001 and ours.empty_x == 0
    if lam > 1e4:
        return  # float32 has no digits left of a log weight of -1e6
    # The rows were scaled last.
    np.testing.assert_allclose(dense(ours).sum(1), 1 / N_X, rtol=1e-2)


@pytest.mark.parametrize("dtype", FLOATS)
def test_marginals_far_apart_make_no_nan(dtype):
    emb_x, emb_y = draw(dtype=dtype)
    a = np.geomspace(1e-9, 1, N_X)
    a = jnp.asarray(a / a.sum(), dtype)
    ours = filtered(emb_x, emb_y, a, None, lam=300.0)
    assert all(
        np.isfinite(value).all() for value in (ours.f, ours.g, *plan_entries(ours))
    )


@given(pairs, testing.seeds)
def test_sums_match_to_the_reported_residual(pair, seed):
    a, b = weights(seed, N_X, 0.01), weights(seed + 1, N_Y, 0.01)
    ours = filtered(*map(jnp.asarray, pair), a, b)
    weight = dense(ours)
    gap = np.abs(weight.sum(1) - a).sum() + np.abs(weight.sum(0) - b).sum()
    np.testing.assert_allclose(ours.marginal_error, gap, atol=1e-12)
    np.testing.assert_allclose(weight.sum(1), a, rtol=1e-9)


def test_more_updates_lower_the_residual():
    emb_x, emb_y = draw()
    run = lambda num: filtered(emb_x, emb_y, k0=FULL, lam=0.5, num_iters=num)
    gaps = [float(run(num).marginal_error) for num in (1, NUM, 500)]
    assert gaps == sorted(gaps, reverse=True) and gaps[-1] < 1e-3


@given(pairs, testing.permutations(N_X), testing.permutations(N_Y), testing.seeds)
def test_relabelling_relabels(pair, order_x, order_y, seed):
    emb_x, emb_y = map(jnp.asarray, pair)
    a, b = weights(seed, N_X), weights(seed + 1, N_Y)
    plain = filtered(emb_x, emb_y, a, b)
    moved = filtered(emb_x[order_x], emb_y[order_y], a[order_x], b[order_y])
    weight = dense(plain)[order_x][:, order_y]
    np.testing.assert_allclose(dense(moved), weight, rtol=1e-6, atol=1e-12)
    with np.errstate(divide="ignore"):
        check_maps(moved, np.log(weight))


@pytest.mark.parametrize("options", [{}, OTHER])
@given(pair=pairs, seed=testing.seeds, unit=st.sampled_from([1e-6, 0.3, 1e5]))
def test_rigid_motion_and_scaling_change_nothing(options, pair, seed, unit):
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(WIDTH, WIDTH)))[0]
    moved = [unit * (e @ turn + 3.0) for e in pair]
    plain, other = (filtered(*map(jnp.asarray, p), **options) for p in (pair, moved))
    np.testing.assert_allclose(dense(other), dense(plain), rtol=1e-5, atol=1e-9)
    with np.errstate(divide="ignore"):
        check_maps(other, np.log(dense(plain)), tol=1e-6)


@given(pairs, testing.seeds)
def test_padding_is_invisible(pair, seed):
    emb_x, emb_y = map(jnp.asarray, pair)
    a, b = weights(seed, N_X), weights(seed + 1, N_Y)
    plain = filtered(emb_x, emb_y, a, b)
    # Padding anywhere, holding anything finite.
    rng = np.random.default_rng(seed)
    at_x = np.sort(rng.choice(N_X + 4, N_X, replace=False))
    at_y = np.sort(rng.choice(N_Y + 6, N_Y, replace=False))
    wide = [jnp.asarray(rng.normal(size=(n, WIDTH))) for n in (N_X + 4, N_Y + 6)]
    padded = filtered(
        wide[0].at[at_x].set(emb_x),
        wide[1].at[at_y].set(emb_y),
        jnp.zeros(N_X + 4).at[at_x].set(a),
        jnp.zeros(N_Y + 6).at[at_y].set(b),
    )
    weight = dense(padded)
    np.testing.assert_allclose(weight[np.ix_(at_x, at_y)], dense(plain), rtol=1e-9)
    assert np.isclose(weight.sum(), 1)
    assert np.array_equal(padded.T_xy[at_x], at_y[plain.T_xy])
    assert np.array_equal(padded.T_yx[at_y], at_x[plain.T_yx])
    for value, at in ((padded.f, at_x), (padded.g, at_y)):
        assert not np.delete(value, at).any()
    np.testing.assert_allclose(padded.marginal_error, plain.marginal_error, atol=1e-12)
    assert padded.empty_x == padded.empty_y == 0


@pytest.mark.slow
@given(order=testing.permutations(N_X), seed=testing.seeds)
def test_coincident_embeddings_give_the_permutation(order, seed):
    emb_x = draw(seed % 50)[0]
    ours = filtered(emb_x, emb_x[order])
    assert np.array_equal(np.asarray(order)[ours.T_xy], np.arange(N_X))
    assert np.array_equal(ours.T_yx, order)
    assert np.isfinite(ours.marginal_error)


def test_many_coincident_points_give_the_permutation():
    # Enough for bins of several points in the search for neighbours; and in float32.
    rng = np.random.default_rng(0)
    emb_x, order = rng.normal(size=(1500, 6)).astype(np.float32), rng.permutation(1500)
    ours = sinkhorn(jnp.asarray(emb_x), jnp.asarray(emb_x[order]))
    assert np.array_equal(order[ours.T_xy], np.arange(1500))
    assert np.array_equal(ours.T_yx, order)


def test_all_points_in_one_place():
    ours = filtered(jnp.zeros((N_X, WIDTH)), jnp.zeros((N_Y, WIDTH)))
    assert np.isfinite(ours.f).all() and np.isfinite(ours.marginal_error)


def test_float32_agrees_but_for_near_ties():
    differ = []
    for seed in range(30):
        # With equal masses, exact ties are common.
        args = *draw(seed), weights(seed, N_X), weights(seed + 1, N_Y)
        high, low = (
            filtered(*(a.astype(t) for a in args)) for t in (jnp.float64, jnp.float32)
        )
        assert low.f.dtype == jnp.float32
        with np.errstate(divide="ignore"):
            check_maps(low, np.log(dense(high)), tol=2e-2)
        differ.append(np.asarray(low.T_xy) != np.asarray(high.T_xy))
    assert np.mean(differ) < 0.01


def test_vmap_equals_the_loop():
    batch = [jnp.stack(e) for e in zip(*(draw(s) for s in range(3)), strict=True)]
    lam = jnp.asarray([10.0, 80.0, 300.0])
    run = lambda x, y, l: filtered(x, y, lam=l)
    found = jax.vmap(run)(*batch, lam)
    for i in range(3):
        single = run(batch[0][i], batch[1][i], float(lam[i]))
        assert np.array_equal(found.T_xy[i], single.T_xy)
        assert np.array_equal(found.T_yx[i], single.T_yx)
        np.testing.assert_allclose(found.f[i], single.f, rtol=1e-9)
        np.testing.assert_allclose(found.marginal_error[i], single.marginal_error)


@pytest.mark.parametrize("dtype", FLOATS)
def test_the_length_is_the_median_of_the_nearest(dtype):
    rng = np.random.default_rng(0)
    for n in (1, 2, 7, 100):
        dist = np.sort(1 + rng.random((n, 3)).astype(dtype), 1)
        dist[rng.random(n) < 0.3] = np.inf
        known = np.sort(dist[np.isfinite(dist[:, 0]), 0])
        near = Neighbours(jnp.zeros((n, 3), int), jnp.asarray(dist))
        found = length(near, "nearest")
        # The lower one where two are in the middle; 1 where there is none.
        want = known[(len(known) - 1) // 2] if len(known) else 1
        assert found == want and found.dtype == dtype


def test_it_is_more_bijective_than_nearest_neighbour():
    emb_x, emb_y = draw(n_x=400, n_y=400)
    ours, plain = sinkhorn(emb_x, emb_y, k0=10, num_iters=NUM), nearest(emb_x, emb_y)
    hit = [len(np.unique(np.asarray(m.T_xy))) for m in (ours, plain)]
    assert hit[0] > 1.15 * hit[1]


def test_the_plan_has_the_entries_that_are_listed():
    ours = filtered(*draw())
    found, (_, _, values) = plan(ours), plan_entries(ours)
    halves = found.weight_xy.ravel(), found.weight_yx.ravel()
    np.testing.assert_array_equal(jnp.concatenate(halves), values)
    assert np.array_equal(found.idx_xy, ours.kernel.idx_xy)
    np.testing.assert_allclose(found.weight_xy.sum() + found.weight_yx.sum(), 1)


@pytest.mark.slow
def test_the_quick_filter_is_the_filter_with_other_settings():
    emb_x, emb_y = draw(n_x=60, n_y=80)
    options = {"k0": 10, "lam": 80.0, "num_iters": 8, "relax": 1.0}
    # Which has uniform marginals where none are given.
    plain, quick = filtered(emb_x, emb_y, **options), quick_sinkhorn(emb_x, emb_y)
    assert np.array_equal(quick.T_xy, plain.T_xy)
    np.testing.assert_allclose(quick.f, plain.f, atol=1e-12)


def test_pull_back_is_the_average_under_the_plan():
    ours = filtered(*draw())
    values = jnp.asarray(np.random.default_rng(0).normal(size=(N_Y, 2)))
    weight = dense(ours)
    truth = weight @ values / weight.sum(1, keepdims=True)
    np.testing.assert_allclose(pull_back(ours, values), truth)
    np.testing.assert_allclose(pull_back(ours, jnp.ones((N_Y, 1))), 1)


@pytest.mark.parametrize(
    "scale, masked",
    [pytest.param("nearest", False, marks=pytest.mark.slow), ("max", True)],
)
def test_gradients_match_finite_differences(scale, masked):
    emb_x, emb_y = draw()
    rng = np.random.default_rng(0)
    values = jnp.asarray(rng.normal(size=(N_Y, 2)))
    a = weights(0, N_X).at[3].set(0) if masked else weights(0, N_X)
    a = a / a.sum()
    b = jnp.zeros(N_Y).at[:3].set(1 / 3) if masked else weights(1, N_Y)

    # The length scale is held fixed in the derivative: differ along with it.
    def value(x, y, lam):
        found = filtered(x, y, a, b, lam=lam, scale=scale)
        f = jnp.where(a > 0, found.f, 0)
        return jnp.sum(jnp.sin(pull_back(found, values))) + f.sum() / 10

    def length_of(x, y):
        found = filtered(x, y, a, b, lam=1.0, scale=scale)
        # log K of one sure entry over its distance: the sharpness in use.
        at = 0, int(found.kernel.idx_xy[0, 0])
        return -jnp.linalg.norm(x[0] - y[at[1]]) / found.kernel.log_xy[0, 0]

    steps = [jnp.asarray(rng.normal(size=e.shape)) for e in (emb_x, emb_y)]
    lam, h = 5.0, 1e-6
    slopes = jax.grad(value, (0, 1, 2))(emb_x, emb_y, lam)
    assert all(np.isfinite(s).all() for s in slopes)
    if masked:
        assert not slopes[0][3].any() and not slopes[1][3:].any()
    gap = value(emb_x, emb_y, lam + h) - value(emb_x, emb_y, lam - h)
    assert np.isclose(gap / (2 * h), slopes[2], rtol=1e-5)
    if scale == "max":
        return  # one length a direction: no single factor on lam undoes the change
    out = []
    for sign in (1, -1):
        x, y = (e + sign * h * d for e, d in zip((emb_x, emb_y), steps, strict=True))
        out.append(value(x, y, lam * length_of(x, y) / length_of(emb_x, emb_y)))
    exact = sum(jnp.sum(s * d) for s, d in zip(slopes, steps, strict=False))
    assert np.isclose((out[0] - out[1]) / (2 * h), exact, rtol=1e-4)


@pytest.mark.slow
def test_the_gradient_where_points_coincide_is_finite():
    emb = draw()[0]
    value = lambda x: jnp.sum(pull_back(filtered(x, emb), emb) ** 2)
    assert np.isfinite(jax.grad(value)(emb)).all()


def test_no_mass_reaches_an_empty_row():
    inf = -jnp.inf
    kernel = Kernel(
        jnp.array([[1], [0], [0]]),
        jnp.array([[0.0], [inf], [-1.0]]),
        jnp.zeros((4, 1), jnp.int32),
        jnp.full((4, 1), inf),
    )
    found = scale_kernel(kernel, jnp.full(3, 1 / 3), jnp.full(4, 0.25), num_iters=9)
    assert found.empty_x == 1 and found.empty_y == 2
    assert np.isfinite(found.f).all() and np.isfinite(found.g).all()
    # A third of X and half of Y is out of reach; the rest is off by what is in reach.
    np.testing.assert_allclose(found.marginal_error, 1 / 3 + 1 / 2 + 2 / 12)
    assert not pull_back(found, jnp.ones((4, 1)))[1].any()


def test_a_point_that_is_not_finite_is_counted_and_harms_no_other():
    emb_x, emb_y = draw()
    found = filtered(emb_x.at[4].set(jnp.nan), emb_y)
    assert found.empty_x == 1 and found.empty_y == 0
    assert np.isfinite(found.f).all() and not (found.T_yx == 4).any()


@jax.jit
def traced(values):
    return filtered(*draw(), **values)


@pytest.mark.parametrize(
    "wrong",
    [
        {"lam": -1.0},
        {"lam": np.nan},
        {"relax": 2.0},
        {"relax": -0.5},
        {"reach": -1.0},
        {"reach": 0.0},
        {"marginal_x": np.r_[-0.5, 1.5, np.zeros(N_X - 2)]},
    ],
)
def test_traced_values_out_of_range_are_told_by_the_marginal_error(wrong):
    right = {"lam": 120.0, "relax": 1.7, "reach": 3.0}
    right |= {"marginal_x": weights(0, N_X)}
    found = traced(jax.tree.map(jnp.asarray, right | wrong))
    assert np.isnan(found.marginal_error) and not found.converged
    assert np.isnan(found.membership_x).all() or "reach" not in wrong
    assert (found.T_xy < N_Y).all() and (found.T_yx < N_X).all()


@pytest.mark.parametrize("lam", [-1.0, np.nan])
def test_so_are_those_of_algorithm_2(lam):
    run = lambda value: algorithm_2(*draw(), lam=value, k0=4, num_iters=3)
    found = jax.jit(run)(jnp.asarray(lam))
    assert np.isnan(found.marginal_error) and not found.converged


@pytest.mark.parametrize("wrong", [{"relax": 2.5}, {"marginal_y": -np.ones(N_Y)}])
def test_so_are_those_of_scale_kernel(wrong):
    found = filtered(*draw())
    given = {"marginal_x": np.full(N_X, 1 / N_X), "marginal_y": np.full(N_Y, 1 / N_Y)}
    run = lambda values: scale_kernel(found.kernel, num_iters=3, **values)
    found = jax.jit(run)(jax.tree.map(jnp.asarray, given | wrong))
    assert np.isnan(found.marginal_error) and not found.converged


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("power", [1.0, 2.0])
def test_the_unit_of_the_embeddings_changes_nothing(dtype, power):
    # Squares of the largest and the smallest leave the range of the type.
    emb_x, emb_y = (e.astype(dtype) for e in draw())
    far = jnp.finfo(dtype).maxexp - 4
    plain = filtered(emb_x, emb_y, power=power)
    for exponent in (far, 30 - far):
        unit = jnp.ldexp(jnp.ones((), dtype), exponent)
        found = filtered(emb_x * unit, emb_y * unit, power=power)
        assert jnp.array_equal(found.T_xy, plain.T_xy)
        assert jnp.array_equal(found.T_yx, plain.T_yx)
        np.testing.assert_allclose(found.f, plain.f, rtol=1e-4)


def test_k0_beyond_the_points_is_all_of_them():
    more, full = (sinkhorn.lower(*draw(), k0=k).as_text() for k in (1000, FULL))
    assert more == full


@pytest.mark.parametrize(
    "options, message",
    [
        ({"k0": 0}, "k0 is 0; give a whole number, 1 or more"),
        ({"k0": 2.5}, "k0 is 2.5; give a whole number"),
        ({"num_iters": 0}, "num_iters is 0; give a whole number"),
        ({"lam": -1.0}, "lam is -1.0; give 0 or more"),
        ({"lam": np.float32(np.nan)}, "lam is nan; give 0 or more"),
        ({"relax": 2}, "relax is 2; give more than 0 and less than 2"),
        ({"relax": jnp.zeros(())}, "relax is 0.0; give more than 0"),
        ({"reach": 0}, "reach is 0; give more than 0"),
        ({"tol": 0.0}, "tol is 0.0; give more than 0"),
        ({"power": -1.0}, "power is -1.0 .* more than 0"),
        ({"unilateral_weight": -0.5}, "power is 1.0 and unilateral_weight -0.5; give"),
        ({"marginal_x": jnp.ones(4)}, "marginal_x sums to 4.0; divide it by its sum"),
        (
            {"marginal_y": np.array([2, -1, 0, 0, 0.0])},
            "marginal_y has -1.0; give masses of 0 or more",
        ),
        (
            {"emb_x": jnp.ones((0, 3))},
            r"emb_x has shape \(0, 3\); give one row a point",
        ),
        ({"emb_x": jnp.ones(4)}, r"emb_x has shape \(4,\); give one row a point"),
        ({"emb_y": jnp.ones((5, 3), int)}, "emb_y is int.*; give floating numbers"),
        ({"scale": "mean"}, "scale is 'nearest' or 'max', not 'mean'"),
        ({"emb_y": jnp.ones((5, 2))}, "emb_x has 3 columns, emb_y has 2"),
        ({"marginal_x": jnp.ones(5)}, r"marginal_x has shape \(5,\), emb_x has 4 rows"),
        ({"marginal_y": jnp.ones(4)}, r"marginal_y has shape \(4,\), emb_y has 5 rows"),
    ],
)
def test_errors(options, message):
    good = {"emb_x": jnp.ones((4, 3)), "emb_y": jnp.ones((5, 3))}
    with pytest.raises(ValueError, match="sinkhorn: " + message):
        sinkhorn(**(good | options))


CONVERSION = {  # k: nearest neighbour's and the filter's (error, bijectivity)
    10: ((0.04126, 0.03519), (0.03424, 0.01193)),
    20: ((0.02338, 0.02298), (0.01732, 0.00665)),
    30: ((0.0216, 0.01993), (0.0134, 0.00522)),
    40: ((0.01504, 0.01445), (0.00856, 0.00347)),
    50: ((0.01186, 0.01105), (0.0066, 0.00243)),
    60: ((0.00849, 0.00825), (0.00399, 0.00163)),
    70: ((0.00676, 0.00737), (0.00318, 0.0015)),
    80: ((0.00521, 0.00513), (0.00224, 0.00096)),
    90: ((0.0039, 0.00356), (0.00173, 0.0007)),
    100: ((0.00238, 0.00244), (0.00127, 0.00054)),
}
REFINEMENT = (0.01739, 0.00727), (0.0127, 0.00155)  # ZoomOut, likewise


@pytest.mark.slow
@pytest.mark.parametrize("dtype", FLOATS)
def test_the_authors_numbers(dtype):
    """Their code on their pair; errors are Euclidean / sqrt(area), as they measure."""
    at = Path(os.environ.get("JFSF_DATA", "")) / "authors_pair"
    if not at.is_dir():
        pytest.skip("the authors' pair is not here: set JFSF_DATA")
    meshes = [read(at / f"Man{i}.off") for i in (0, 1)]
    spectra = [spectrum(m, 100, laplacian="cotan", cache=False) for m in meshes]
    spec_x, spec_y = (
        # They pull back by least squares without weights.
        testing.cast(s._replace(mass=np.full(6890, 1 / 6890)), dtype)
        for s in spectra
    )
    roots = [np.sqrt(operators(m, laplacian="cotan")[1].sum()) for m in meshes]

    def check(maps, truth, rtol):
        T_xy, T_yx = np.asarray(maps.T_xy), np.asarray(maps.T_yx)
        (x, _), (y, _) = meshes
        error = np.linalg.norm(y[T_xy] - y, axis=1).mean() / roots[1]
        there_and_back = np.linalg.norm(x[T_yx[T_xy]] - x, axis=1).mean() / roots[0]
        np.testing.assert_allclose((error, there_and_back), truth, rtol=rtol)

    identity = jnp.arange(6890, dtype=jnp.int32)
    for k, rows in CONVERSION.items():
        C = functional_map(identity, truncate(spec_x, k), truncate(spec_y, k))
        emb = embeddings(C, spec_x.evecs, spec_y.evecs)
        for converter, truth in zip((nearest, authors_sinkhorn), rows, strict=True):
            check(converter(*emb), truth, 0.01)

    rough = np.loadtxt(at / "Man0_Man1.map", int) - 1
    C = functional_map(
        jnp.asarray(rough, jnp.int32), truncate(spec_x, 20), truncate(spec_y, 20)
    )
    ks = (20, 36, 52, 68, 84, 100)
    for converter, truth in zip((nearest, authors_sinkhorn), REFINEMENT, strict=True):
        found = zoomout(spec_x, spec_y, C, ks=ks, converter=converter)
        emb = embeddings(found, spec_x.evecs, spec_y.evecs, space="direct")
        check(converter(*emb), truth, 0.03)
