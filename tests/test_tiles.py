"""Tiles: a partition of any points into compact groups of equal size."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.neighbours import spectral_tiles
from jfsf.neighbours._tiles import tiles, tiles_of_pair
from jfsf.runtime._sizes import pad

N = 203


def tile_of(found, n):
    """The tile of each point; -1 for none. Fails if a point has two slots."""
    member, valid = np.asarray(found.member), np.asarray(found.valid)
    where = np.full(n, -1)
    where[member[valid]] = np.nonzero(valid)[0]
    assert valid.sum() == (where >= 0).sum()
    return where


@given(testing.point_sets(N, 3), st.sampled_from([1, 7, 16, N, 500]))
def test_every_point_has_one_slot(points, size):
    found = tiles(jnp.asarray(points), size=size)
    count, width = found.member.shape
    assert width <= size and count & (count - 1) == 0
    assert count == 1 or -(-N // (count // 2)) > size  # no more tiles than it takes
    assert found.member.min() >= 0 and found.member.max() < N
    assert (tile_of(found, N) >= 0).all()


@given(testing.point_sets(N, 3), testing.seeds)
def test_points_that_are_not_valid_have_no_slot(points, seed):
    valid = np.random.default_rng(seed).random(N) < 0.4
    points[~valid] = 1e9
    points[:2], valid[:2] = [[np.nan], [np.inf]], True
    where = tile_of(tiles(jnp.asarray(points), jnp.asarray(valid)), N)
    valid[:2] = False
    assert np.array_equal(where >= 0, valid)


def test_no_valid_point_at_all():
    found = tiles(jnp.ones((9, 2)), jnp.zeros(9, bool), size=4)
    assert not found.valid.any() and found.member.max() < 9


def test_tiles_are_compact_and_so_are_their_groups():
    points = np.random.default_rng(0).uniform(size=(4096, 2))
    where = tile_of(tiles(jnp.asarray(points)), 4096)
    for group in (1, 4, 16):
        side = np.sqrt(16 * group / 4096)
        for number in range(256 // group):
            part = points[where // group == number]
            assert len(part) == 16 * group
            assert np.linalg.norm(np.ptp(part, 0)) < 3.5 * side


@given(testing.permutations(224))
def test_relabelling_relabels(order):
    # 32 tiles of 7: no slot repeats a point.
    points = np.random.default_rng(0).normal(size=(224, 3))
    plain = tile_of(tiles(jnp.asarray(points), size=7), 224)[order]
    moved = tile_of(tiles(jnp.asarray(points[order]), size=7), 224)
    # The order of two halves may change, the points of a tile do not.
    same_tile = lambda tile: tile[:, None] == tile[None]
    assert np.array_equal(same_tile(plain), same_tile(moved))


def test_signs_and_padding_of_a_spectrum():
    spec = testing.blob_spectrum(0, 30)
    n = len(spec.mass)
    plain = tile_of(spectral_tiles(spec), n)
    by = np.random.default_rng(0).choice((-1.0, 1.0), 30)
    by[0] = 1
    assert np.array_equal(
        tile_of(spectral_tiles(testing.flip_signs(spec, by)), n), plain
    )
    padded = tile_of(spectral_tiles(pad(spec, n + 40, len(spec.faces))), n + 40)
    assert (padded[:n] >= 0).all() and (padded[n:] == -1).all()


def test_a_tile_has_no_more_points_than_asked_for():
    spec = testing.blob_spectrum(0, 30)
    for size in (7, 16, 30):
        assert size / 2 < spectral_tiles(spec, size=size).member.shape[1] <= size


@pytest.mark.parametrize("other", [0, 1])
def test_tiles_of_a_pair_are_those_of_each(other):
    specs = testing.blob_spectrum(0, 30), testing.blob_spectrum(other, 30)
    for found, spec in zip(tiles_of_pair(*specs), specs, strict=True):
        assert np.array_equal(found.member, spectral_tiles(spec).member)


def test_vmap_equals_the_loop():
    points = jnp.asarray(np.random.default_rng(0).normal(size=(3, N, 4)))
    batch = jax.vmap(tiles)(points)
    for i in range(3):
        single = tiles(points[i])
        assert np.array_equal(single.member, batch.member[i])
        assert np.array_equal(single.valid, batch.valid[i])


@pytest.mark.parametrize("n, size", [(0, 4), (5, 0)])
def test_no_points_or_no_size_is_an_error(n, size):
    with pytest.raises(ValueError, match=f"size is {size}, there are {n} points"):
        tiles(jnp.zeros((n, 2)), size=size)
