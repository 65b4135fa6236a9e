"""The confidence and how a map stands among others, against plain numpy.

The factors are fitted anew from time to time: nothing here depends on their values.
"""

import jax
import jax.numpy as jnp
import numpy as np
import oracles_evidence as oracles
import pytest
from certificates import certificate
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logit

from jfsf import testing
from jfsf.matching import confidence
from jfsf.matching._certificate import spectrum_gap
from jfsf.matching._confidence import (
    _AS_IT_IS,
    COMPARED,
    FACTORS,
    LEAST,
    MOST_SHARE,
    RANK_FACTORS,
    confidence_of,
    log_odds,
    mirror_probability,
    rank,
    read_constants,
    region_confidence,
    regressor,
)
from jfsf.matching._kept_landmarks import MISSED
from jfsf.matching._rivals import DISTINCT, MISSED_RANK, rivals_among, share_among
from jfsf.runtime._sizes import pad
from jfsf.spectral._sampling import DISTANCE_PAIRS, biharmonic
from jfsf.types import Certificate, Match

SPEC = testing.blob_spectrum(0, 30)
N = len(SPEC.mass)
NAMES = [name for name in FACTORS if name != "constant"]
BOTH = pytest.mark.parametrize(
    "dtype, rtol", [(jnp.float64, 1e-9), (jnp.float32, 1e-4)]
)


def some_figures(seed=0):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(0.01, 1) for name in Certificate._fields}


def test_the_factors_are_of_figures():
    assert set(NAMES) <= set(Certificate._fields) and len(NAMES) > 1
    assert set(RANK_FACTORS) <= set(Certificate._fields) and RANK_FACTORS
    assert np.isfinite([*FACTORS.values(), *RANK_FACTORS.values()]).all()
    numbers = {"scale", "most_margin", "constant", "log_odds", "margin", "least_share"}
    assert set(COMPARED) == numbers


@BOTH
@pytest.mark.parametrize("of, factors", [(log_odds, FACTORS), (rank, RANK_FACTORS)])
def test_log_odds_and_rank(of, factors, dtype, rtol):
    figures = some_figures()
    found = of(**{name: jnp.asarray(v, dtype) for name, v in figures.items()})
    assert found.dtype == dtype
    truth = oracles.weighed(figures, factors, LEAST, _AS_IT_IS)
    np.testing.assert_allclose(found, truth, rtol=10 * rtol)


@pytest.mark.parametrize("name", NAMES)
def test_log_odds_follow_each_figure(name):
    values = jnp.linspace(0, 1, 9)
    figures = {other: jnp.full(9, value) for other, value in some_figures().items()}
    steps = np.diff(log_odds(**figures | {name: values}))
    assert (steps * np.sign(FACTORS[name]) > 0).all()
    # What is missing is not made up.
    unknown = log_odds(**figures | {name: jnp.full(9, jnp.nan)})
    assert np.isnan(unknown).all()


def test_regressors_are_finite():
    assert regressor("orientation", -0.5) == -0.5
    assert regressor("residual", 0.0) == regressor("residual", -1.0) == np.log(LEAST)


@given(
    z=st.floats(-20, 20),
    share=st.floats(0, 1) | st.just(np.nan),
    missed=st.floats(0, 1),
    told=st.booleans(),
    single=st.booleans(),
)
def test_confidence(z, share, missed, told, single):
    truth = oracles.confidence(z, share, missed, told, COMPARED, MOST_SHARE, 3.0)
    dtype = jnp.float32 if single else jnp.float64
    given = (jnp.asarray(a, dtype) for a in (z, share, missed))
    found = jax.jit(confidence)(*given, told)
    assert found.dtype == dtype and 0 <= found <= 1
    tolerance = {"rtol": 1e-3, "atol": 1e-30} if single else {"rtol": 1e-8}
    np.testing.assert_allclose(found, truth, **tolerance)


def test_confidence_follows_the_evidence():
    values, shares = jnp.linspace(-5, 5, 9), jnp.linspace(0.05, 0.95, 9)
    assert np.all(np.diff(confidence(values)) > 0)
    assert np.all(np.diff(confidence(values, 0.5)) >= 0)
    assert np.all(np.diff(confidence(1.0, shares)) >= 0)
    assert np.all(np.diff(confidence(1.0, 0.5, shares)) < 0)
    np.testing.assert_allclose(confidence(0.0), 0.5)


def test_a_map_that_others_beat_is_not_likely_however_well_it_fits():
    # As a given map has: `match` itself would keep the other one.
    assert confidence(4.0, 0.04) < 0.25 < 0.6 < confidence(4.0, 0.4)
    # And half of what the others have is doubt.
    np.testing.assert_allclose(confidence(20.0, 0.78), 0.89, rtol=1e-6)
    # It is not what decides which of two maps is kept.
    assert confidence(3.0, 0.6, limited=False) > confidence(-0.3, 0.85, limited=False)
    assert confidence(3.0, 0.6) < confidence(-0.3, 0.85)


