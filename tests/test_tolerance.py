"""Sinkhorn to a tolerance: marginals met or flagged, and gradients of the plan."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from precisions import FLOATS
from problems import dense
from scipy.optimize import linprog

from jfsf import testing
from jfsf.convert import pull_back, sinkhorn
from jfsf.convert._scaling import plan_entries, scale_kernel
from jfsf.types import Kernel

N_X, N_Y, WIDTH = 17, 23, 3
FULL = max(N_X, N_Y)


def problem(seed, dtype=jnp.float64, low=0.2):
    """Two samples of one surface, and marginals."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(2, WIDTH)) * 2
    embs = [np.sin(rng.uniform(-1, 1, (n, 2)) @ waves) for n in (N_X, N_Y)]
    marginals = [rng.uniform(low, 1, n) for n in (N_X, N_Y)]
    return [jnp.asarray(a, dtype) for a in (*embs, *(m / m.sum() for m in marginals))]


def least_error(kernel, a, b):
    """The least marginal error of any plan on the kernel's entries that sends all of a.

    By linear programming: minimise what the columns are off by.
    """
    halves = (kernel.idx_xy, kernel.log_xy), (kernel.idx_yx, kernel.log_yx)
    mask = np.zeros((len(a), len(b)), bool)
    for (idx, log), into in zip(halves, (mask, mask.T), strict=True):
        for i, c in np.argwhere(np.isfinite(log)):
            into[i, idx[i, c]] = True
    rows, columns = np.nonzero(mask)
    n, m = len(rows), len(b)
    equal = np.zeros((len(a) + m, n + 2 * m))
    equal[rows, np.arange(n)] = 1
    equal[len(a) + columns, np.arange(n)] = 1
    equal[len(a) + np.arange(m), n + np.arange(m)] = 1
    equal[len(a) + np.arange(m), n + m + np.arange(m)] = -1
    cost = np.concatenate([np.zeros(n), np.ones(2 * m)])
    return linprog(cost, A_eq=equal, b_eq=np.concatenate([a, b])).fun


@pytest.mark.parametrize("dtype", FLOATS)
def test_random_marginals_are_met(dtype):
    for seed in range(20):
        found = sinkhorn(*problem(seed, dtype), lam=20.0, k0=FULL, tol=1e-4)
        assert found.converged and found.marginal_error <= 1e-4
        assert found.num_iters < 2000 and found.f.dtype == dtype
        weight, (a, b) = dense(found), map(np.asarray, problem(seed, dtype)[2:])
        gap = np.abs(weight.sum(1) - a).sum() + np.abs(weight.sum(0) - b).sum()
        np.testing.assert_allclose(gap, found.marginal_error, atol=2e-6)


@pytest.mark.parametrize(("lam", "updates"), [(1.0, 300), (30.0, 6000)])
def test_the_plan_is_that_of_many_dense_updates(lam, updates):
    emb_x, emb_y, a, b = problem(0)
    ours = sinkhorn(emb_x, emb_y, a, b, lam=lam, k0=FULL, tol=1e-9)
    near = [oracles.neighbours(*e, FULL) for e in ((emb_x, emb_y), (emb_y, emb_x))]
    unit = np.sqrt(np.prod([np.median(dist[:, 0]) for _, dist in near]))
    log_k = oracles.log_kernel(*near, lam / unit, lam / unit, unilateral_weight=1.0)
    _, _, log_plan, gap = oracles.sinkhorn(log_k, a, b, updates, 1.0)
    assert gap < 1e-9 and ours.converged
    np.testing.assert_allclose(dense(ours), np.exp(log_plan), atol=1e-9)


@pytest.mark.filterwarnings("ignore:JAXopt is no longer")  # ott imports it
@pytest.mark.parametrize("package", ["ot", "ott"])
def test_other_packages_agree(package):
    emb_x, emb_y, a, b = problem(1)
    ours = sinkhorn(emb_x, emb_y, a, b, lam=2.0, k0=FULL, tol=1e-8)
    cost = np.linalg.norm(np.asarray(emb_x)[:, None] - np.asarray(emb_y)[None], axis=2)
    unit = np.sqrt(np.median(cost.min(0)) * np.median(cost.min(1))) / 2
    if package == "ot":
        import ot

        theirs = ot.sinkhorn(*map(np.asarray, (a, b)), cost, unit, stopThr=1e-10)
    else:
        from ott.geometry.geometry import Geometry
        from ott.solvers.linear import solve

        # It lets ranks and dtypes be promoted; the tests do not.
        with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
            geometry = Geometry(jnp.asarray(cost), epsilon=unit)
            theirs = solve(geometry, a, b, threshold=1e-8).matrix
    np.testing.assert_allclose(dense(ours), theirs, atol=1e-4 / N_X)


