"""What ranks maps, against dense oracles."""

from functools import cache, partial

import jax.numpy as jnp
import numpy as np
import oracles_search as oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.initial import _proportions, _search
from jfsf.initial._hypotheses import SamplePair, energies
from jfsf.initial._proportions import log_stretch_std
from jfsf.initial._search import with_orientation
from jfsf.spectral import farthest_points, features
from jfsf.spectral._orientation import PULLED_BACK, brackets, orientation_score

K = 9
OPTIONS = {"compared": 6, "curvature_energy": 0.3}
SIGNS = st.sampled_from([-1, 0, 1])
# Energies are of order 1; float32 has seven digits.
PRECISIONS = pytest.mark.parametrize(
    "dtype, rtol", [(jnp.float64, 1e-10), (jnp.float32, 2e-5)]
)


def shape(seed, samples, dtype):
    """Samples of a blob, two of them padding: copies, whose mass is 0."""
    spec = testing.cast(testing.blob_spectrum(seed, 20, 1), dtype)
    at = np.asarray(farthest_points(spec, num=samples))
    return spec, features(spec).at(jnp.asarray([*at, at[3], at[0]]))


@cache
def pair_of(dtype):
    (spec_x, x), (spec_y, y) = shape(0, 23, dtype), shape(1, 17, dtype)
    for side in (x, y):
        assert (np.asarray(side.spec.mass) == 0).tolist()[-3:] == [False, True, True]
    return (spec_x, spec_y), SamplePair(x, y, False)


def near_identities(seed, dtype, count=3):
    rng = np.random.default_rng(seed)
    maps = np.eye(K) * rng.choice((-1, 1), (count, 1, K))
    return jnp.asarray(maps + 0.3 * rng.normal(size=(count, K, K)), dtype)


def plain(side):
    spec = side.spec
    found = spec.evals, spec.evecs, spec.mass, side.descriptors, side.curvature
    return tuple(np.asarray(a, float) for a in found)


@PRECISIONS
@pytest.mark.parametrize("self_map", [False, True])
def test_energies(dtype, rtol, self_map):
    _, pair = pair_of(dtype)
    C_yx = near_identities(0, dtype)
    ours = energies(pair._replace(self_map=self_map), C_yx, **OPTIONS)
    truth = [
        oracles.energy(
            np.asarray(C, float), plain(pair.x), plain(pair.y), 0.3, 6, self_map
        )
        for C in C_yx
    ]
    assert ours.dtype == dtype
    np.testing.assert_allclose(ours, truth, rtol=rtol)


def test_energies_of_columns_of_zeros():
    _, pair = pair_of(jnp.float64)
    x, y = (
        side._replace(descriptors=side.descriptors.at[:, 2].set(0))
        for side in (pair.x, pair.y)
    )
    C_yx = near_identities(1, jnp.float64, 1)
    ours = energies(SamplePair(x, y, False), C_yx, **OPTIONS)
    truth = oracles.energy(np.asarray(C_yx[0]), plain(x), plain(y), 0.3, 6)
    np.testing.assert_allclose(ours[0], truth)


@pytest.mark.parametrize("pulled_back, k_x", [(4, K), (20, K), (5, K - 2)])
@PRECISIONS
def test_orientation_score(dtype, rtol, pulled_back, k_x):
    (spec_x, spec_y), _ = pair_of(dtype)
    B_x, B_y = brackets(spec_x, k=k_x), brackets(spec_y, k=K - 1)
    score = partial(orientation_score, pulled_back=pulled_back)
    for C in near_identities(2, dtype):
        truth = oracles.orientation(
            *(np.asarray(a, float) for a in (C, B_x, B_y)), pulled_back
        )
        np.testing.assert_allclose(score(C, B_x, B_y), truth, rtol=rtol, atol=rtol)
        assert np.isnan(score(C, 0 * B_x, B_y))
        assert np.isnan(oracles.orientation(np.asarray(C), 0 * B_x, B_y, pulled_back))


@given(seed=testing.seeds, sign=SIGNS, surface=st.booleans())
def test_with_orientation(seed, sign, surface):
    (spec_x, spec_y), _ = pair_of(jnp.float64)
    both = [brackets(spec, k=K) * float(surface) for spec in (spec_x, spec_y)]
    C_yx = near_identities(seed, jnp.float64)
    energy = jnp.arange(1.0, 4.0)
    ours, scores = with_orientation(energy, C_yx, brackets=both, sign=sign)
    half, wrong = _search.HALF_MIRRORED_ENERGY, _search.WRONG_ORIENTATION_ENERGY
    for i, C in enumerate(C_yx):
        tensors = (np.asarray(a) for a in (C, *both))
        score = oracles.orientation(*tensors, PULLED_BACK)
        np.testing.assert_allclose(scores[i], score, atol=1e-10)
        truth = oracles.oriented(float(energy[i]), score, sign, half, wrong)
        np.testing.assert_allclose(ours[i], truth, rtol=1e-10)


@PRECISIONS
def test_log_stretch_std(dtype, rtol):
    _, pair = pair_of(dtype)
    d_x, d_y = (
        np.linalg.norm(points[:, None] - points[None], axis=2)
        for points in (np.asarray(side.spec.vertices) for side in pair[:2])
    )
    C_yx = near_identities(3, dtype)
    distances = (jnp.asarray(d, dtype) for d in (d_x, d_y))
    ours = log_stretch_std(pair, *distances, C_yx)
    constants = _proportions.NEAR, _proportions.COLLAPSED
    sides = [plain(side)[1:3] for side in pair[:2]]
    truth = [
        oracles.log_stretch_std(np.asarray(C, float), *sides, d_x, d_y, *constants)
        for C in C_yx
    ]
    assert ours.dtype == dtype
    np.testing.assert_allclose(ours, truth, rtol=10 * rtol)
