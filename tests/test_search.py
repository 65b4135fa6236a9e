"""The parts of the search for an initial map; what it finds is in test_match too."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.initial import (
    Candidates,
    SearchSettings,
    candidates,
    orientation_sign,
    search,
)
from jfsf.initial._hypotheses import best_different
from jfsf.initial._samples import search_samples
from jfsf.initial._seeds import fits, flips, sign_patterns
from jfsf.spectral import features, wks

DEFAULT, SMALL = SearchSettings(), SearchSettings(hypotheses=61)
SPEC = testing.blob_spectrum(0, DEFAULT.eigenpairs)
DESC = wks(SPEC, num=5)


@pytest.mark.parametrize("side", ["x", "y"])
def test_too_few_eigenpairs_are_an_error(side):
    few = testing.blob_spectrum(0, 20)
    pair = {"spec_x": SPEC, "spec_y": SPEC} | {f"spec_{side}": few}
    with pytest.raises(ValueError, match=f"spec_{side} has 20 eigenpairs, it needs 40"):
        search(pair["spec_x"], pair["spec_y"], DESC, DESC)
    with pytest.raises(ValueError, match="has 20 eigenpairs, the search needs 40"):
        search_samples(features(few))


def test_an_unknown_orientation_is_an_error():
    with pytest.raises(ValueError, match="not 'up'"):
        search(SPEC, SPEC, DESC, jnp.ones_like(DESC), orientation="up")  # type: ignore


def test_orientations_have_signs():
    words = ("preserve", "reverse", "any")
    assert [orientation_sign(word) for word in words] == [1, -1, 0]
    assert orientation_sign(jnp.asarray(-1)) == -1


@pytest.mark.slow
def test_the_smallest_budget_finds_the_identity():
    assert SMALL.parents == 1
    found = search(SPEC, SPEC, DESC, DESC, settings=SMALL, num=3)
    assert isinstance(found, Candidates)
    assert np.array_equal(found.energy, np.sort(found.energy))
    identity = np.eye(DEFAULT.eigenpairs)
    np.testing.assert_allclose(found.C_yx[0], identity, atol=0.05)


@pytest.mark.slow
def test_orthogonal_fits_join_the_starts():
    settings = SearchSettings(hypotheses=63, orthogonal_fits=DEFAULT.fits)
    assert (settings.starts, settings.parents) == (52, 1)
    specs = SPEC, testing.blob_spectrum(1, DEFAULT.eigenpairs)
    x, y = (search_samples(features(spec), settings=settings) for spec in specs)
    found = np.asarray(fits(x, y, 1, settings))
    gaps = [np.linalg.norm(C.T @ C - np.eye(16)) for C in found]
    assert max(gaps[2:]) < min(gaps[:2])
    energy = [candidates(x, y, settings=s).energy[0] for s in (SMALL, settings)]
    assert np.isfinite(energy).all()


def test_the_default_budget():
    sizes = DEFAULT.starts, DEFAULT.flips, DEFAULT.parents, DEFAULT.eigenpairs
    assert sizes == (50, 11, 10, 40)
    assert DEFAULT.starts + DEFAULT.flips * DEFAULT.parents == DEFAULT.hypotheses
    # More hypotheses than there are starts to keep change nothing.
    assert SearchSettings(hypotheses=10_000).parents == DEFAULT.starts
    assert hash(SearchSettings()) == hash(DEFAULT) and SearchSettings() == DEFAULT


@pytest.mark.parametrize(
    "options, message",
    [
        ({"hypotheses": 60}, "hypotheses is 60, the least is 61"),
        (
            {"sign_functions": 4},
            "start_ks begin at 5, sign_functions is 4; make them equal",
        ),
        ({"fit_ks": (16, 18)}, "fit_ks end at 18, start_ks at 20; make them equal"),
        (
            {"fit_size": 15},
            "fit_ks begin at 16, fit_size is 15; fit more functions",
        ),
        (
            {"flip_range": (6, 15)},
            "flip_range ends at 15, flip_ks begin at 16; make them equal",
        ),
        (
            {"flip_range": (6, 21), "flip_ks": (21, 40)},
            r"flip_range is \(6, 21\), starts have 20 functions",
        ),
        (
            {"flip_range": (0, 16), "hypotheses": 200},
            r"flip_range is \(0, 16\), starts have 20 functions",
        ),
        (
            {"flip_ks": (16, 20)},
            "final_ks begin at 30, flip_ks end at 20; begin with no more",
        ),
        (
            {"samples": 2000},
            "samples is 2000, final_samples 1000; it must not be more",
        ),
    ],
)
def test_settings_that_do_not_fit_each_other_are_an_error(options, message):
    with pytest.raises(ValueError, match=f"SearchSettings: {message}"):
        SearchSettings(**options)


@pytest.mark.parametrize("functions", [1, 2, 5])
def test_sign_patterns_are_all_and_each_once(functions):
    found = sign_patterns(functions)
    assert found.shape == (2 ** (functions - 1), functions, functions)
    # Pattern i has the binary digits of i, after the constant, which keeps its sign.
    for i, pattern in enumerate(found):
        signs = [1]
        for place in reversed(range(functions - 1)):
            signs.append(-1 if i >> place & 1 else 1)
        assert np.array_equal(pattern, np.diag(signs))


@pytest.mark.parametrize("first, end", [(6, 16), (1, 2), (3, 7)])
def test_flips_change_none_or_one_sign(first, end):
    truth = [[1] * end]
    for flipped in range(first, end):
        truth.append([-1 if i == flipped else 1 for i in range(end)])
    assert np.array_equal(flips(first, end), truth)


def plain_choice(C_yx, energy, num, group, groups, settings):
    """The definition: lowest energy first, all that are close to it left out."""
    size = settings.compared
    energy, chosen = np.array(energy), []
    for i in range(num):
        turn = i % groups
        mine = [c for c in range(len(energy)) if group[c] == turn]
        best = min(mine, key=lambda c: energy[c])
        chosen.append(best)
        for c in mine:
            gap = C_yx[c][:size, :size] - C_yx[best][:size, :size]
            if np.sum(gap**2) < 2 * size * settings.min_difference:
                energy[c] = np.inf
    return chosen


@pytest.mark.parametrize("groups", [1, 2])
@given(seed=testing.seeds, compared=st.sampled_from([3, 6]))
def test_the_choice_of_different_candidates_matches_the_plain_loop(
    groups, seed, compared
):
    settings = SearchSettings(compared=compared, min_difference=0.2)
    rng = np.random.default_rng(seed)
    # A few maps, each with near copies.
    maps = rng.normal(size=(8, 6, 6))
    C_yx = np.repeat(maps, 3, 0) + 0.03 * rng.normal(size=(24, 6, 6))
    order = rng.permutation(24)
    C_yx, energy = C_yx[order], rng.permutation(24).astype(float)
    group = rng.integers(groups, size=24)
    # As many as each group can give without exhausting it.
    copies = [len(set(order[group == g] // 3)) for g in range(groups)]
    num = groups * min(copies)
    found, differs = best_different(
        jnp.asarray(C_yx),
        jnp.asarray(energy),
        num,
        jnp.asarray(group),
        groups,
        settings=settings,
    )
    truth = plain_choice(C_yx, energy, num, group, groups, settings)
    assert found.tolist() == truth and differs.all()
    # Two of one group come from different maps; two of different groups need not.
    for turn in range(groups):
        assert len(set(order[truth[turn::groups]] // 3)) == len(truth[turn::groups])


def test_nothing_is_chosen_twice_within_a_group():
    C_yx = jnp.stack([jnp.eye(6)] * 2 + [-jnp.eye(6)])
    found, _ = best_different(C_yx, jnp.array([1.0, 0.5, 2.0]), 2, settings=DEFAULT)
    assert found.tolist() == [1, 2]


def test_the_mirror_gap_says_which_side_fits():
    there, other = (
        search(SPEC, SPEC, DESC, DESC, orientation=side, settings=SMALL, num=3)
        for side in ("preserve", "reverse")
    )
    # The blob has no symmetry.
    assert there.mirror_gap > 0 > other.mirror_gap
    free = search(SPEC, SPEC, DESC, DESC, orientation="any", settings=SMALL, num=3)
    assert np.isnan(free.mirror_gap)


def test_a_copy_of_a_better_map_does_not_count_as_different():
    maps = np.random.default_rng(0).normal(size=(4, 6, 6))
    maps[0] = maps[1] + 1e-3
    energy = jnp.array([1.0, 0.9, 2.0, 3.0])
    kept, differs = best_different(jnp.asarray(maps), energy, 4, settings=DEFAULT)
    assert kept.tolist() == [1, 2, 3, 0] and differs.tolist() == [True] * 3 + [False]
