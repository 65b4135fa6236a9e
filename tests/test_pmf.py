"""Product manifold filter: one to one, of largest density; scipy is the oracle."""

from functools import cache

import fast_simplification
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from experiments.paper.baselines import pmf
from experiments.paper.baselines._pmf import TIMES
from jfsf import data, testing
from jfsf.spectral import spectrum
from jfsf.types import Mesh

# Methods of others, for a table of the experiments: they seldom change.
pytestmark = pytest.mark.slow

K = 60


def density(spec_x, spec_y, T_xy, time, at=None):
    """K_X Pi K_Y^T with the two kernels written out; Pi pairs `at` with T_xy[at]."""
    kernels = []
    for spec in (spec_x, spec_y):
        evecs = np.asarray(spec.evecs)
        kernels.append((evecs * np.exp(-time * np.asarray(spec.evals))) @ evecs.T)
    pairing = np.zeros((len(kernels[0]), len(kernels[1])))
    at = np.arange(len(T_xy)) if at is None else at
    pairing[at, np.asarray(T_xy)[at]] = 1
    return kernels[0] @ pairing @ kernels[1].T


def spread(density):
    rows = density - density.mean(1, keepdims=True)
    return (rows - rows.mean(0)).std()


def corrupted(T, share, seed=0):
    """T with a share of its entries shuffled among themselves; and which."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.permutation(len(T))[: int(share * len(T))])
    wrong = np.array(T)
    wrong[at] = wrong[rng.permutation(at)]
    return wrong, at


@cache
def small():
    """Two spectra of one shape, relabelled, and the map between them."""
    spec = testing.blob_spectrum(1, K)
    order = np.random.default_rng(0).permutation(len(spec.mass))
    return spec, testing.relabel_spectrum(spec, order), np.argsort(order)


@cache
def people(n_x, n_y):
    """Spectra of one man in two samplings."""
    mesh = data.load("man_walk").mesh
    found = []
    for n in (n_x, n_y):
        v, f = fast_simplification.simplify(
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.faces),
            target_count=2 * n - 4,
        )
        found.append(spectrum(Mesh(v.astype(float), f), K, cache=False))
    return found


def nearest_vertex(spec_x, spec_y):
    gap = (spec_x.vertices[:, None] - spec_y.vertices[None]) ** 2
    return gap.sum(2).argmin(1)


def test_a_permutation_whose_inverse_is_the_other_map():
    spec_x, spec_y, truth = small()
    start = np.random.default_rng(0).integers(len(truth), size=len(truth))
    T_xy, T_yx = map(np.asarray, pmf(spec_x, spec_y, start, times=(0.02, 0.005)))
    assert np.array_equal(np.sort(T_xy), np.arange(len(truth)))
    assert np.array_equal(T_yx[T_xy], np.arange(len(truth)))
    assert T_xy.dtype == T_yx.dtype == np.int32


@pytest.mark.parametrize("time", [TIMES[0], 0.005, TIMES[-1]])
def test_each_step_takes_the_densest_assignment(time):
    spec_x, spec_y, truth = small()
    start, _ = corrupted(truth, 0.5)
    eps = 1e-6
    T_xy = np.asarray(pmf(spec_x, spec_y, start, times=(time,), eps=eps).T_xy)
    found = density(spec_x, spec_y, start, time)
    most = found[linear_sum_assignment(found, maximize=True)].sum()
    short = most - found[np.arange(len(T_xy)), T_xy].sum()
    assert -1e-9 * most <= short <= len(T_xy) * eps * spread(found) + 1e-9 * most


def test_corrupted_entries_are_repaired():
    spec, _ = people(400, 220)
    truth = np.arange(len(spec.mass))
    start, wrong = corrupted(truth, 0.5)
    T_xy = np.asarray(pmf(spec, spec, start).T_xy)
    assert (start[wrong] == wrong).mean() < 0.05
    assert (T_xy[wrong] == wrong).mean() > 0.9
    assert (T_xy == truth).mean() > 0.9


def test_narrower_kernels_sharpen_what_wide_ones_leave_blurred():
    spec, _ = people(400, 220)
    truth = np.arange(len(spec.mass))
    start, _ = corrupted(truth, 0.9)
    wide = np.asarray(pmf(spec, spec, start, times=TIMES[:1]).T_xy)
    every = np.asarray(pmf(spec, spec, start).T_xy)
    share = [(T == truth).mean() for T in (start, wide, every)]
    assert share[0] < 0.2 and share[1] > 0.5 and share[2] > share[1] + 0.1, share


@pytest.mark.parametrize("time", [0.02, 0.003])
def test_the_objective_never_falls_at_one_time(time):
    spec_x, spec_y = people(160, 110)
    for one, other in ((spec_x, spec_x), (spec_x, spec_y), (spec_y, spec_x)):
        n = len(one.mass)
        start = np.random.default_rng(0).permutation(len(other.mass))
        start = np.resize(start, n)
        values = []
        for steps in (1, 2, 3, 4):
            maps = pmf(one, other, start, times=(time,) * steps, eps=1e-5)
            T_xy, T_yx = map(np.asarray, maps)
            at = np.flatnonzero(T_yx[T_xy] == np.arange(n)) if n <= len(T_yx) else None
            at = np.unique(T_yx) if at is None else at
            found = density(one, other, T_xy, time, at)
            values.append(found[at, T_xy[at]].sum())
        assert len(at) == min(n, len(T_yx))
        assert (np.diff(values) > -1e-6 * values[-1]).all()
        assert values[-1] > values[0] * 1.001


@pytest.mark.parametrize("flip", [False, True])
def test_the_smaller_side_is_injective_and_the_rest_densest(flip):
    spec_x, spec_y = people(300, 220)[:: -1 if flip else 1]
    start = nearest_vertex(spec_x, spec_y)
    time, eps = 0.003, 1e-6
    maps = pmf(spec_x, spec_y, start, times=(time,), eps=eps)
    found = density(spec_x, spec_y, start, time)
    # The smaller side first.
    T, back = map(np.asarray, maps)
    if len(T) > len(back):
        T, back, found = back, T, found.T
    assert len(T) < len(back)
    every = np.arange(len(T))
    assert len(np.unique(T)) == len(T) and np.array_equal(back[T], every)
    most = found[linear_sum_assignment(found, maximize=True)].sum()
    assert most - found[every, T].sum() <= len(T) * eps * spread(found) + 1e-9 * most
    rest = np.setdiff1d(np.arange(len(back)), T)
    assert np.array_equal(back[rest], found[:, rest].argmax(0))


def test_another_sampling_of_the_same_shape_stays_near():
    spec_x, spec_y = people(300, 220)
    truth = nearest_vertex(spec_x, spec_y)
    start, wrong = corrupted(truth, 0.4)
    T_xy = np.asarray(pmf(spec_x, spec_y, start).T_xy)
    error = lambda T: np.linalg.norm(
        spec_y.vertices[T] - spec_y.vertices[truth], axis=1
    ).mean()
    assert error(T_xy) < 0.7 * error(start)


def test_relabelling_relabels_and_swapping_swaps():
    spec_x, spec_y, truth = small()
    start, _ = corrupted(truth, 0.3)
    options = {"times": (0.02, 0.003), "eps": 1e-9}
    plain = pmf(spec_x, spec_x, np.argsort(truth)[start], **options)
    moved = pmf(spec_x, spec_y, start, **options)
    assert np.array_equal(truth[plain.T_xy], moved.T_xy)
    swapped = pmf(spec_y, spec_x, np.argsort(start), **options)
    assert np.array_equal(swapped.T_yx, moved.T_xy)


def test_padding_is_invisible():
    spec_x, spec_y, truth = small()
    start, _ = corrupted(truth, 0.3)
    times = (0.01,)
    plain = pmf(spec_x, spec_y, start, times=times)

    def padded(spec, extra):
        # Garbage in the eigenvectors: only the mass may say what is real.
        evecs = jnp.pad(spec.evecs, (extra, (0, 0)), constant_values=7.0)
        return spec._replace(evecs=evecs, mass=jnp.pad(spec.mass, extra))

    n = len(start)
    wide = pmf(
        padded(spec_x, (0, 3)),
        padded(spec_y, (5, 0)),
        np.pad(start + 5, (0, 3)),
        times=times,
    )
    T_xy, T_yx = map(np.asarray, wide)
    assert np.array_equal(T_xy[:n] - 5, plain.T_xy)
    assert np.array_equal(T_yx[5:], plain.T_yx)
    assert not T_xy[n:].any() and not T_yx[:5].any()


def test_wrong_input_is_an_error():
    spec_x, spec_y, truth = small()
    n = len(truth)
    with pytest.raises(ValueError, match=rf"T_xy is \(3,\) int64, .* \({n},\)"):
        pmf(spec_x, spec_y, np.arange(3))
    with pytest.raises(ValueError, match="float64, expected integers"):
        pmf(spec_x, spec_y, truth.astype(float))
    with pytest.raises(ValueError, match=f"T_xy holds {n}, which is no vertex of Y"):
        pmf(spec_x, spec_y, truth + 1)
    hidden = spec_y._replace(mass=spec_y.mass.at[4].set(0.0))
    with pytest.raises(ValueError, match="T_xy holds 4, .* padding"):
        pmf(spec_x, hidden, truth)
    for times in ((), (0.1, 0.2), (0.1, 0.0)):
        with pytest.raises(ValueError, match="give positive diffusion times"):
            pmf(spec_x, spec_y, truth, times=times)
    with pytest.raises(ValueError, match="eps is -1, it must be positive"):
        pmf(spec_x, spec_y, truth, eps=-1)
