"""Tiles: a partition into compact groups of equal size, whatever the points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.padding import pad
from jfsf.tiles import spectral_tiles, tiles

N = 203


def own(found, n):
    """The tile of each point; -1 for none. Fails where a point has two slots."""
    member, real = np.asarray(found.member), np.asarray(found.real)
    where = np.full(n, -1)
    where[member[real]] = np.nonzero(real)[0]
    assert real.sum() == (where >= 0).sum()
    return where


@given(testing.point_sets(N, 3), st.sampled_from([1, 7, 16, N, 500]))
def test_every_point_has_one_slot(points, size):
    found = tiles(jnp.asarray(points), size=size)
    count, width = found.member.shape
    assert width <= size and count & (count - 1) == 0
    assert count == 1 or -(-N // (count // 2)) > size  # no more tiles than it takes
    assert found.member.min() >= 0 and found.member.max() < N
    assert (own(found, N) >= 0).all()


@given(testing.point_sets(N, 3), testing.seeds)
def test_what_takes_no_part_has_no_slot(points, seed):
    valid = np.random.default_rng(seed).random(N) < 0.4
    points[~valid] = 1e9
    points[:2], valid[:2] = [[np.nan], [np.inf]], True
    where = own(tiles(jnp.asarray(points), jnp.asarray(valid)), N)
    valid[:2] = False
    assert np.array_equal(where >= 0, valid)


def test_no_valid_point_at_all():
    found = tiles(jnp.ones((9, 2)), jnp.zeros(9, bool), size=4)
    assert not found.real.any() and found.member.max() < 9


def test_tiles_are_compact_and_so_are_their_groups():
    points = np.random.default_rng(0).uniform(size=(4096, 2))
    where = own(tiles(jnp.asarray(points)), 4096)
    for group in (1, 4, 16):
        side = np.sqrt(16 * group / 4096)
        for number in range(256 // group):
            part = points[where // group == number]
            assert len(part) == 16 * group
            assert np.linalg.norm(np.ptp(part, 0)) < 3.5 * side


@given(testing.permutations(224))
def test_relabelling_relabels(order):
    # 32 tiles of 7, so that no slot is filled up.
    points = np.random.default_rng(0).normal(size=(224, 3))
    plain = own(tiles(jnp.asarray(points), size=7), 224)[order]
    moved = own(tiles(jnp.asarray(points[order]), size=7), 224)
    # Which half comes first may change, which points stay together does not.
    together = lambda tile: tile[:, None] == tile[None]
    assert np.array_equal(together(plain), together(moved))


def test_signs_and_padding_of_a_spectrum():
    spec = testing.blob_spectrum(0, 30)
    n = len(spec.mass)
    plain = own(spectral_tiles(spec), n)
    by = np.random.default_rng(0).choice((-1.0, 1.0), 30)
    by[0] = 1
    assert np.array_equal(own(spectral_tiles(testing.flip_signs(spec, by)), n), plain)
    padded = own(spectral_tiles(pad(spec, n + 40, len(spec.faces))), n + 40)
    assert (padded[:n] >= 0).all() and (padded[n:] == -1).all()


def test_vmap_equals_the_loop():
    points = jnp.asarray(np.random.default_rng(0).normal(size=(3, N, 4)))
    batch = jax.vmap(tiles)(points)
    for i in range(3):
        single = tiles(points[i])
        assert np.array_equal(single.member, batch.member[i])
        assert np.array_equal(single.real, batch.real[i])


@pytest.mark.parametrize("n, size", [(0, 4), (5, 0)])
def test_nothing_to_tile_is_an_error(n, size):
    with pytest.raises(ValueError, match=f"size is {size}, there are {n} points"):
        tiles(jnp.zeros((n, 2)), size=size)
