"""How neighbours are searched, as an argument: traced tiles, and the rest static."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import testing
from jfsf.convert import nearest
from jfsf.neighbours import NeighbourSearch, NeighbourSettings
from jfsf.neighbours._tiles import tiles

N, M = 60, 50


def points(seed):
    rng = np.random.default_rng(seed)
    return [jnp.asarray(rng.normal(size=(n, 3))) for n in (N, M)]


def held(seed):
    return tuple(map(tiles, points(seed)))


@pytest.mark.slow
def test_equal_static_fields_share_a_program():
    traced = []

    @jax.jit
    def run(x, y, search):
        traced.append(search)
        return nearest(x, y, search=search)

    x, y = points(0)
    for seed in range(3):
        run(x, y, NeighbourSearch(held(seed), 0.5, NeighbourSettings(checked=7)))
    assert len(traced) == 1
    run(x, y, NeighbourSearch(held(0), 0.0, NeighbourSettings(checked=7)))
    run(x, y, NeighbourSearch(held(0), 0.5, NeighbourSettings(checked=8)))
    run(x, y, NeighbourSearch(None, 0.5, NeighbourSettings(checked=7)))
    run(x, y, None)
    assert len(traced) == 5


def test_tiles_are_all_that_is_traced():
    search = NeighbourSearch(held(0), 0.5, NeighbourSettings(checked=7))
    leaves = jax.tree.leaves(search)
    assert len(leaves) == 4 and all(isinstance(x, jax.Array) for x in leaves)
    placed = jax.tree.map(np.asarray, search)
    assert replace(placed, tiles=None) == replace(search, tiles=None)
    assert not jax.tree.leaves(NeighbourSearch())


def test_it_vmaps_over_tiles():
    searches = [NeighbourSearch(held(seed)) for seed in range(2)]
    pairs = [points(seed) for seed in range(2)]
    x, y, search = testing.stack(
        [(*p, s) for p, s in zip(pairs, searches, strict=True)]
    )
    found = jax.vmap(lambda x, y, search: nearest(x, y, search=search))(x, y, search)
    for i in range(2):
        single = nearest(*pairs[i], search=searches[i])
        assert np.array_equal(found.T_xy[i], single.T_xy)


def test_unchecked_changes_the_recall_alone():
    search = NeighbourSearch(held(0), 0.5, NeighbourSettings(checked=7))
    found = search.unchecked()
    assert found.min_recall == 0 and found.tiles is search.tiles
    assert found.settings == search.settings and search.min_recall == 0.5


@pytest.mark.parametrize("min_recall", [-0.1, 1.5, float("nan")])
def test_a_recall_that_is_no_share_is_an_error(min_recall):
    with pytest.raises(ValueError, match=rf"min_recall is {min_recall}, not in \[0, 1"):
        NeighbourSearch(None, min_recall)
