"""Robust and orthogonal fits against scipy's minimum, and what they are for."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
import scipy.optimize
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from jfsf.initial import Weights, fit
from jfsf.initial._fit import solve_nonlinear
from jfsf.initial._linear import solve
from jfsf.initial._terms import terms
from jfsf.spectral import spectrum, wks
from jfsf.spectral._orientation import brackets
from jfsf.testing import cast
from jfsf.types import Mesh

K = 6
LOSSES = ("square", "huber", "geman-mcclure")
# The square is the quickest; the others run with the slow tests.
ONE_QUICK = ["square", *(pytest.param(x, marks=pytest.mark.slow) for x in LOSSES[1:])]
WEIGHTS = Weights(*jnp.array([1.0, 0.2, 0.3, 0.4]))


def shape(subdivisions, k):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    v = np.array(ball.vertices)
    v = v * (1 + 0.3 * v[:, 1:2] ** 3 + 0.2 * v[:, 2:] * v[:, :1]) * [1.0, 1.4, 2.0]
    mesh = Mesh(v, np.array(ball.faces, np.int32))
    return cast(spectrum(mesh, k, cache=False))


X, Y = shape(2, 30), shape(1, 20)  # the first 42 vertices of X are Y's
SPOTS = jnp.array([0, 5, 30])
DESC_X, DESC_Y = wks(X, SPOTS, num=6), wks(Y, SPOTS, num=6)


def random(seed, *size):
    return jnp.asarray(np.random.default_rng(seed).normal(size=size))


def close(x, y, tol):
    return jnp.linalg.norm(x - y) < tol * jnp.linalg.norm(y)


def rho(r, scale, loss):
    """The losses as their authors write them."""
    if loss == "huber":
        return np.where(r < scale, r**2, 2 * scale * r - scale**2)
    if loss == "geman-mcclure":
        return scale**2 * r**2 / (r**2 + scale**2)
    return r**2


@pytest.mark.parametrize("loss", ONE_QUICK)
@settings(max_examples=3)
@given(seed=st.integers(0, 10**6))
def test_scipy_finds_the_same_minimum(loss, seed):
    desc_x, desc_y = DESC_X + 0.3 * random(seed, 162, 18) * DESC_X.std(0)[None], DESC_Y
    tensors = [np.asarray(brackets(spec, k=K)) for spec in (X, Y)]
    flat = oracles.fit_residuals(X, Y, desc_x, desc_y, *tensors, np.asarray(WEIGHTS))
    start = oracles.fit(flat, K)

    def energy(free):
        C = start.copy()
        C[:, 1:] = free.reshape(K, K - 1)
        parts = flat(C)
        # Mismatches (K, 18), mask (K, K), then two gaps (K, K) for each descriptor.
        cost = (parts[: K * 18].reshape(K, 18) ** 2).sum(0)
        gaps = parts[K * 18 + K * K :].reshape(2, 18, K * K)
        size = np.sqrt(cost + (gaps**2).sum((0, 2)))
        gram = C.T @ C - np.eye(K)
        mask = parts[K * 18 : K * 18 + K * K]
        scale = 0.2 * np.sqrt(K / 18)
        return rho(size, scale, loss).sum() + np.sum(mask**2) + 0.5 * np.sum(gram**2)

    options = {"gtol": 1e-7, "maxiter": 2000}
    best = scipy.optimize.minimize(energy, start[:, 1:].ravel(), options=options)
    found = fit(
        X,
        Y,
        desc_x,
        desc_y,
        WEIGHTS,
        k=K,
        loss=loss,
        scale=0.2,
        orthogonality=0.5,
    )
    value = energy(np.asarray(found.C_yx)[:, 1:].ravel())
    assert value <= best.fun * (1 + 1e-6)
    assert np.abs(np.asarray(found.C_yx)[:, 1:].ravel() - best.x).max() < 1e-3
    assert found.residual < 1e-6


@pytest.mark.parametrize("loss", ONE_QUICK)
def test_small_mismatches_are_squared(loss):
    problem = terms(X, Y, DESC_X, DESC_Y, WEIGHTS, k=K)
    found = solve_nonlinear(problem, 0.0, 1e6, loss=loss)
    assert close(found.C_yx, solve(problem).C_yx, 1e-5)


@pytest.mark.slow
def test_a_robust_fit_forgets_descriptors_that_are_wrong():
    # Two landmarks of ten are elsewhere on Y.
    spots = jnp.array([0, 5, 30, 11, 20, 3, 8, 9, 15, 35])
    wrong = spots.at[3].set(2).at[4].set(7)
    desc_x = wks(X, spots, num=6)
    truth = fit(X, Y, desc_x, wks(Y, spots, num=6), WEIGHTS, k=8).C_yx
    error = {}
    for loss in LOSSES:
        C_yx = fit(X, Y, desc_x, wks(Y, wrong, num=6), WEIGHTS, k=8, loss=loss).C_yx
        error[loss] = jnp.linalg.norm(C_yx - truth)
    assert error["huber"] < 0.6 * error["square"]
    assert error["geman-mcclure"] < 0.2 * error["square"]


def test_orthogonality_grows_with_its_weight():
    gap = []
    for weight in (None, 0.1, 1.0, 10.0):
        C = fit(X, Y, DESC_X, DESC_Y, WEIGHTS, k=K, orthogonality=weight).C_yx
        gap.append(jnp.linalg.norm(C.T @ C - jnp.eye(K)))
    assert gap == sorted(gap, reverse=True) and gap[-1] < 0.5 * gap[0]


@pytest.mark.parametrize("loss", ONE_QUICK)
def test_gradients_are_those_of_the_minimum(loss):
    def value(desc_x, weights, scale, orthogonality):
        options = {"k": K, "loss": loss, "scale": scale}
        found = fit(
            X, Y, desc_x, DESC_Y, weights, orthogonality=orthogonality, **options
        )
        return jnp.sum(jnp.sin(found.C_yx))

    at = [DESC_X, WEIGHTS, jnp.asarray(0.2), jnp.asarray(0.3)]
    slopes = jax.jit(jax.grad(value, (0, 1, 2, 3)))(*at)
    # The value is known to some 1e-8 only, a difference over h to 1e-8 / h; on another
    # processor to ten times that.
    value, h = jax.jit(value), 1e-3
    for i, slope in enumerate(slopes):
        step = jax.tree.map(lambda s, i=i: random(i, *s.shape), slope)
        ends = []
        for sign in (h, -h):
            moved = jax.tree.map(lambda a, d, s=sign: a + s * d, at[i], step)
            ends.append(value(*at[:i], moved, *at[i + 1 :]))
        parts = jax.tree.map(lambda a, b: jnp.sum(a * b), slope, step)
        exact = sum(jax.tree.leaves(parts))
        rate = (ends[0] - ends[1]) / (2 * h)
        assert np.isclose(rate, exact, rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_vmap_equals_the_loop():
    desc_x = jnp.stack([DESC_X, DESC_X**2])
    run = lambda d: fit(X, Y, d, DESC_Y, WEIGHTS, k=K, loss="huber", scale=0.1).C_yx
    batch = jax.vmap(run)(desc_x)
    for i in range(2):
        assert close(batch[i], run(desc_x[i]), 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("loss", ONE_QUICK)
def test_float32(loss):
    short = [cast(spec, jnp.float32) for spec in (X, Y)]
    short += [desc.astype(jnp.float32) for desc in (DESC_X, DESC_Y)]
    options = {"k": K, "loss": loss, "orthogonality": 0.3}
    found = fit(*short, Weights(*map(float, WEIGHTS)), **options)
    assert found.C_yx.dtype == found.residual.dtype == jnp.float32
    assert found.residual < 1e-2
    exact = fit(X, Y, DESC_X, DESC_Y, WEIGHTS, **options).C_yx
    assert np.abs(np.asarray(found.C_yx) - np.asarray(exact)).max() < 1e-2


def test_an_unknown_loss_is_refused():
    with pytest.raises(ValueError, match="'square', 'huber' or .*, not 'cauchy'"):
        fit(X, Y, DESC_X, DESC_Y, k=K, loss="cauchy")  # type: ignore
