"""Neighbours among candidates against brute force: recall, padding, lost searches."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.convert import nearest, pull_back, sinkhorn
from jfsf.convert._scaling import scale_kernel
from jfsf.convert._variants import quick_sinkhorn
from jfsf.neighbours import (
    NeighbourSearch,
    NeighbourSettings,
    _among_tiles,
    spectral_tiles,
)
from jfsf.neighbours._among_tiles import tiled_neighbours
from jfsf.neighbours._both_ways import mutual_neighbours, neighbours_both_ways
from jfsf.neighbours._tiles import tiles
from jfsf.refine import soft_sinkhorn, zoomout
from jfsf.spectral import restrict, uniform

N, M, WIDTH = 1203, 1101, 12  # more than one level of tiles, neither size round
K0 = 10  # one for most tests: each program takes seconds to compile


def surfaces(seed, n=N, m=M, noise=0.0):
    """Two samplings of one smooth surface, and where the points lie on it."""
    rng = np.random.default_rng(seed)
    waves, phase = rng.normal(size=(2, WIDTH)) * 2, rng.uniform(0, 6, WIDTH)
    flat = [rng.uniform(-1, 1, (size, 2)) for size in (n, m)]
    x, y = (np.sin(at @ waves + phase) for at in flat)
    return x + noise * rng.normal(size=x.shape), y, *flat


def search(x, y, at_x, at_y, k0=K0, dtype=jnp.float64, **options):
    x, y, at_x, at_y = (jnp.asarray(a, dtype) for a in (x, y, at_x, at_y))
    return tiled_neighbours(x, y, tiles(at_x), tiles(at_y), k0=k0, **options)


def recall(near, queries, points, k0=K0):
    """Shares of nearest and of all neighbours found; distances must be right."""
    idx, _ = oracles.neighbours(queries, points, k0)
    found, dist = np.asarray(near.idx), np.asarray(near.dist)
    gap = np.linalg.norm(queries[:, None] - points[found], axis=2)
    np.testing.assert_allclose(dist, gap, rtol=1e-5, atol=1e-12)
    assert (np.diff(dist, axis=1) >= -1e-4 * dist[:, 1:]).all()
    assert all(len(np.unique(row)) == k0 for row in found)
    hits = (found[:, :, None] == idx[:, None]).any(2)
    return (found[:, 0] == idx[:, 0]).mean(), hits.mean()


def test_the_sizes_are_awkward():
    held = tiles(jnp.zeros((M, 2))).member
    settings = NeighbourSettings()
    assert settings.tiles < len(held) and len(held) > _among_tiles.ROOT_TILES
    assert held.size > M


@pytest.mark.parametrize(
    "seed, noise, k0", [(0, 0.05, K0), pytest.param(1, 0.0, 1, marks=pytest.mark.slow)]
)
def test_nearly_all_neighbours_are_found(seed, noise, k0):
    x, y, *flat = surfaces(seed, noise=noise)
    found = search(x, y, *flat, k0)
    assert found.near_xy.idx.dtype == jnp.int32 and found.near_xy.dist.shape == (N, k0)
    for near, q, p in ((found.near_xy, x, y), (found.near_yx, y, x)):
        nearest, every = recall(near, q, p, k0)
        assert nearest > 0.997 and every > 0.99
    assert found.recall > 0.97 and not found.searched_all


@pytest.mark.slow
def test_masked_points_stay_out_where_others_coincide():
    # The oracle of the recall is the exhaustive search, left out here.
    _, _, *flat = surfaces(0)
    place = np.random.default_rng(0).normal(size=(2, 1, WIDTH))
    x, y = np.tile(place[0], (N, 1)), np.tile(place[1], (M, 1))
    valid = np.arange(N) % 3 > 0, np.arange(M) % 3 > 0
    valid_x, valid_y = map(jnp.asarray, valid)
    found = search(x, y, *flat, 10, min_recall=0.0, valid_x=valid_x, valid_y=valid_y)
    far = np.linalg.norm(place[0] - place[1])
    for near, of, among in (
        (found.near_xy, *valid),
        (found.near_yx, *valid[::-1]),
    ):
        np.testing.assert_allclose(near.dist[of], far)
        assert among[np.asarray(near.idx)[of]].all()


@pytest.mark.slow
def test_fewer_tiles_find_fewer_neighbours():
    x, y, *flat = surfaces(0, noise=0.05)
    few = NeighbourSettings(tiles=2)
    found = search(x, y, *flat, 10, min_recall=0.0, settings=few)
    # With the default 28 tiles it is above 0.99.
    assert recall(found.near_xy, x, y, 10)[1] < 0.97


def test_all_points_are_checked_if_the_settings_ask_for_it():
    x, y, *flat = lost()
    every = NeighbourSettings(checked=10**6)
    found = search(x, y, *flat, 1, min_recall=0.0, settings=every)
    shares = [recall(found.near_xy, x, y, 1)[0], recall(found.near_yx, y, x, 1)[0]]
    assert abs(found.recall - min(shares)) < 0.03  # some points have several slots


@pytest.mark.slow
def test_both_ways_is_among_tiles_if_there_are_some():
    x, y, *flat = map(jnp.asarray, surfaces(0, 60, 50))
    held, few = tuple(map(tiles, flat)), NeighbourSettings(tiles=2)
    search = NeighbourSearch(held, 0.0, few)
    found = neighbours_both_ways(x, y, search=search, k0=3)
    wanted = tiled_neighbours(x, y, *held, k0=3, min_recall=0.0, settings=few)
    jax.tree.map(np.testing.assert_array_equal, found, wanted)
    wanted = mutual_neighbours(x, y, k0=3)
    for search in (None, NeighbourSearch()):
        found = neighbours_both_ways(x, y, search=search, k0=3)
        assert found.searched_all and found.recall == 1
        jax.tree.map(np.testing.assert_array_equal, found[:2], wanted)


@pytest.mark.slow
@given(testing.point_sets(150, 4), testing.point_sets(97, 4), st.sampled_from([1, 10]))
def test_few_points_are_all_compared(x, y, k0):
    found = search(x, y, x, y, k0, min_recall=0.0)
    for near, q, p in ((found.near_xy, x, y), (found.near_yx, y, x)):
        # Ties go either way.
        _, dist = oracles.neighbours(q, p, k0)
        np.testing.assert_allclose(near.dist, dist, rtol=1e-5, atol=1e-6)
    assert found.recall == 1


@pytest.mark.slow
def test_many_neighbours():
    x, y, *flat = surfaces(0)
    found = search(x, y, *flat, 100, min_recall=0.0)
    nearest, every = recall(found.near_xy, x, y, 100)
    assert nearest > 0.997 and every > 0.95


@pytest.mark.parametrize(
    "min_recall", [0.95, pytest.param(0.0, marks=pytest.mark.slow)]
)
def test_nearest_among_tiles_is_nearest(min_recall):
    x, y, *flat = surfaces(0)
    held = tuple(tiles(jnp.asarray(at)) for at in flat)
    x, y = jnp.asarray(x), jnp.asarray(y)
    plain, found = (
        nearest(x, y),
        nearest(x, y, search=NeighbourSearch(held, min_recall)),
    )
    assert (found.T_xy == plain.T_xy).mean() > 0.99
    assert (found.T_yx == plain.T_yx).mean() > 0.99


@pytest.mark.slow
def test_a_direction_that_is_not_used_is_left_out():
    x, y, *flat = surfaces(0)
    search = NeighbourSearch(tuple(tiles(jnp.asarray(at)) for at in flat))
    whole = jax.jit(lambda x, y: nearest(x, y, search=search))
    one = jax.jit(lambda x, y: nearest(x, y, search=search).T_xy)
    sizes = [
        len(str(f.lower(jnp.asarray(x), jnp.asarray(y)).compile().as_text()))
        for f in (one, whole)
    ]
    assert sizes[0] < 0.7 * sizes[1]


def test_only_valid_points_take_part():
    x, y, at_x, at_y = surfaces(0)
    valid = [np.random.default_rng(s).random(n) < 0.7 for s, n in ((0, N), (1, M))]
    for points, some in zip((x, y), valid, strict=True):
        points[~some] = np.random.default_rng(2).choice([0, 1e300, np.nan])
    held = [
        tiles(*map(jnp.asarray, pair)) for pair in zip((at_x, at_y), valid, strict=True)
    ]
    found = tiled_neighbours(jnp.asarray(x), jnp.asarray(y), *held, k0=K0)
    assert found.recall > 0.97
    where = [np.flatnonzero(some) for some in valid]
    for near, q, p in ((found.near_xy, 0, 1), (found.near_yx, 1, 0)):
        out = ~valid[q]
        assert not near.idx[out].any() and jnp.isinf(near.dist[out]).all()
        points = (x, y)[p].copy()
        points[~valid[p]] = 0
        queries = (x, y)[q][where[q]]
        idx, dist = oracles.neighbours(queries, points, K0, valid[p])
        assert (np.asarray(near.idx)[where[q]] == idx).mean() > 0.985
        assert valid[p][np.asarray(near.idx)[where[q]]].all()


def test_fewer_valid_points_than_neighbours():
    x, y, *flat = map(jnp.asarray, surfaces(0))
    held = [
        tiles(at, jnp.arange(len(at)) < few)
        for at, few in zip(flat, (N, 3), strict=True)
    ]
    found = tiled_neighbours(x, y, *held, k0=K0)
    assert (np.isfinite(found.near_xy.dist) == (np.arange(K0) < 3)).all()
    assert not found.near_xy.idx[:, 3:].any()


def test_values_that_are_not_finite():
    x, y, *flat = surfaces(0)
    x[3, 1], y[7] = np.nan, np.inf
    found = search(x, y, *flat)
    assert jnp.isinf(found.near_xy.dist[3]).all()
    assert jnp.isinf(found.near_yx.dist[7]).all()
    assert not (found.near_xy.idx == 7).any() and not (found.near_yx.idx == 3).any()
    assert found.recall > 0.97


def test_relabelling_relabels():
    # Other repeated points and another order: the neighbours stay.
    x, y, at_x, at_y = surfaces(0)
    order, other = (
        np.random.default_rng(s).permutation(n) for s, n in enumerate((N, M))
    )
    plain = search(x, y, at_x, at_y)
    moved = search(x[order], y[other], at_x[order], at_y[other])
    back = other[np.asarray(moved.near_xy.idx)]
    assert (back[:, 0] == np.asarray(plain.near_xy.idx)[order, 0]).mean() > 0.997
    assert (back == np.asarray(plain.near_xy.idx)[order]).mean() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("min_recall", [0.0, 0.95])
def test_the_filter_has_the_recall_of_its_search(min_recall):
    x, y, *flat = map(jnp.asarray, lost())
    search = NeighbourSearch(tuple(map(tiles, flat)), min_recall)
    found = neighbours_both_ways(x, y, search=search, k0=10)
    ours = quick_sinkhorn(x, y, search=search)
    assert ours.recall == found.recall and (ours.recall == 1) == (min_recall > 0)
    assert quick_sinkhorn(x, y).recall == 1
    kernel, marginals = ours.kernel, (jnp.full(N, 1 / N), jnp.full(M, 1 / M))
    assert jnp.isnan(scale_kernel(kernel, *marginals).recall)


def lost(*sizes):
    """Tiles of points that are far apart."""
    x, y, at_x, at_y = surfaces(0, *sizes)
    rng = np.random.default_rng(9)
    return x, y, rng.permutation(at_x), rng.permutation(at_y)


def test_a_lost_search_is_exhaustive():
    x, y, *flat = lost()
    found = search(x, y, *flat)
    assert found.searched_all and found.recall == 1
    for near, q, p in ((found.near_xy, x, y), (found.near_yx, y, x)):
        assert np.array_equal(near.idx, oracles.neighbours(q, p, K0)[0])


def test_a_point_nearly_as_near_as_the_nearest_counts():
    x, y, *flat = lost()
    x[:, -1], y[:, -1] = 0, 0
    assert search(x, y, *flat).searched_all
    # The sets are so far apart that all points are within 0.1 % of the nearest.
    x[:, -1] = 100
    found = search(x, y, *flat)
    assert not found.searched_all and found.recall == 1


def test_the_recall_is_estimated():
    x, y, *flat = lost()
    found = search(x, y, *flat, min_recall=0.0)
    assert not found.searched_all
    true = [recall(found.near_xy, x, y)[0], recall(found.near_yx, y, x)[0]]
    assert min(true) < 0.9
    error = np.sqrt(0.25 / NeighbourSettings().checked)
    assert abs(found.recall - min(true)) < 3 * error


def test_float32_agrees_but_for_near_ties():
    x, y, *flat = surfaces(0, noise=0.05)
    wide, narrow = (
        search(x, y, *flat, K0, t, min_recall=0.0) for t in (jnp.float64, jnp.float32)
    )
    assert narrow.near_xy.dist.dtype == narrow.recall.dtype == jnp.float32
    np.testing.assert_allclose(narrow.near_xy.dist, wide.near_xy.dist, rtol=1e-3)
    assert (narrow.near_xy.idx[:, 0] == wide.near_xy.idx[:, 0]).mean() > 0.998


@pytest.mark.parametrize("offset", [100.0, 1e4])
def test_a_common_offset_does_not_cancel(offset):
    x, y, *flat = surfaces(0, noise=0.05)
    found = search(x + offset, y + offset, *flat, min_recall=0.0)
    assert recall(found.near_xy, x + offset, y + offset)[0] > 0.997


def test_vmap_equals_the_loop():
    shapes = [surfaces(seed) for seed in range(2)]
    run = partial(search, min_recall=0.0)
    batch = jax.vmap(run)(*batch_of(*shapes))
    for i, shape in enumerate(shapes):
        single = run(*shape)
        assert np.array_equal(single.near_xy.idx, batch.near_xy.idx[i])
        np.testing.assert_allclose(single.near_yx.dist, batch.near_yx.dist[i])
        assert single.recall == batch.recall[i]


def batch_of(*shapes):
    return [jnp.stack(list(map(jnp.asarray, a))) for a in zip(*shapes, strict=True)]


@pytest.fixture
def exhaustive_searches(monkeypatch):
    """Numbers of points that all others were compared with, one for each search."""
    calls, plain = [], _among_tiles.neighbours_of_valid

    def counted(queries, *args, **options):
        jax.debug.callback(lambda: calls.append(len(queries)))
        return plain(queries, *args, **options)

    monkeypatch.setattr(_among_tiles, "neighbours_of_valid", counted)
    return calls


@pytest.mark.slow
def test_vmap_compares_all_points_only_where_it_must(exhaustive_searches):
    # No other test has these settings: the program is traced here, and counts.
    run = lambda *args: search(*args, 5, settings=NeighbourSettings(checked=61))
    good = [surfaces(seed) for seed in range(4)]
    shapes = *good[:2], lost(), good[3]
    singles = [run(*shape) for shape in shapes]
    for shape in ((4,), (2, 2)):  # one vmap, and two nested ones
        nested = jax.vmap(jax.vmap(run)) if len(shape) == 2 else jax.vmap(run)
        batched = jax.jit(nested)
        batches = [
            [a.reshape(*shape, *a.shape[1:]) for a in batch_of(*some)]
            for some in (good, shapes)
        ]
        jax.effects_barrier()
        exhaustive_searches.clear()
        found = batched(*batches[0])
        jax.effects_barrier()
        assert exhaustive_searches == [] and not found.searched_all.any()
        # Here one element of the batch needs it, in both directions.
        found = batched(*batches[1])
        jax.effects_barrier()
        assert sorted(exhaustive_searches) == [M, N]
        for place, single in zip(np.ndindex(shape), singles, strict=True):
            ours = jax.tree.map(lambda a, place=place: a[place], found)
            assert single.searched_all == ours.searched_all
            assert single.recall == ours.recall
            assert np.array_equal(single.near_xy.idx, ours.near_xy.idx)
            np.testing.assert_allclose(single.near_yx.dist, ours.near_yx.dist)
    assert [bool(single.searched_all) for single in singles] == [
        False,
        False,
        True,
        False,
    ]


@pytest.mark.slow
def test_a_plan_is_differentiable_whether_or_not_all_points_are_compared():
    shapes = [
        tuple(map(jnp.asarray, shape))
        for shape in (surfaces(0, 300, 250), lost(300, 250))
    ]
    soft = partial(soft_sinkhorn, k0=3, length_gradient=True)

    def loss(x, y, at_x, at_y):
        held = tiles(at_x), tiles(at_y)
        search = NeighbourSearch(held, 0.5, NeighbourSettings(tiles=6))
        found = soft(x, y, None, None, search)
        return jnp.sum(jnp.sin(pull_back(found, y))), found.recall

    slope = jax.grad(loss, has_aux=True)
    single = jax.jit(jax.value_and_grad(loss, has_aux=True))
    (_, one), (_, other) = singles = [single(*shape) for shape in shapes]
    (_, recall), (_, exhaustive) = (value for value, _ in singles)
    assert 0.5 <= recall < 1 and exhaustive == 1
    batch = batch_of(*shapes)
    total = lambda x, *rest: jax.vmap(loss)(x, *rest)[0].sum()
    for found in (
        jax.jit(jax.vmap(slope))(*batch)[0],
        jax.jit(jax.grad(total))(*batch),
    ):
        np.testing.assert_allclose(found, jnp.stack([one, other]), rtol=1e-6, atol=1e-9)
    way = jnp.asarray(np.random.default_rng(0).normal(size=(300, WIDTH)))
    step = 1e-6
    for (x, *rest), (_, found) in zip(shapes, singles, strict=True):
        ends = [single(x + sign * step * way, *rest)[0][0] for sign in (1, -1)]
        change = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(jnp.sum(found * way), change, rtol=1e-5)


def test_distances_are_differentiable():
    x, y, at_x, at_y = (jnp.asarray(a) for a in surfaces(0, 60, 50))
    near = lambda x: search(x, y, at_x, at_y, 3, min_recall=0.0).near_xy
    total = jax.jit(jax.value_and_grad(lambda x: near(x).dist.sum()))
    slope = total(x)[1]
    way = jnp.asarray(np.random.default_rng(0).normal(size=x.shape))
    step = 1e-6
    change = (total(x + step * way)[0] - total(x - step * way)[0]) / (2 * step)
    np.testing.assert_allclose(jnp.sum(slope * way), change, rtol=1e-6)


@pytest.mark.parametrize(
    "width, options, message",
    [
        (3, {"k0": 1}, "x has 4 columns, y has 3"),
        (4, {"k0": 0}, "k0 is 0, there are 20 and 10 points"),
        (4, {"k0": 11}, "k0 is 11, there are 20 and 10 points"),
        (4, {"k0": 1, "min_recall": 1.5}, r"min_recall is 1.5, not in \[0, 1\]"),
    ],
)
def test_options_that_do_not_fit_are_an_error(width, options, message):
    run = lambda x, y: tiled_neighbours(x, y, tiles(x), tiles(y), **options)
    with pytest.raises(ValueError, match="tiled_neighbours: " + message):
        jax.eval_shape(run, jnp.ones((20, 4)), jnp.ones((10, width)))


@pytest.mark.parametrize(
    "converter", [pytest.param(nearest, marks=pytest.mark.slow), sinkhorn]
)
def test_converters_agree_with_and_without_tiles(converter):
    x, y, at_x, at_y = map(jnp.asarray, surfaces(0))
    held = tiles(at_x), tiles(at_y)
    # Two rows of X are padding, but the tiles hold them.
    marginals = [uniform(jnp.ones(N).at[:2].set(0)), uniform(jnp.ones(M))]
    plain = converter(x, y, *marginals)
    found = converter(x, y, *marginals, NeighbourSearch(held))
    assert (found.T_xy == plain.T_xy)[2:].mean() > 0.98
    assert (found.T_yx == plain.T_yx).mean() > 0.98
    assert found.T_yx.min() >= 2 and found.T_xy.dtype == jnp.int32


@pytest.mark.slow
def test_zoomout_with_tiles_ends_in_the_same_map():
    x = testing.blob_spectrum(0, 40, 3)
    y = restrict(x, jnp.asarray(np.random.default_rng(0).permutation(642)[:500]))
    held = spectral_tiles(x), spectral_tiles(y)
    run = partial(zoomout, x, y, jnp.eye(10), ks=(10, 20, 30, 40), converter=nearest)
    plain, found = run(), run(search=NeighbourSearch(held))
    assert jnp.linalg.norm(found - plain) < 0.02 * jnp.linalg.norm(plain)


@pytest.mark.parametrize(
    "options",
    [
        {"checked": 0},
        {"bins": 0},
        {"tiles": 27},
        {"tiles": 194},
    ],
)
def test_settings_that_no_search_can_use_are_an_error(options):
    (name,) = options
    with pytest.raises(ValueError, match=f"NeighbourSettings: {name} is "):
        NeighbourSettings(**options)


def test_what_does_not_fit_is_named():
    x, y, *flat = map(jnp.asarray, surfaces(0))
    held = tuple(map(tiles, flat))
    with pytest.raises(ValueError, match="are those of X and Y exchanged"):
        many = jnp.zeros((9000, WIDTH))
        _among_tiles.tiled_one_way(many, y, *held, k0=1)
    with pytest.raises(ValueError, match="emb_x has 12 columns, emb_y has 2"):
        nearest(x, y[:, :2], None, None, NeighbourSearch(held))
    for k0 in (0, M + 1):
        with pytest.raises(ValueError, match=f"k0 is {k0}"):
            _among_tiles.tiled_one_way(x, y, *held, k0=k0)
