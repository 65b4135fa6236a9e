"""Which shapes of a collection are mirror images, by the votes of all pairs."""

from itertools import product

import numpy as np
import pytest
from scipy.special import comb

from jfsf.apps.collections._cycles import first_pairs, unlikeness
from jfsf.apps.collections._engine import mirrored
from jfsf.apps.collections._grow import Graph, Matched, MirrorTest, best_paths
from jfsf.apps.collections._mirror import mirror_images, suspects
from jfsf.apps.collections._sides import sides, votes
from jfsf.types import Maps

NONE = Maps(np.zeros(1), np.zeros(1))


def cost(vote, side) -> float:
    """Negative log likelihood of a division, but for a constant."""
    agreed = sum(own * side[a] * side[b] for (a, b), own in vote.items())
    ways = comb(len(side), int((np.asarray(side) < 0).sum()))
    return float(np.log(ways) - agreed / 2)


def a_vote(rng, side):
    """Of the pairs that a collection matches first; a few votes are wrong."""
    rows = rng.normal(size=(len(side), 3))
    found = {}
    for a, b in first_pairs(unlikeness(rows)):
        true = side[a] * side[b] * rng.uniform(1, 4.6)
        found[a, b] = true * rng.choice([1, 0, -1], p=[0.8, 0.12, 0.08])
    return found


def test_the_division_is_the_most_likely_of_all():
    best = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        vote = a_vote(rng, np.where(rng.uniform(size=9) < 0.3, -1, 1))
        found = sides(vote, 9, 4)
        assert found[4] == 1 and set(found) <= {1, -1}
        every = [s for s in product((1, -1), repeat=9) if s[4] == 1]
        least = min(cost(vote, s) for s in every)
        assert cost(vote, found) <= cost(vote, np.ones(9)) + 1e-9
        best += cost(vote, found) < least + 1e-6
    assert best >= 38, best


def test_sides_do_not_depend_on_the_order_of_the_shapes():
    rng = np.random.default_rng(1)
    side = np.where(np.arange(60) % 3 == 2, -1, 1)
    pairs = {tuple(sorted(p)) for p in rng.integers(60, size=(240, 2)).tolist()}
    vote = {(a, b): 3.0 * side[a] * side[b] for a, b in sorted(pairs) if a != b}
    for edge in sorted(vote)[::10]:
        vote[edge] *= -1  # wrong, and as sure as the others
    assert (sides(vote, 60, 0) == side).all()
    order = rng.permutation(60)
    turned = {tuple(sorted((order[a], order[b]))): own for (a, b), own in vote.items()}
    assert (sides(turned, 60, int(order[0]))[order] == side).all()


def test_a_few_maps_between_two_groups_of_bodies_do_not_divide_them():
    """500 bodies each, in other poses: four of six maps between them fit mirrored."""
    rows = {(i, i + 1): 4.6 for i in range(999) if i != 499}
    between = {(499 - i, 500 + i): own for i, own in enumerate((4, -4, -4, 4, -4, -4))}
    assert (sides(rows | between, 1000, 0) == 1).all()
    # Of five left bones and five right ones they do: there are fewer divisions.
    rows = {(i, i + 1): 4.6 for i in range(9) if i != 4}
    between = {(4 - i, 5 + i): own for i, own in enumerate((4, -4, -4, -4, -4))}
    assert sides(rows | between, 10, 0).tolist() == [1] * 5 + [-1] * 5


def chain(middle: float):
    """Four shapes in a row; by other maps the last two are mirror images."""
    right = {(0, 1): 0.99, (1, 2): middle, (2, 3): 0.99, (0, 2): 0.03, (0, 3): 0.02}
    likely = {edge: 1 - p if p < 0.5 else np.nan for edge, p in right.items()}
    maps = {edge: Matched(NONE, p, 0.6, likely[edge]) for edge, p in right.items()}
    return Graph(maps, [], right, best_paths(right, 4, template=0), np.ones(4, bool))


@pytest.mark.parametrize("middle", [0.9, 0.98])
def test_mirror_images_that_joined_by_a_wrong_map_are_found_by_other_maps(middle):
    # However sure that map is.
    graph, unlike = chain(middle), 1.0 - np.eye(4)
    assert graph.paths.way(3) == [0, 1, 2, 3]
    assert mirror_images(graph) == {2, 3}
    assert suspects(graph, unlike) == [(2, 0), (2, 1), (3, 0), (3, 1)]
    # One that has not joined is tried too.
    outside = graph._replace(joined=np.array([True, False, True, True]))
    assert suspects(outside, unlike) == [(1, 0), (2, 0), (3, 0)]


def test_where_the_mirror_image_was_matched_that_decides():
    graph = chain(0.9)
    straight = {i: graph.right[0, i] for i in (2, 3)}
    tests = tuple(MirrorTest(i, 0, straight[i], 0.96, 0.25) for i in (2, 3))
    found = graph._replace(tests=tests)
    assert mirror_images(found) == {2, 3}
    # The surer one of what the map says and of what the mirror image says counts.
    vote = votes(found.matched, tests)
    assert vote[0, 2] == pytest.approx(-np.log(0.97 / 0.03))
    sure = tests[0]._replace(turned=0.98)
    assert votes(found.matched, [sure])[0, 2] == pytest.approx(-np.log(0.98 / 0.02))
    # Its own mirror image, or in a mirrored pose: at the same distances.
    for other in ({"energy_gap": 0.03}, {"energy_gap": np.nan}, {"turned": 0.5}):
        none = tuple(test._replace(**other) for test in tests)
        assert mirror_images(graph._replace(tests=none)) == frozenset()
        # Of two tests of a pair the one that finds a mirror image counts.
        assert mirror_images(graph._replace(tests=tests + none)) == {2, 3}


def test_the_sentence_quotes_a_test_that_says_so():
    test = MirrorTest(2, 0, 0.02, 0.96, 0.25)
    both = test._replace(turned=0.95), test._replace(turned=0.99, energy_gap=0.03)
    graph = chain(0.9)._replace(tests=both, mirrored=frozenset({2, 3}))
    assert "0.95" in mirrored(graph, tuple("abcd"), 2)
    found = graph._replace(tests=(test,))
    assert "by way of another mirror image" in mirrored(found, tuple("abcd"), 3)