def test_confidence_is_half_where_left_and_right_cannot_be_told():
    whole, half = (confidence(2.0, 0.7, 0.0, told) for told in (True, False))
    np.testing.assert_allclose(half, whole / 2)


def test_rivals_leave_a_map_its_part():
    sure = confidence(6.0, 0.95)
    for rivals in (0.0, np.nan):
        assert confidence(6.0, 0.95, rivals=rivals) == sure > 0.9
    np.testing.assert_allclose(confidence(6.0, 0.5, rivals=1.0), 1 / 2)
    np.testing.assert_allclose(confidence(6.0, 0.5, rivals=3.0), 1 / 4)
    assert confidence(-6.0, rivals=1.0) == confidence(-6.0)


def test_a_mirror_image_that_fits_far_better_makes_a_map_doubtful():
    sure = confidence(6.0)
    assert confidence(6.0, mirrored=0.0) == sure == confidence(6.0)
    np.testing.assert_allclose(confidence(6.0, mirrored=0.95), 0.05, rtol=1e-5)


def test_a_mirror_image_is_likelier_the_less_energy_it_has():
    found = np.array([mirror_probability(gap) for gap in np.linspace(-0.1, 0.3, 9)])
    assert ((found > 0) & (found < 1)).all() and (np.diff(found) > 0).all()
    # A symmetric shape fits as well either way.
    assert mirror_probability(0.0) < 0.1 < 0.9 < mirror_probability(0.2)


def test_shapes_of_other_kinds_are_in_doubt_whatever_the_map():
    sure = confidence(6.0)
    assert confidence(6.0, spectrum_gap=0.9) == sure > 0.99
    assert 0.8 < confidence(6.0, spectrum_gap=1.09) < 0.9
    np.testing.assert_allclose(confidence(6.0, spectrum_gap=1.6), 0.5, atol=1e-4)
    assert confidence(-6.0, spectrum_gap=1.6) == confidence(-6.0)


def test_the_gap_of_spectra_is_that_of_the_least_alike_eigenvalues():
    other = SPEC._replace(evals=SPEC.evals.at[3].multiply(2.0))
    np.testing.assert_allclose(spectrum_gap(SPEC, other), np.log(2), rtol=1e-3)
    np.testing.assert_allclose(spectrum_gap(other, SPEC), np.log(2), rtol=1e-3)
    assert spectrum_gap(SPEC, SPEC) == 0


def test_there_is_no_confidence_without_evidence():
    assert np.isnan(confidence(jnp.nan)) and np.isnan(confidence(jnp.nan, 0.7))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_region_is_likely_by_its_odds_and_its_cost(dtype):
    b = read_constants("regions")["factors"]

    @jax.jit
    def likely(evidence):
        return region_confidence(evidence, missed_weight=2)

    def of(log_odds, cost, landmarks=(), agreed=np.nan):
        figures = {"region_cost": cost, "person_agreement": agreed}
        own = certificate(log_odds=log_odds, landmarks=landmarks, **figures)
        found = likely(jax.tree.map(lambda v: v.astype(dtype), own))
        assert found.dtype == dtype
        return float(found)

    z = b["constant"] + 1.5 * b["log_odds"] - 18 * b["region_cost"]
    wanted = 1 / (1 + np.exp(-z))
    assert of(1.5, -18.0) == pytest.approx(wanted, rel=1e-5)
    assert of(2.5, -18.0) > of(1.5, -18.0) > of(1.5, -17.0)
    half = np.array([0.0, 9.0])  # one of two is missed
    assert of(1.5, -18.0, landmarks=half) == pytest.approx(wanted**2, rel=1e-5)
    assert np.isnan(of(1.5, np.nan)) and np.isnan(of(np.nan, -18.0))
    # Of people.
    z += b["of_people"] + 0.8 * b["person_agreement"]
    assert of(1.5, -18.0, agreed=0.8) == pytest.approx(1 / (1 + np.exp(-z)), rel=1e-5)
    assert of(1.5, -18.0, agreed=0.8) > of(1.5, -18.0, agreed=0.4)


def test_landmarks_tell_left_from_right_and_may_be_missed():
    evidence = lambda away: certificate(log_odds=2.0, share=0.6, landmarks=away)
    of = lambda told, away=(): confidence_of(evidence(away), told, missed_weight=2)
    known = confidence(2.0, 0.6)
    np.testing.assert_allclose(of(True), known)
    np.testing.assert_allclose(of(False), known / 2)
    np.testing.assert_allclose(of(False, (0.1, 0.2)), known)
    np.testing.assert_allclose(of(True, (0.1, 0.9)), known**2)


NAME = next(iter(RANK_FACTORS))


