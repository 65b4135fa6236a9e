"""ott-jax solves the problem of our kernel, and its potentials are ours in its unit."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf.apps.interop import from_ott, potentials_to_ott, to_ott
from jfsf.convert import sinkhorn
from jfsf.convert._scaling import plan_entries, scale_kernel
from jfsf.types import Kernel

# Slow, as Sinkhorn has a dense oracle of its own among the others.
# ott imports jaxopt, and lets ranks and dtypes be promoted, which the tests do not.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:JAXopt is no longer"),
]
N_X, N_Y = 19, 13


@pytest.fixture(autouse=True)
def promotion():
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        yield


def points(seed=0):
    rng = np.random.default_rng(seed)
    return [jnp.asarray(rng.normal(size=(n, 3))) for n in (N_X, N_Y)]


def dense(filtered):
    rows, columns, values = map(np.asarray, plan_entries(filtered))
    out = np.zeros((len(filtered.f), len(filtered.g)))
    np.add.at(out, (rows, columns), values)
    return out


def feasible(seed=0, k0=3):
    """A sparse kernel and marginals that a plan on it meets."""
    found = sinkhorn(*points(seed), lam=1.0, k0=k0, num_iters=3)
    plan = dense(found)
    return found.kernel, *(jnp.asarray(plan.sum(i) / plan.sum()) for i in (1, 0))


@pytest.mark.parametrize(
    "epsilon", [1.0, 0.05, pytest.param(7.0, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("k0", [3, N_X])
def test_ott_finds_our_plan_and_potentials(epsilon, k0):
    from ott.solvers.linear import solve

    kernel, a, b = feasible(k0=k0)
    ours = scale_kernel(kernel, a, b, tol=1e-9)
    geometry = to_ott(kernel, epsilon=epsilon)
    assert geometry.shape == (N_X, N_Y)
    theirs = solve(geometry, a, b, threshold=1e-9, max_iterations=20_000)
    assert ours.converged and theirs.converged
    np.testing.assert_allclose(theirs.matrix, dense(ours), atol=1e-8)
    found = from_ott(theirs.f, theirs.g, geometry)
    shift = found.f[0] - ours.f[0]
    np.testing.assert_allclose(found.f - shift, ours.f, atol=1e-5)
    np.testing.assert_allclose(found.g + shift, ours.g, atol=1e-5)
    back = dense(ours._replace(**found._asdict()))
    np.testing.assert_allclose(back, theirs.matrix, atol=1e-12)


def test_the_cost_is_the_distance_with_epsilon_1_over_lam():
    from ott.geometry.pointcloud import PointCloud

    x, y = points()
    lam = 3.0
    log_k = -lam * jnp.linalg.norm(x[:, None] - y[None], axis=2)
    idx = jnp.broadcast_to(jnp.arange(N_Y), (N_X, N_Y))
    kernel = Kernel(idx, log_k, jnp.zeros((N_Y, 1), int), jnp.full((N_Y, 1), -jnp.inf))
    geometry = to_ott(kernel, epsilon=1 / lam)
    np.testing.assert_allclose(
        geometry.cost_matrix**2, PointCloud(x, y).cost_matrix, atol=1e-12
    )
    np.testing.assert_allclose(geometry.kernel_matrix, jnp.exp(log_k), atol=1e-15)


def test_entries_stand_where_the_kernel_has_them():
    kernel, *_ = feasible(k0=3)
    unscaled = scale_kernel(kernel, jnp.ones(N_X), jnp.ones(N_Y))
    unscaled = unscaled._replace(f=jnp.zeros(N_X), g=jnp.zeros(N_Y))
    wanted = dense(unscaled)
    assert 0 < (wanted == 0).mean() < 1
    found = to_ott(kernel, epsilon=0.3)
    np.testing.assert_allclose(found.kernel_matrix, wanted, atol=1e-15)
    assert (np.isinf(found.cost_matrix) == (wanted == 0)).all()
    single = Kernel(
        *(a.astype(jnp.float32) if a.dtype == jnp.float64 else a for a in kernel)
    )
    assert to_ott(single, epsilon=0.3).cost_matrix.dtype == jnp.float32


def test_our_potentials_start_otts_updates_at_their_end():
    from ott.problems.linear.linear_problem import LinearProblem
    from ott.solvers.linear.sinkhorn import Sinkhorn

    kernel, a, b = feasible()
    ours = scale_kernel(kernel, a, b, tol=1e-10)
    geometry = to_ott(kernel, epsilon=0.2)
    init = potentials_to_ott(ours.f, ours.g, geometry)
    solver = Sinkhorn(threshold=1e-8, max_iterations=20_000)
    cold, warm = (
        solver(LinearProblem(geometry, a, b), init=start).n_iters
        for start in (None, tuple(init))
    )
    assert warm <= 10 < cold
    back = from_ott(*init, geometry)
    np.testing.assert_allclose(back.f, ours.f, atol=1e-12)
    np.testing.assert_allclose(back.g, ours.g, atol=1e-12)


def test_points_without_mass_have_scaling_0():
    from ott.solvers.linear import solve

    x, y = points()
    a = jnp.full(N_X, 1 / (N_X - 2)).at[-2:].set(0)
    b = jnp.full(N_Y, 1 / (N_Y - 1)).at[0].set(0)
    ours = sinkhorn(x, y, a, b, lam=2.0, k0=N_X, tol=1e-9)
    geometry = to_ott(ours.kernel)
    theirs = solve(geometry, a, b, threshold=1e-9, max_iterations=20_000)
    np.testing.assert_allclose(theirs.matrix, dense(ours), atol=1e-8)
    found = from_ott(theirs.f, theirs.g, geometry)
    assert not found.f[-2:].any() and not found.g[0]
    back = dense(ours._replace(**found._asdict()))
    np.testing.assert_allclose(back, theirs.matrix, atol=1e-10)


def test_it_is_jitted_and_vmapped():
    kernels = jax.tree.map(lambda *a: jnp.stack(a), *(feasible(s)[0] for s in (0, 1)))
    costs = jax.jit(jax.vmap(lambda kernel: to_ott(kernel).cost_matrix))(kernels)
    for seed, cost in enumerate(costs):
        np.testing.assert_allclose(cost, to_ott(feasible(seed)[0]).cost_matrix)


def test_the_other_direction_is_refused():
    kernel, *_ = feasible()
    geometry = to_ott(kernel)
    for function in (from_ott, potentials_to_ott):
        with pytest.raises(
            ValueError, match=r"f is \(13,\) and g is \(19,\).*\(19, 13\)"
        ):
            function(jnp.zeros(N_Y), jnp.zeros(N_X), geometry)
    with pytest.raises(ValueError, match=r"\(1, 19, 3\).*vmap"):
        to_ott(jax.tree.map(lambda a: a[None], kernel))


def test_a_missing_package_says_how_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "ott.geometry.geometry", None)
    with pytest.raises(
        ImportError, match=r"needs ott-jax.*pip install 'jfsf\[interop\]'"
    ):
        to_ott(feasible()[0])
