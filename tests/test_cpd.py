"""Coherent point drift against a dense textbook version, and what it is good for."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.paper.baselines import cpd
from experiments.paper.baselines._cpd import drift
from jfsf import testing
from jfsf.convert import nearest
from jfsf.refine import icp

# Methods of others, for a table of the experiments: they seldom change.
pytestmark = pytest.mark.slow

FULL = 1000  # more than there are points


def sheet(n, width=4, seed=0):
    """n points of one smooth surface in `width` dimensions."""
    rng = np.random.default_rng(seed)
    waves = np.random.default_rng(99).normal(size=(2, width))
    return np.sin(2 * rng.uniform(-1, 1, (n, 2)) @ waves)


def bend(points, by=0.5):
    """A smooth displacement, longer than points are apart."""
    return points + by * np.sin(points @ np.roll(np.eye(points.shape[1]), 1, 0) + 1)


def textbook(centroids, samples, num_iters, beta=2.0, lam=3.0, w=0.1):
    """Myronenko and Song's figure 4, dense: matches, moved, sigma^2, energies."""

    def standard(p):
        p = p - p.mean(0)
        return p / np.sqrt((p**2).sum() / len(p))

    y, x = standard(centroids), standard(samples)
    (m, d), n = y.shape, len(x)
    apart = lambda a, b: ((a[:, None] - b[None]) ** 2).sum(2)
    G = np.exp(-apart(y, y) / (2 * beta**2))
    W, sigma2, energies = np.zeros((m, d)), apart(x, y).mean() / d, []

    def posterior(T):
        P = np.exp(-apart(T, x) / (2 * sigma2))
        c = (2 * np.pi * sigma2) ** (d / 2) * w / (1 - w) * m / n
        return P / (P.sum(0) + c), P.sum(0) + c

    for _ in range(num_iters):
        P, z = posterior(y + G @ W)
        penalty = lam / 2 * np.trace(W.T @ G @ W)
        energies.append(-np.log(z).sum() + n * d / 2 * np.log(sigma2) + penalty)
        P1 = P.sum(1)
        A = P1[:, None] * G + lam * sigma2 * np.eye(m)
        W = np.linalg.solve(A, P @ x - P1[:, None] * y)
        T = y + G @ W
        sigma2 = (P * apart(T, x)).sum() / (P.sum() * d)
    return posterior(T)[0].argmax(1), T, sigma2, energies


def right(T_xy):
    return np.mean(np.asarray(T_xy) == np.arange(len(T_xy)))


def pair(seed=0):
    """Embeddings of 90 and 70 points, bent against each other."""
    return sheet(90, seed=seed), bend(sheet(70, seed=seed + 10))


cpd_full, drift_full = partial(cpd, rank=FULL), partial(drift, rank=FULL)


def test_the_textbook_agrees():
    x, y = pair()
    ours = drift_full(jnp.asarray(x), jnp.asarray(y), tol=0.0)
    match, moved, sigma2, energies = textbook(x, y, 50)
    np.testing.assert_allclose(ours.energy, energies, rtol=1e-7)
    np.testing.assert_allclose(ours.moved, moved, atol=1e-5)
    np.testing.assert_allclose(ours.sigma2, sigma2, rtol=1e-5)
    # T_yx is the same with the roles exchanged.
    back = textbook(y, x, 50)[0]
    maps = cpd_full(jnp.asarray(x), jnp.asarray(y), tol=0.0)
    assert np.array_equal(maps.T_xy, match) and np.array_equal(maps.T_yx, back)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_the_objective_never_rises(seed, outliers):
    found = drift_full(*map(jnp.asarray, pair(seed)), outliers=outliers, tol=0.0)
    energy = np.asarray(found.energy)
    assert len(energy) == 50 and np.isfinite(energy).all()
    assert (np.diff(energy) <= 1e-9 * np.abs(energy[1:])).all()
    assert energy[-1] < energy[0] - 50


def test_a_smooth_displacement_is_undone():
    x = sheet(90)
    near, found = (f(jnp.asarray(x), jnp.asarray(bend(x))) for f in (nearest, cpd_full))
    for T_near, T in zip(near, found, strict=True):
        assert right(T_near) < 0.6 < 0.95 < right(T)
    # On points that are not the same, by where they land.
    x, y = pair()
    near, found = (f(jnp.asarray(x), jnp.asarray(y)) for f in (nearest, cpd_full))
    off = lambda T: np.linalg.norm(y[np.asarray(T)] - bend(x), axis=1).mean()
    assert off(found.T_xy) < 0.75 * off(near.T_xy)


def test_a_permutation_is_recovered():
    x, order = sheet(90), np.random.default_rng(0).permutation(90)
    maps = cpd_full(jnp.asarray(x), jnp.asarray(bend(x, 0.05)[order]))
    assert np.array_equal(maps.T_xy, np.argsort(order))
    assert np.array_equal(maps.T_yx, order)