@pytest.mark.parametrize("dtype", FLOATS)
@given(seed=st.integers(0, 200))
@settings(max_examples=10)
def test_what_cannot_be_met_is_flagged_at_the_least_error(dtype, seed):
    found = sinkhorn(*problem(seed, dtype), lam=5.0, k0=3, tol=1e-3)
    _, _, a, b = problem(seed)
    least = least_error(found.kernel, a, b)
    assert found.converged == (found.marginal_error <= 1e-3)
    if least > 2e-3:
        assert not found.converged and found.num_iters < 6000
        assert found.marginal_error >= least - 1e-5
        np.testing.assert_allclose(found.marginal_error, least, atol=0.01)


def test_vertices_that_no_mass_reaches_end_the_updates():
    inf = -jnp.inf
    kernel = Kernel(
        jnp.array([[1], [0], [0]]),
        jnp.array([[0.0], [inf], [-1.0]]),
        jnp.zeros((4, 1), jnp.int32),
        jnp.full((4, 1), inf),
    )
    found = scale_kernel(kernel, jnp.full(3, 1 / 3), jnp.full(4, 0.25), tol=1e-3)
    assert found.empty_x == 1 and found.empty_y == 2 and not found.converged
    assert found.num_iters < 3000
    np.testing.assert_allclose(found.marginal_error, 1 / 3 + 1 / 2 + 2 / 12)


def test_the_cap_holds():
    found = sinkhorn(*problem(2), lam=100.0, k0=FULL, tol=1e-12, max_iters=40)
    assert not found.converged and found.num_iters <= 42


def test_what_is_not_finite_ends_the_updates():
    emb_x, emb_y, a, b = problem(0)
    run = jax.jit(lambda a: sinkhorn(emb_x, emb_y, a, b, k0=FULL, tol=1e-3))
    found = run(a * jnp.nan)
    assert not found.converged and found.num_iters < 100


def test_vmap_equals_the_loop():
    batch = [jnp.stack(a) for a in zip(*(problem(s) for s in range(3)), strict=True)]
    lam, tol = jnp.asarray([2.0, 20.0, 80.0]), jnp.asarray([1e-2, 1e-6, 1e-3])
    run = lambda *args: sinkhorn(*args[:-2], lam=args[-2], k0=FULL, tol=args[-1])
    found = jax.vmap(run)(*batch, lam, tol)
    for i in range(3):
        single = run(*(a[i] for a in batch), float(lam[i]), float(tol[i]))
        assert single.num_iters == found.num_iters[i] and found.converged[i]
        np.testing.assert_allclose(found.f[i], single.f, atol=1e-8)


def test_padding_is_invisible():
    emb_x, emb_y, a, b = problem(3)
    plain = sinkhorn(emb_x, emb_y, a, b, lam=20.0, k0=FULL, tol=1e-8)
    pad = lambda e, m: jnp.pad(e, ((0, m), (0, 0)), constant_values=0.3)
    padded = sinkhorn(
        pad(emb_x, 3),
        pad(emb_y, 5),
        jnp.pad(a, (0, 3)),
        jnp.pad(b, (0, 5)),
        lam=20.0,
        k0=FULL,
        tol=1e-8,
    )
    np.testing.assert_allclose(dense(padded)[:N_X, :N_Y], dense(plain), atol=1e-10)
    assert padded.converged == plain.converged
    assert not padded.f[N_X:].any() and not padded.g[N_Y:].any()


def functions(seed):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.normal(size=(N_Y, 2)))


def soft_value(emb_x, emb_y, C, lam, log_a, log_b, *, values, **options):
    """A number made from the plan: pulled-back functions, soft map, transport cost."""
    marginals = jax.nn.softmax(log_a), jax.nn.softmax(log_b)
    found = sinkhorn(emb_x @ C, emb_y, *marginals, lam=lam, **options)
    rows, columns, weight = plan_entries(found)
    away = (emb_x @ C)[rows] - emb_y[columns]
    cost = jnp.sum(weight * jnp.sum(away**2, 1))
    seen = pull_back(found, values)
    return jnp.sum(jnp.sin(seen)) + cost + jnp.sum(pull_back(found, emb_y) ** 2)


EXACT = partial(soft_value, k0=6, length_gradient=True)
converged = partial(EXACT, tol=1e-12)


def arguments(seed):
    emb_x, emb_y, a, b = problem(seed)
    C = jnp.eye(WIDTH) + 0.05 * problem(seed + 1)[0][:WIDTH]
    return emb_x, emb_y, C, jnp.asarray(3.0), jnp.log(a), jnp.log(b)


def feasible(seed):
    emb_x, emb_y, C, lam, log_a, log_b = arguments(seed)
    marginals = jax.nn.softmax(log_a), jax.nn.softmax(log_b)
    return sinkhorn(emb_x @ C, emb_y, *marginals, lam=lam, k0=6, tol=1e-12).converged


