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
    orientation_sign,
    search,
)
from jfsf.initial._hypotheses import best_different
from jfsf.initial._samples import search_samples
from jfsf.initial._search import flips, sign_patterns
from jfsf.initial._settings import FLIPS, STARTS
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
        orientation_sign("up")  # type: ignore


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


def test_the_default_budget():
    sizes = STARTS, FLIPS, DEFAULT.parents, DEFAULT.eigenpairs
    assert sizes == (50, 11, 10, 40)
    assert STARTS + FLIPS * DEFAULT.parents == DEFAULT.hypotheses
    # More hypotheses than there are starts to keep change nothing.
    assert SearchSettings(hypotheses=10_000).parents == STARTS
    assert hash(SearchSettings()) == hash(DEFAULT) and SearchSettings() == DEFAULT


@pytest.mark.parametrize(
    "options, message",
    [
        ({"hypotheses": 60}, "hypotheses is 60, the least is 61"),
        ({"final_ks": (31, 40)}, "final_ks begin at 31; begin with 30 or fewer"),
        ({"nonisometric_candidates": 0}, "nonisometric_candidates is 0"),
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


def plain_choice(C_yx, energy, num, group, groups, compared):
    """The definition: lowest energy first, all that are close to it left out."""
    size = compared
    energy, chosen = np.array(energy), []
    for i in range(num):
        turn = i % groups
        mine = [c for c in range(len(energy)) if group[c] == turn]
        best = min(mine, key=lambda c: energy[c])
        chosen.append(best)
        for c in mine:
            gap = C_yx[c][:size, :size] - C_yx[best][:size, :size]
            if np.sum(gap**2) < 2 * size * 0.2:
                energy[c] = np.inf
    return chosen


@pytest.mark.parametrize("groups", [1, 2])
@given(seed=testing.seeds, compared=st.sampled_from([3, 6]))
def test_the_choice_of_different_candidates_matches_the_plain_loop(
    groups, seed, compared
):
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
        compared=compared,
        min_difference=0.2,
    )
    truth = plain_choice(C_yx, energy, num, group, groups, compared)
    assert found.tolist() == truth and differs.all()
    # Two of one group come from different maps; two of different groups need not.
    for turn in range(groups):
        assert len(set(order[truth[turn::groups]] // 3)) == len(truth[turn::groups])


def test_nothing_is_chosen_twice_within_a_group():
    C_yx = jnp.stack([jnp.eye(6)] * 2 + [-jnp.eye(6)])
    found, _ = best_different(C_yx, jnp.array([1.0, 0.5, 2.0]), 2)
    assert found.tolist() == [1, 2]


def test_the_mirror_gap_says_which_side_fits():
    there, other = (
        search(SPEC, SPEC, DESC, DESC, sign, settings=SMALL, num=3) for sign in (1, -1)
    )
    # The blob has no symmetry.
    assert there.mirror_gap > 0 > other.mirror_gap
    free = search(SPEC, SPEC, DESC, DESC, 0, settings=SMALL, num=3)
    assert np.isnan(free.mirror_gap)


def test_a_copy_of_a_better_map_does_not_count_as_different():
    maps = np.random.default_rng(0).normal(size=(4, 6, 6))
    maps[0] = maps[1] + 1e-3
    energy = jnp.array([1.0, 0.9, 2.0, 3.0])
    kept, differs = best_different(jnp.asarray(maps), energy, 4)
    assert kept.tolist() == [1, 2, 3, 0] and differs.tolist() == [True] * 3 + [False]