def test_low_rank_agrees_with_full_rank():
    x, y = map(jnp.asarray, pair())
    full = drift_full(x, y, tol=0.0)
    low, poor = (drift(x, y, rank=r, tol=0.0) for r in (60, 5))
    gap = lambda other: float(jnp.abs(full.moved - other.moved).max())
    assert gap(low) < 1e-3 < 0.05 < gap(poor)
    assert np.mean(np.asarray(full.match) == np.asarray(low.match)) > 0.98


def test_a_stiffer_motion_moves_less():
    x, y = pair()
    start = textbook(x, y, 1, lam=1e15)[1]
    x, y = jnp.asarray(x), jnp.asarray(y)
    moves = [
        float(jnp.abs(drift_full(x, y, lam=lam).moved - start).max())
        for lam in (3.0, 1e3, 1e9)
    ]
    assert moves[0] > moves[1] > moves[2] and moves[2] < 1e-3


def test_padding_is_invisible():
    run = partial(cpd, rank=30, num_iters=20)
    x, y = pair()
    plain = run(jnp.asarray(x), jnp.asarray(y))
    # What padding holds does not matter.
    wide = [np.concatenate([e, np.full((6, 4), 7.0)]) for e in (x, y)]
    marginals = [jnp.pad(jnp.ones(n), (0, 6)) for n in (90, 70)]
    padded = run(*map(jnp.asarray, wide), *marginals)
    assert np.array_equal(padded.T_xy[:90], plain.T_xy)
    assert np.array_equal(padded.T_yx[:70], plain.T_yx)
    assert not padded.T_xy[90:].any() and not padded.T_yx[70:].any()
    assert padded.T_xy.dtype == padded.T_yx.dtype == jnp.int32


def test_place_size_and_labels_change_nothing():
    x, y = pair()
    order_x, order_y = (np.random.default_rng(0).permutation(n) for n in (90, 70))
    plain = cpd_full(jnp.asarray(x), jnp.asarray(y))
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
    moved = cpd_full(
        jnp.asarray(1e3 * x[order_x] @ turn + 5.0),
        jnp.asarray(1e3 * y[order_y] @ turn - 9.0),
    )
    truth = testing.relabel_maps(plain, order_x, order_y)
    assert np.array_equal(moved.T_xy, truth.T_xy)
    assert np.array_equal(moved.T_yx, truth.T_yx)


def test_vmap_equals_the_loop_in_float32_too():
    pairs = [
        [jnp.asarray(e, jnp.float32) for e in (x, bend(x))]
        for x in (sheet(90), sheet(90, seed=1))
    ]
    batch = jax.vmap(cpd_full)(*testing.stack(pairs))
    for i, (x, y) in enumerate(pairs):
        high = cpd_full(x.astype(float), y.astype(float))
        for ours, theirs in zip(batch, high, strict=True):
            assert np.mean(np.asarray(ours[i]) == np.asarray(theirs)) > 0.98


def test_wide_embeddings_do_not_overflow():
    # sigma^-k at k = 120 leaves float32 by far.
    x = jnp.asarray(np.random.default_rng(0).normal(size=(90, 120)), jnp.float32)
    found = drift_full(x, x + 1e-3)
    assert right(found.match) == 1 and np.isfinite(found.moved).all()


def test_it_is_a_converter():
    spec = testing.blob_spectrum(2, 20, 1)
    C = icp(spec, spec, jnp.eye(12), num_iters=2, converter=cpd_full)
    np.testing.assert_allclose(jnp.abs(C), np.eye(12), atol=0.1)


def test_errors():
    x, y = jnp.ones((5, 2)), jnp.ones((6, 3))
    with pytest.raises(ValueError, match=r"emb_x is \(5, 2\), emb_y is \(6, 3\)"):
        cpd(x, y)
    with pytest.raises(ValueError, match=r"centroids is \(5, 2\)"):
        drift(x, y)
    with pytest.raises(ValueError, match=r"emb_y has 5 rows, its marginal .* \(4,\)"):
        cpd(x, x, None, jnp.ones(4))
    with pytest.raises(ValueError, match="must be positive, got 0 and 300"):
        cpd(x, x, num_iters=0)
    with pytest.raises(ValueError, match="must be positive, got 50 and 0"):
        cpd(x, x, rank=0)


def test_rows_that_are_not_finite_are_padding():
    x, y = pair()
    found = cpd_full(jnp.asarray(x), jnp.asarray(y))
    x = np.insert(x, 5, np.nan, 0)
    again = cpd_full(jnp.asarray(x), jnp.asarray(y))
    np.testing.assert_array_equal(np.delete(again.T_xy, 5), found.T_xy)
    back = np.asarray(found.T_yx)
    np.testing.assert_array_equal(again.T_yx, back + (back >= 5))
