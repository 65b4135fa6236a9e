"""The unbalanced filter against dense updates, its objective, POT, and the filter."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from precisions import FLOATS
from problems import FULL, K0, N_X, N_Y, WIDTH, dense, draw, filtered, weights
from scipy.spatial.distance import cdist
from scipy.special import rel_entr

from jfsf import testing
from jfsf.convert import maps_of, pull_back, sinkhorn
from jfsf.convert._scaling import plan_entries, scale_kernel
from jfsf.refine import icp
from jfsf.spectral import functional_map
from jfsf.types import Kernel

pairs = testing.embedding_pairs(N_X, N_Y, WIDTH)
unbalanced = partial(sinkhorn, reach=3.0)
small = partial(filtered, reach=3.0)


def cost_of(emb_x, emb_y):
    """Distances, in units of the filter's length."""
    cost = cdist(np.asarray(emb_x, float), np.asarray(emb_y, float))
    lower = lambda nearest: np.sort(nearest)[(len(nearest) - 1) // 2]
    return cost / np.sqrt(lower(cost.min(0)) * lower(cost.min(1)))


def log_kernel(emb_x, emb_y, lam, k0):
    near = [oracles.neighbours(*e, k0) for e in ((emb_x, emb_y), (emb_y, emb_x))]
    unit = np.sqrt(np.prod([np.median(dist[:, 0]) for _, dist in near]))
    return oracles.log_kernel(*near, lam / unit, lam / unit)


@pytest.mark.parametrize(
    "k0, options",
    [
        (FULL, {"tol": 1e-11}),
        (K0, {"num_iters": 400}),
        pytest.param(K0, {"tol": 1e-11}, marks=pytest.mark.slow),
        pytest.param(FULL, {"num_iters": 400}, marks=pytest.mark.slow),
    ],
)
@given(pair=pairs, seed=testing.seeds, total=st.sampled_from([0.4, 1.0, 3.0]))
@settings(max_examples=6)
def test_the_dense_oracle_agrees(k0, options, pair, seed, total):
    a, b, lam, reach = weights(seed, N_X), weights(seed + 1, N_Y, total=total), 8.0, 1.5
    ours = filtered(
        *map(jnp.asarray, pair), a, b, lam=lam, reach=reach, k0=k0, **options
    )
    log_k = log_kernel(*pair, lam, min(k0, N_X))
    a, b = np.asarray(a), np.asarray(b)
    f, g, plan = oracles.unbalanced(log_k, a, b, 1 / (lam * reach), 1500)
    np.testing.assert_allclose(dense(ours), plan, atol=1e-10)
    np.testing.assert_allclose(ours.f, f, atol=1e-7)
    np.testing.assert_allclose(ours.g, g, atol=1e-7)
    assert ours.converged and ours.marginal_error < 1e-9
    kept = np.minimum(plan.sum(1) / a, 1), np.minimum(plan.sum(0) / b, 1)
    np.testing.assert_allclose(ours.membership_x, kept[0], atol=1e-8)
    np.testing.assert_allclose(ours.membership_y, kept[1], atol=1e-8)
    rows, columns = np.arange(N_X), np.arange(N_Y)
    assert (plan[rows, ours.T_xy] >= plan.max(1) * (1 - 1e-7)).all()
    assert (plan[ours.T_yx, columns] >= plan.max(0) * (1 - 1e-7)).all()


@pytest.mark.parametrize("num", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_the_first_updates_are_those_of_the_oracle(num):
    emb_x, emb_y = draw()
    a, b = weights(0, N_X), weights(1, N_Y)
    ours = unbalanced(
        emb_x, emb_y, a, b, lam=5.0, reach=2.0, k0=FULL, num_iters=num, relax=1.0
    )
    log_k = log_kernel(emb_x, emb_y, 5.0, N_X)
    f, g, _ = oracles.unbalanced(log_k, a, b, 0.1, 1)
    if num == 2:
        # Both sides' targets are brought to one sum by a shift, then updated once.
        sums = [np.sum(m * (m / np.exp(h)) ** 0.1) for m, h in ((a, f), (b, g))]
        f = f + np.log(sums[0] / sums[1]) / 0.2
        g = np.log(b) - np.log(np.exp(log_k + f[:, None]).sum(0)) / 1.1
        f = np.log(a) - np.log(np.exp(log_k + g).sum(1)) / 1.1
    np.testing.assert_allclose(ours.f, f, atol=1e-9)
    np.testing.assert_allclose(ours.g, g, atol=1e-9)


def test_the_plan_is_the_least_of_the_objective():
    emb_x, emb_y = draw()
    a, b = np.asarray(weights(0, N_X)), np.asarray(weights(1, N_Y, total=0.7))
    lam, reach = 6.0, 1.2
    plan = dense(
        unbalanced(
            emb_x, emb_y, *map(jnp.asarray, (a, b)), lam=lam, reach=reach, k0=FULL,
            tol=1e-12, power=2.0,
        )
    )  # fmt: skip
    cost = cost_of(emb_x, emb_y) ** 2
    divergence = lambda p, q: np.sum(rel_entr(p, q) - p + q)

    def objective(p):
        sides = divergence(p.sum(1), a) + divergence(p.sum(0), b)
        return np.sum(p * cost) + divergence(p, np.outer(a, b)) / lam + reach**2 * sides

    rng, least = np.random.default_rng(0), objective(plan)
    for size in (1e-3, 1e-2, 0.1):
        for _ in range(20):
            other = plan * np.exp(size * rng.normal(size=plan.shape))
            assert objective(other) > least
            assert objective(plan * np.exp(size * rng.normal())) > least


@pytest.mark.parametrize("total", [1.0, 0.5])
def test_pot_agrees(total):
    ot = pytest.importorskip("ot")
    emb_x, emb_y = draw()
    a, b = weights(0, N_X), weights(1, N_Y, total=total)
    ours = small(emb_x, emb_y, a, b, lam=2.0, k0=FULL, tol=1e-10)
    theirs = ot.unbalanced.sinkhorn_unbalanced(
        *map(np.asarray, (a, b)), cost_of(emb_x, emb_y), 0.5, 3.0, reg_type="kl",
        numItermax=5000, stopThr=1e-14,
    )  # fmt: skip
    np.testing.assert_allclose(dense(ours), theirs, atol=1e-8)


@pytest.mark.parametrize("reach", [jnp.inf, 1e12])
@pytest.mark.parametrize(
    "options", [{}, pytest.param({"tol": 1e-6, "k0": FULL}, marks=pytest.mark.slow)]
)
@given(pair=pairs, seed=testing.seeds)
@settings(max_examples=8)
def test_without_limit_it_is_the_filter(reach, options, pair, seed):
    pair = map(jnp.asarray, pair)
    args = *pair, weights(seed, N_X), weights(seed + 1, N_Y)
    options = {"lam": 20.0} | options
    plain, ours = filtered(*args, **options), small(*args, **options, reach=reach)
    # With a tolerance there is one more update.
    more, gap = (1, 1e-6) if "tol" in options else (0, 1e-9)
    np.testing.assert_allclose(dense(ours), dense(plain), atol=gap)
    assert ours.num_iters == plain.num_iters + more
    np.testing.assert_allclose(ours.marginal_error, plain.marginal_error, atol=gap)
    np.testing.assert_allclose(ours.membership_x, 1, atol=1e-9)


@pytest.mark.parametrize("dtype", FLOATS)
def test_two_points_keep_what_the_formula_says(dtype):
    # Six pairs, far from each other, at one distance; it is the length.
    emb_x = 1e3 * jnp.eye(6, dtype=dtype)
    emb_y = emb_x + 1
    for reach, lam in ((0.3, 120.0), (1.0, 120.0), (3.0, 20.0)):
        found = unbalanced(emb_x, emb_y, k0=1, lam=lam, reach=reach)
        kept = np.exp(-(1 + np.log(6) / lam) / (2 * reach + 1 / lam))
        np.testing.assert_allclose(found.membership_x, kept, rtol=1e-4)
        np.testing.assert_allclose(found.membership_y, kept, rtol=1e-4)


def clusters(dtype=jnp.float64, n=60):
    """X: two clusters; Y: other samples of the first alone."""
    rng = np.random.default_rng(0)
    both = rng.uniform(0, 1, (2 * n, 2)) + np.repeat([[0, 0], [20, 0]], n, 0)
    one = rng.uniform(0, 1, (n, 2))
    return jnp.asarray(both, dtype), jnp.asarray(one, dtype)


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("options", [{}, {"tol": 1e-5}])
def test_mass_without_a_partner_goes_away(dtype, options):
    emb_x, emb_y = clusters(dtype)
    n = len(emb_y)
    same = jnp.full(2 * n, 1 / (2 * n), dtype), jnp.full(n, 1 / (2 * n), dtype)
    run = partial(small, emb_x, emb_y, k0=20, **options)
    found = run(*same)
    assert found.membership_x[:n].mean() > 0.8
    assert found.membership_y.mean() > 0.8
    assert found.membership_x[n:].max() < 1e-3
    assert found.membership_x.max() <= 1 and found.membership_x.min() >= 0
    # The filter sends the mass of the second cluster to Y too.
    assert dense(run(reach=jnp.inf))[n:].sum() > 0.4
    if not options:
        return
    # Masses that each sum to 1: both sides give in, to the geometric mean.
    even = run()
    np.testing.assert_allclose(dense(even).sum(), 0.5**0.5, atol=0.1)
    assert even.membership_x[:n].mean() > 0.9 and even.membership_x[n:].max() < 1e-3
    np.testing.assert_allclose(even.membership_y.mean(), 0.5**0.5, atol=0.1)


@pytest.mark.slow
def test_shapes_exchange():
    emb_x, emb_y = draw()
    a, b = weights(0, N_X), weights(1, N_Y)
    run = partial(unbalanced, k0=K0, tol=1e-11)
    one, other = run(emb_x, emb_y, a, b), run(emb_y, emb_x, b, a)
    np.testing.assert_allclose(dense(one), dense(other).T, atol=1e-9)
    np.testing.assert_allclose(one.membership_x, other.membership_y, atol=1e-7)


@given(pairs, testing.permutations(N_X), testing.permutations(N_Y), testing.seeds)
def test_relabelling_relabels(pair, order_x, order_y, seed):
    emb_x, emb_y = map(jnp.asarray, pair)
    a, b = weights(seed, N_X), weights(seed + 1, N_Y)
    plain = small(emb_x, emb_y, a, b)
    moved = small(emb_x[order_x], emb_y[order_y], a[order_x], b[order_y])
    weight = dense(plain)[order_x][:, order_y]
    np.testing.assert_allclose(dense(moved), weight, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(moved.membership_x, plain.membership_x[order_x])
    np.testing.assert_allclose(moved.membership_y, plain.membership_y[order_y])


@pytest.mark.parametrize("tol", [None, pytest.param(1e-8, marks=pytest.mark.slow)])
@given(pair=pairs, seed=testing.seeds)
@settings(max_examples=10)
def test_padding_is_invisible(tol, pair, seed):
    emb_x, emb_y = map(jnp.asarray, pair)
    a, b = weights(seed, N_X), weights(seed + 1, N_Y)
    plain = small(emb_x, emb_y, a, b, tol=tol)
    rng = np.random.default_rng(seed)
    at_x = np.sort(rng.choice(N_X + 4, N_X, replace=False))
    at_y = np.sort(rng.choice(N_Y + 6, N_Y, replace=False))
    wide = [jnp.asarray(rng.normal(size=(n, WIDTH))) for n in (N_X + 4, N_Y + 6)]
    padded = small(
        wide[0].at[at_x].set(emb_x),
        wide[1].at[at_y].set(emb_y),
        jnp.zeros(N_X + 4).at[at_x].set(a),
        jnp.zeros(N_Y + 6).at[at_y].set(b),
        tol=tol,
    )
    weight = dense(padded)
    np.testing.assert_allclose(weight[np.ix_(at_x, at_y)], dense(plain), atol=1e-9)
    assert np.isclose(weight.sum(), dense(plain).sum())
    assert np.array_equal(padded.T_xy[at_x], at_y[plain.T_xy])
    assert np.array_equal(padded.T_yx[at_y], at_x[plain.T_yx])
    for name, at in (("membership_x", at_x), ("membership_y", at_y)):
        ours = np.asarray(getattr(padded, name))
        np.testing.assert_allclose(ours[at], getattr(plain, name), atol=1e-7)
        assert not np.delete(ours, at).any()
    for value, at in ((padded.f, at_x), (padded.g, at_y)):
        assert not np.delete(value, at).any()


@pytest.mark.slow
def test_vmap_equals_the_loop():
    batch = [jnp.stack(e) for e in zip(*(draw(s) for s in range(3)), strict=True)]
    reach = jnp.asarray([0.5, 3.0, 30.0])
    for tol in (None, 1e-6):
        run = lambda x, y, r, tol=tol: small(x, y, reach=r, tol=tol)
        found = jax.vmap(run)(*batch, reach)
        for i in range(3):
            single = run(batch[0][i], batch[1][i], reach[i])
            assert np.array_equal(found.T_xy[i], single.T_xy)
            assert np.array_equal(found.T_yx[i], single.T_yx)
            np.testing.assert_allclose(found.membership_x[i], single.membership_x)
            np.testing.assert_allclose(found.membership_y[i], single.membership_y)


@pytest.mark.slow
@pytest.mark.parametrize("tol", [None, 1e-5])
def test_float32_is_near_float64(tol):
    emb_x, emb_y = draw(n_x=300, n_y=400)
    a, b = weights(0, 300), weights(1, 400)
    high, low = (
        unbalanced(
            *(e.astype(t) for e in (emb_x, emb_y, a, b)), k0=K0, num_iters=40, tol=tol
        )
        for t in (jnp.float64, jnp.float32)
    )
    assert low.membership_x.dtype == low.f.dtype == jnp.float32
    np.testing.assert_allclose(low.membership_x, high.membership_x, atol=2e-3)
    np.testing.assert_allclose(low.membership_y, high.membership_y, atol=2e-3)
    assert (np.asarray(low.T_xy) != np.asarray(high.T_xy)).mean() < 0.01


@pytest.mark.parametrize("tol", [pytest.param(None, marks=pytest.mark.slow), 1e-3])
@pytest.mark.parametrize("dtype", FLOATS)
@given(
    seed=testing.seeds,
    log_lam=st.floats(-3, 7),
    log_reach=st.floats(-6, 9),
    log_least=st.floats(-20, 0),
)
@settings(max_examples=15)
def test_extremes_are_finite(tol, dtype, seed, log_lam, log_reach, log_least):
    rng = np.random.default_rng(seed)
    emb_x, emb_y = draw(seed % 1000, dtype=dtype)
    masses = [10.0 ** rng.uniform(log_least, 0, n) for n in (N_X, N_Y)]
    masses = [jnp.asarray(m / m.sum(), dtype) for m in masses]
    lam, reach = (jnp.asarray(10.0**p, dtype) for p in (log_lam, log_reach))
    options = {"lam": lam, "reach": reach, "tol": tol, "max_iters": 400}
    found = small(emb_x, emb_y, *masses, **options)
    for leaf in (*found[4:10], *found[11:]):
        assert np.isfinite(leaf).all()
    for member in found[11:]:
        assert (member >= 0).all() and (member <= 1).all()


def value_of(emb_x, emb_y, lam, reach, log_a, log_b, **options):
    """A number made from plan and memberships."""
    found = unbalanced(
        emb_x, emb_y, jnp.exp(log_a), jnp.exp(log_b), lam=lam, reach=reach,
        k0=K0, length_gradient=True, **options,
    )  # fmt: skip
    seen = jnp.sum(jnp.sin(3 * pull_back(found, emb_y)))
    rows, columns, weight = plan_entries(found)
    away = jnp.sum((emb_x[rows] - emb_y[columns]) ** 2, 1)
    kept = jnp.sum(found.membership_x**2) + jnp.sum(found.membership_y**2)
    return seen + kept + 10 * jnp.sum(weight * away)


def arguments(seed):
    numbers = jnp.asarray(4.0), jnp.asarray(1.3)
    logs = jnp.log(weights(seed, N_X)), jnp.log(weights(seed + 1, N_Y, total=0.8))
    return *draw(seed), *numbers, *logs


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"num_iters": 10}, {"tol": 1e-12}])
@pytest.mark.parametrize("seed", [0])
def test_gradients_are_finite_differences(options, seed):
    args, value = arguments(seed), partial(value_of, **options)
    slopes = jax.grad(value, range(6))(*args)
    rng, h = np.random.default_rng(seed), 1e-5
    for i, (arg, slope) in enumerate(zip(args, slopes, strict=True)):
        step = jnp.asarray(rng.normal(size=arg.shape))
        ends = [value(*args[:i], arg + s * h * step, *args[i + 1 :]) for s in (1, -1)]
        exact, found = (ends[0] - ends[1]) / (2 * h), jnp.sum(slope * step)
        np.testing.assert_allclose(found, exact, rtol=2e-5, atol=1e-7, err_msg=str(i))