def standing(maps, ranks, pair=(SPEC, SPEC), missed=None):
    """Of maps whose evidence differs in one figure, so that they rank like this.

    missed: for each, how far landmarks end from their partners.
    """
    worth = np.sign(RANK_FACTORS[NAME])
    matches = []
    for T, r, away in zip(maps, ranks, missed or [()] * len(maps), strict=True):
        own = dict.fromkeys(RANK_FACTORS, 1.0) | {NAME: np.exp(worth * r)}
        evidence = certificate(**own, landmarks=np.asarray(away, float))
        matches.append(Match(T, T, jnp.eye(3), evidence))
    return share_among(matches, pair)


def shares_of(maps, ranks, pair=(SPEC, SPEC)):
    return standing(maps, ranks, pair).share


RNG = np.random.default_rng(0)
# The identity, near copies of it, and maps that differ.
IDENTITY = np.arange(N)
FEW = [RNG.random(N) < 0.01 for _ in range(2)]
COPIES = [np.where(few, RNG.integers(N, size=N), IDENTITY) for few in FEW]
OTHERS = [RNG.permutation(N) for _ in range(2)]
ALL_MAPS = [IDENTITY, *COPIES, *OTHERS, OTHERS[0]]


@pytest.mark.parametrize("seed", range(4))
def test_share_among_against_plain_loops(seed):
    found = standing(ALL_MAPS, np.random.default_rng(seed).normal(size=len(ALL_MAPS)))
    points = np.asarray(biharmonic(SPEC, DISTANCE_PAIRS))
    mass = np.asarray(SPEC.mass)
    options = DISTINCT, COMPARED["scale"]
    truth = oracles.share_among(ALL_MAPS, found.rank, points, mass, *options)
    np.testing.assert_allclose(found.share, truth, rtol=1e-9)
    kinds = np.array([0, 0, 0, 1, 2, 1])
    assert np.array_equal(found.differ, kinds[:, None] != kinds)


def test_shares_of_few_maps():
    maps = [IDENTITY, OTHERS[0], OTHERS[1], COPIES[0]]
    of = lambda numbers, odds: shares_of([maps[i] for i in numbers], odds)
    np.testing.assert_allclose(of([0], [0.3]), [1])
    np.testing.assert_allclose(of([0, 3], [0.3, 5.0]), [1, 1])  # nothing differs
    np.testing.assert_allclose(of([0, 1], [0.3, 0.3]), [1 / 2, 1 / 2])
    np.testing.assert_allclose(of([0, 1, 2], [0.3] * 3), [1 / 3] * 3)
    # A copy of a rival is not another one.
    np.testing.assert_allclose(of([1, 0, 3], [0.3] * 3), [1 / 2] * 3)
    np.testing.assert_allclose(of([0, 1], [0.3, np.nan])[0], 1)
    assert of([0, 1], [0.3, 0.4])[0] < 0.5
    assert np.array_equal(
        np.argsort(standing(maps[:3], [0.2, 0.3, 0.1]).rank), [2, 0, 1]
    )


def test_padding_is_invisible_to_shares():
    odds = np.random.default_rng(0).normal(size=len(ALL_MAPS))
    known = shares_of(ALL_MAPS, odds)
    # What is on padding may be anything.
    longer = [np.r_[T, RNG.integers(N, size=9)] for T in ALL_MAPS]
    found = shares_of(longer, odds, (pad(SPEC, N + 9, 340), pad(SPEC, N + 5, 330)))
    np.testing.assert_allclose(found, known, rtol=1e-9)


def test_a_map_that_misses_landmarks_ranks_lower():
    maps, far = [IDENTITY, OTHERS[0]], 2 * MISSED
    plain = standing(maps, [0.5, 0.5])
    found = standing(maps, [0.5, 0.5], missed=[(0.1, 0.1), (far, 0.1)])
    assert found.rank[0] == plain.rank[0] > found.rank[1]
    lost = plain.rank[1] - found.rank[1]
    np.testing.assert_allclose(lost, MISSED_RANK / 2)
    assert found.share[0] > 0.5 > found.share[1]


def test_rivals_are_maps_that_differ_and_are_as_likely():
    def rivals(maps, likely, odds):
        found = share_among(
            matches := [
                Match(T, T, jnp.eye(3), certificate(log_odds=logit(p)))
                for T, p in zip(maps, likely, strict=True)
            ],
            (SPEC, SPEC),
        )
        found = found._replace(rank=np.array(odds) / COMPARED["scale"])
        return rivals_among(matches, found).tolist()

    maps = [IDENTITY, OTHERS[0], OTHERS[1], COPIES[0]]
    assert rivals(maps[:1], [0.95], [0]) == [0]
    assert rivals(maps, [0.95] * 4, [0, 0.5, 0.1, 0]) == [2, 2, 2, 2]
    # One that ranks lower is no rival of those above it, but they are of it.
    assert rivals(maps[:3], [0.95] * 3, [0, 0.5, -2]) == [1, 1, 2]
    # Maps in doubt neither have nor are rivals.
    assert rivals(maps[:3], [0.95, 0.95, 0.6], [0, 0, 0]) == [1, 1, 0]
