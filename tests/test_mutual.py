"""Neighbours both ways from one product, against brute force."""

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import oracles
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from precisions import FLOATS

from jfsf import data, testing
from jfsf.neighbours import NeighbourSearch, NeighbourSettings
from jfsf.neighbours._both_ways import (
    BINS,
    ROWS,
    mutual_neighbours,
    neighbours_both_ways,
)

N, M, WIDTH = 150, 301, 4  # neither fills its last block
FEWEST = 20  # with so many neighbours or more, M points have no bins
MANY_X, MANY_Y, K0 = 2101, 1203, 20  # with K0, bins of 8 and of 4 points


def random(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def arrays(*args):
    return tuple(map(jnp.asarray, args))


def test_the_sizes_are_awkward():
    assert N % ROWS and M % ROWS
    assert M < 2 * BINS * FEWEST and 4 * BINS * K0 < MANY_Y < 8 * BINS * K0 < MANY_X


@given(
    testing.point_sets(N, WIDTH),
    testing.point_sets(M, WIDTH),
    testing.seeds,
    st.sampled_from([FEWEST, N]),
)
def test_few_points_are_all_compared(x, y, seed, k0):
    rng = np.random.default_rng(seed)
    valid_x, valid_y = rng.random(N) < 0.8, rng.random(M) < 0.8
    valid_x[0] = valid_y[0] = True
    # Points that are not valid may hold any value.
    x[~valid_x], y[~valid_y] = rng.choice([0, 1e300, np.inf, np.nan], 2)
    both = mutual_neighbours(*arrays(x, y, valid_x, valid_y), k0=k0)
    xy, yx = jax.tree.map(np.asarray, both)
    x[~valid_x], y[~valid_y] = 0, 0
    for found, sides, valid in (
        (xy, (x, y), (valid_x, valid_y)),
        (yx, (y, x), (valid_y, valid_x)),
    ):
        _, dist = oracles.neighbours(*sides, k0, valid[1])
        dist[~valid[0]] = np.inf
        # Two points may be exchanged whose squared distances differ by less than what
        # `top_k` takes of the digits of float32 for the row: 9 bits of 23.
        np.testing.assert_allclose(
            np.sort(found.dist, 1), dist, rtol=2.0 ** (9 - 23) / 2, atol=1e-6
        )
        known = np.isfinite(found.dist)
        gap = sides[0][:, None] - sides[1][found.idx]
        np.testing.assert_allclose(
            found.dist[known], np.linalg.norm(gap, axis=2)[known]
        )
        assert valid[1][found.idx[known]].all() and not found.idx[~known].any()


def all_found(x, y, k0):
    """Whether all k0 neighbours are found, each way, but for rounding."""
    sides, rtol = ((x, y), (y, x)), 10 * float(np.finfo(x.dtype).eps)
    for near, (queries, points) in zip(
        mutual_neighbours(*arrays(x, y), k0=k0), sides, strict=True
    ):
        _, dist = oracles.neighbours(queries.astype(float), points.astype(float), k0)
        np.testing.assert_allclose(near.dist, dist, rtol=rtol)


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize(
    "k0", [1, 20, *(pytest.param(k0, marks=pytest.mark.slow) for k0 in (5, 40))]
)
def test_all_neighbours_of_points_in_20_dimensions_are_found(dtype, k0):
    x, y = (random(seed, 1000, 20).astype(dtype) for seed in range(2))
    all_found(x, y, k0)


@pytest.mark.slow
@given(testing.seeds, st.sampled_from([1, 2, 8, 32, 128]), st.sampled_from([2, 20]))
def test_neighbours_that_share_bins_are_found(seed, step, k0):
    share_bins(seed, step, k0)


def test_neighbours_that_share_a_bin_are_found():
    share_bins(0, 32, 20)


def share_bins(seed, step, k0):
    """All are found where those near are `step` apart in their file: in one bin."""
    rng = np.random.default_rng(seed)
    place, way = np.arange(MANY_X) // step, np.arange(MANY_X) % step
    places = (way * (MANY_X // step + 1) + place) / 100
    x = places[:, None] + 1e-3 * rng.normal(size=(MANY_X, 2))
    all_found(x, x[rng.permutation(MANY_X)[:MANY_Y]], k0)


def test_points_that_coincide_are_all_found_and_ties_go_to_the_lower_index():
    x = np.repeat(random(0, 40, 3), 30, axis=0)
    xy, yx = mutual_neighbours(*arrays(x, x), k0=20)
    first = np.arange(len(x)) // 30 * 30
    for near in (xy, yx):
        assert (np.asarray(near.idx) == first[:, None] + np.arange(20)).all()
        assert (np.asarray(near.dist) == 0).all()


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("bins", [2, 12])
def test_with_bins_few_neighbours_are_missed_and_recall_says_how_many(dtype, bins):
    settings = NeighbourSettings(bins=bins, checked=1000)
    x, y = arrays(random(0, MANY_X, WIDTH), random(1, MANY_Y, WIDTH))
    x, y = x.astype(dtype), y.astype(dtype)
    search = NeighbourSearch(settings=settings)
    found = neighbours_both_ways(x, y, None, None, search, k0=K0)
    shares = []
    for near, sides in ((found.near_xy, (x, y)), (found.near_yx, (y, x))):
        idx, dist = oracles.neighbours(*(np.asarray(s, float) for s in sides), K0)
        np.testing.assert_allclose(near.dist.min(1), dist[:, 0], rtol=1e-4)
        rows = zip(np.asarray(near.idx), idx, strict=True)
        shares.append(np.mean([len(np.intersect1d(*row)) / K0 for row in rows]))
    assert abs(float(found.recall) - min(shares)) < 0.02
    assert (0.96 if bins == 12 else 0.7) < found.recall < 1


@pytest.mark.slow
def test_all_neighbours_between_meshes_are_found():
    # Neighbours on a mesh are neighbours in its file, or a fixed stride apart.
    x = data.load("man_walk").mesh.vertices.astype(np.float32)
    y = data.load("man_up").mesh.vertices.astype(np.float32)
    all_found(x, y, 10)


@pytest.mark.slow
def test_the_nearest_is_found_among_others_nearly_as_near():
    # Points of one smooth surface are close together, and far from the centre.
    rng = np.random.default_rng(0)
    waves, phase = 2 * rng.normal(size=(2, 12)), rng.uniform(0, 6, 12)
    x, y = (np.sin(rng.uniform(-1, 1, (4000, 2)) @ waves + phase) for _ in range(2))
    for near, sides in zip(
        mutual_neighbours(*arrays(x, y), k0=10), ((x, y), (y, x)), strict=True
    ):
        _, dist = oracles.neighbours(*sides, 10)
        np.testing.assert_allclose(near.dist[:, 0], dist[:, 0], rtol=1e-3)


@pytest.mark.parametrize("noise", [0, 1e-4, 1e-2])
@pytest.mark.parametrize("k0", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_points_that_coincide_find_each_other(noise, k0):
    # Their scores are 0 up to rounding.
    x = random(0, 2000, 8).astype(np.float32)
    order = np.random.default_rng(1).permutation(2000)
    y = (x + noise * random(2, 2000, 8)).astype(np.float32)[order]
    xy, yx = mutual_neighbours(*arrays(x, y), k0=k0)
    idx_xy, idx_yx = np.asarray(xy.idx), np.asarray(yx.idx)
    assert (order[idx_xy] == np.arange(2000)[:, None]).any(1).all()
    assert (idx_yx == order[:, None]).any(1).all()


spreads = st.sampled_from([0, 1e-300, 1e-17, 1e-12, 1e-3, 1.0])


@given(testing.seeds, spreads, spreads, st.booleans(), st.sampled_from([1e-30, 1, 1e9]))
@example(0, 0, 0, False, 1)
def test_masked_points_stay_out_where_others_coincide(seed, by_x, by_y, here, unit):
    rng = np.random.default_rng(seed)
    place, other = rng.normal(size=(2, WIDTH))
    x = unit * (place + by_x * rng.normal(size=(N, WIDTH)))
    y = unit * ((place if here else other) + by_y * rng.normal(size=(M, WIDTH)))
    valid = np.arange(N) % 3 > 0, np.arange(M) % 3 > 0
    for found, sides, of, among in zip(
        mutual_neighbours(*arrays(x, y, *valid), k0=FEWEST),
        ((x, y), (y, x)),
        valid,
        valid[::-1],
        strict=True,
    ):
        dist, idx = np.asarray(found.dist), np.asarray(found.idx)
        assert np.isinf(dist[~of]).all() and np.isfinite(dist[of]).all()
        assert among[idx[of]].all()
        # Up to rounding of places far apart, and to squares that vanish in float64.
        _, near = oracles.neighbours(*sides, 1, among)
        least = 1e-6 * min(by_x, by_y) + 4e-15
        np.testing.assert_allclose(
            dist[of].min(1), near[of, 0], rtol=1e-3, atol=least * unit
        )


def test_values_that_are_not_finite():
    x, y = random(0, N, WIDTH), random(1, M, WIDTH)
    x[3, 1], x[4, 0], y[10:30, 2] = np.nan, np.inf, np.nan
    xy, yx = mutual_neighbours(*arrays(x, y), k0=FEWEST)
    assert jnp.isinf(xy.dist[3:5]).all() and jnp.isinf(yx.dist[10:30]).all()
    assert not np.isin(yx.idx[:10], [3, 4]).any()
    assert not np.isin(xy.idx[:3], np.r_[10:30]).any()


@pytest.mark.parametrize("unit", [1e-30, 1e-3, 1e3, 1e30])
def test_the_unit_and_the_place_change_nothing(unit):
    x, y = random(0, N, WIDTH), random(1, M, WIDTH)
    plain = mutual_neighbours(*arrays(x, y), k0=FEWEST)
    moved = arrays(x * unit + 100 * unit, (y + 100) * unit)
    moved = mutual_neighbours(*moved, k0=FEWEST)
    for near, was in zip(moved, plain, strict=True):
        np.testing.assert_allclose(near.dist, was.dist * unit, rtol=1e-9)


def test_vmap_equals_the_loop():
    x, y = arrays(random(0, 2, MANY_X, 2), random(1, 2, MANY_Y, 2))
    run = lambda x, y: mutual_neighbours(x, y, k0=K0)
    batch = jax.vmap(run)(x, y)
    for i in range(2):
        for one, many in zip(run(x[i], y[i]), batch, strict=True):
            assert np.array_equal(one.idx, many.idx[i])


def test_distances_are_differentiable():
    x, y = arrays(random(0, 40, 3), random(1, 30, 3))
    total = lambda x, y: sum(n.dist.sum() for n in mutual_neighbours(x, y, k0=3))
    jax.test_util.check_grads(total, (x, y), 1, modes=("rev",), rtol=1e-4)


@pytest.mark.parametrize("k0", [0, 4])
def test_k0_out_of_range_is_an_error(k0):
    with pytest.raises(ValueError, match=f"k0 is {k0}, there are 3 and 5 points"):
        mutual_neighbours(jnp.ones((3, 2)), jnp.ones((5, 2)), k0=k0)


def test_widths_that_differ_are_an_error():
    with pytest.raises(ValueError, match="x has 2 columns, y has 3"):
        mutual_neighbours(jnp.ones((3, 2)), jnp.ones((5, 3)), k0=1)