@pytest.mark.slow
def test_gradients_without_limit_are_those_of_the_filter():
    emb_x, emb_y, a, b = *draw(), weights(0, N_X), weights(1, N_Y)
    run = {"k0": FULL, "tol": 1e-10}
    see = lambda f, x, lam: jnp.sum(jnp.sin(pull_back(f(x, lam), emb_y)))
    plain = lambda x, lam: sinkhorn(x, emb_y, a, b, lam=lam, **run)
    ours = lambda x, lam: unbalanced(x, emb_y, a, b, lam=lam, reach=jnp.inf, **run)
    slopes = [jax.grad(partial(see, f), (0, 1))(emb_x, 3.0) for f in (plain, ours)]
    for one, other in zip(*slopes, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(one).max())


@pytest.mark.slow
def test_a_point_that_no_mass_reaches_keeps_none():
    inf = -jnp.inf
    kernel = Kernel(
        jnp.array([[1], [0], [0]]),
        jnp.array([[0.0], [inf], [-1.0]]),
        jnp.zeros((4, 1), jnp.int32),
        jnp.full((4, 1), inf),
    )
    found = scale_kernel(
        kernel, jnp.full(3, 1 / 3), jnp.full(4, 0.25), jnp.asarray(0.1),
        num_iters=300, relax=1.0,
    )  # fmt: skip
    assert found.empty_x == 1 and found.empty_y == 2
    assert np.isfinite(found.f).all() and found.marginal_error < 1e-9
    emb_x, emb_y = draw()
    lost = small(emb_x.at[4].set(jnp.nan), emb_y)
    assert lost.empty_x == 1 and lost.membership_x[4] == 0
    assert np.isfinite(lost.membership_x).all() and not (lost.T_yx == 4).any()


def test_it_is_a_converter():
    spec = testing.blob_spectrum(2, 16)
    order = np.random.default_rng(0).permutation(162)
    other = testing.relabel_spectrum(spec, order)
    truth = jnp.asarray(np.argsort(order), jnp.int32)
    start = functional_map(truth, spec, other)
    C_yx = icp(spec, other, start, num_iters=2, converter=unbalanced)
    np.testing.assert_allclose(C_yx, start, atol=1e-5)
    found = unbalanced(spec.evecs, other.evecs)
    assert np.array_equal(maps_of(found).T_xy, truth)
    assert np.array_equal(maps_of(found).T_yx, order)
    assert found.membership_x.min() > 0.95 and found.recall == 1