# Those of the first that are feasible.
SEEDS = [0, 1, 3, 4, 6, 12]
ONE_QUICK = [SEEDS[0], *(pytest.param(s, marks=pytest.mark.slow) for s in SEEDS[1:3])]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_implicit_gradients_are_finite_differences(seed):
    assert feasible(seed)
    args, values = arguments(seed), functions(seed)
    value = partial(converged, values=values)
    slopes = jax.grad(value, range(6))(*args)
    rng, h = np.random.default_rng(seed), 1e-5
    for i, (arg, slope) in enumerate(zip(args, slopes, strict=True)):
        step = jnp.asarray(rng.normal(size=arg.shape))
        ends = [value(*args[:i], arg + s * h * step, *args[i + 1 :]) for s in (1, -1)]
        exact, found = (ends[0] - ends[1]) / (2 * h), jnp.sum(slope * step)
        np.testing.assert_allclose(found, exact, rtol=1e-5, atol=1e-8, err_msg=str(i))


@pytest.mark.parametrize("seed", ONE_QUICK)
@pytest.mark.parametrize(
    "length_gradient", [False, pytest.param(True, marks=pytest.mark.slow)]
)
def test_implicit_gradients_are_those_of_many_updates(seed, length_gradient):
    args, values = arguments(seed), functions(seed)
    options = {"values": values, "k0": 6, "length_gradient": length_gradient}
    ours = jax.grad(partial(soft_value, tol=1e-12, **options), range(6))(*args)
    # Plain updates: over-relaxed ones end with a plain one, of another derivative.
    unrolled = partial(soft_value, num_iters=4000, **options)
    for found, exact in zip(ours, jax.grad(unrolled, range(6))(*args), strict=True):
        scale = float(jnp.abs(exact).max())
        np.testing.assert_allclose(found, exact, atol=1e-6 * scale, rtol=0)


@pytest.mark.slow
def test_forward_mode_agrees_with_reverse_mode():
    args, values = arguments(SEEDS[0]), functions(0)
    value = partial(converged, values=values)
    steps = jax.tree.map(jnp.ones_like, args)
    _, forward = jax.jvp(value, args, steps)
    backward = sum(jnp.sum(s) for s in jax.grad(value, range(6))(*args))
    np.testing.assert_allclose(forward, backward, rtol=1e-7)


@pytest.mark.slow
def test_gradients_in_float32_under_jit_and_vmap():
    batch = [
        jnp.stack(a).astype(jnp.float32)
        for a in zip(*map(arguments, SEEDS[:2]), strict=True)
    ]
    values = functions(0)
    value = partial(EXACT, tol=1e-5, values=values.astype(jnp.float32))
    found = jax.jit(jax.vmap(jax.grad(value)))(*batch)
    for i, seed in enumerate(SEEDS[:2]):
        exact = jax.grad(partial(converged, values=values))(*arguments(seed))
        np.testing.assert_allclose(found[i], exact, atol=5e-3 * np.abs(exact).max())


@pytest.mark.parametrize("tol", [pytest.param(None, marks=pytest.mark.slow), 1e-3])
@pytest.mark.parametrize("dtype", FLOATS)
@given(
    seed=testing.seeds,
    log_lam=st.floats(-3, 9),
    log_unit=st.floats(-12, 12),
    log_least=st.floats(-30, 0),
)
@settings(max_examples=15)
def test_extremes_are_finite_or_flagged(tol, dtype, seed, log_lam, log_unit, log_least):
    check_extremes(tol, dtype, seed, log_lam, log_unit, log_least)


@pytest.mark.slow
@pytest.mark.parametrize("tol", [None, 1e-3])
@pytest.mark.parametrize("dtype", FLOATS)
@given(
    seed=testing.seeds,
    log_lam=st.floats(-3, 9),
    log_unit=st.floats(-12, 12),
    log_least=st.floats(-30, 0),
)
@settings(max_examples=2500)
def test_more_extremes(tol, dtype, seed, log_lam, log_unit, log_least):
    check_extremes(tol, dtype, seed, log_lam, log_unit, log_least)


def check_extremes(tol, dtype, seed, log_lam, log_unit, log_least):
    rng = np.random.default_rng(seed)
    emb_x, emb_y, *_ = problem(seed % 1000, dtype)
    unit = jnp.asarray(10.0**log_unit, dtype)
    marginals = []
    for n in (N_X, N_Y):
        weight = 10.0 ** rng.uniform(log_least, 0, n)
        marginals.append(jnp.asarray(weight / weight.sum(), dtype))
    lam = jnp.asarray(10.0**log_lam, dtype)
    options = {"lam": lam, "k0": 5, "tol": tol, "max_iters": 400}
    found = sinkhorn(emb_x * unit, emb_y * unit, *marginals, **options)
    for value in (found.f, found.g, *plan_entries(found), found.marginal_error):
        assert np.isfinite(value).all()
    assert 0 <= found.marginal_error <= 2 + 1e-5
    assert tol is None or found.converged == (found.marginal_error <= tol)
