"""Neighbours against brute force: ties, masks, blocks, and limits of float32."""

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from precisions import FLOATS

from jfsf import testing
from jfsf.neighbours import neighbours

N, M, WIDTH = 150, 401, 4  # no multiples of 128 and 16, the sizes of block and group
ks = st.sampled_from([1, 20, M])


def random(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def same(found, idx, dist, rtol=1e-12):
    assert np.array_equal(found.idx, idx)
    np.testing.assert_allclose(found.dist, dist, rtol=rtol)


@given(testing.point_sets(N, WIDTH), testing.point_sets(M, WIDTH), ks)
def test_it_agrees_with_brute_force_ties_included(queries, points, k0):
    found = neighbours(jnp.asarray(queries), jnp.asarray(points), k0=k0)
    same(found, *oracles.neighbours(queries, points, k0))


@given(testing.point_sets(N, WIDTH), testing.point_sets(M, WIDTH), testing.seeds, ks)
def test_only_valid_points_are_chosen(queries, points, seed, k0):
    valid = np.random.default_rng(seed).random(M) < 0.1
    valid[[5, -1]] = False, True
    # Points that are not valid may hold any value.
    points[~valid] = np.random.default_rng(seed).choice([0, 1e300, np.inf, np.nan])
    found = neighbours(*map(jnp.asarray, (queries, points, valid)), k0=k0)
    points[~valid] = 0
    same(found, *oracles.neighbours(queries, points, k0, valid))


def test_no_valid_point_at_all():
    found = neighbours(jnp.ones((3, 2)), jnp.ones((90, 2)), jnp.zeros(90, bool), k0=4)
    assert not found.idx.any() and jnp.isinf(found.dist).all()


@pytest.mark.parametrize("m", [81, 96, 97])
def test_rows_that_fill_the_last_group_are_no_points(m):
    points, valid = random(0, m, 3), np.zeros(m, bool)
    valid[-1] = True
    found = neighbours(*map(jnp.asarray, (random(1, 5, 3), points, valid)), k0=2)
    assert (np.asarray(found.idx) == [m - 1, 0]).all()
    assert (np.isfinite(found.dist) == [True, False]).all()


def test_values_that_are_not_finite():
    queries, points = random(0, N, WIDTH), random(1, M, WIDTH)
    queries[3, 1], queries[4, 0], points[10:30, 2] = np.nan, np.inf, np.nan
    points[7] = -np.inf
    found = neighbours(jnp.asarray(queries), jnp.asarray(points), k0=20)
    assert jnp.isinf(found.dist[3:5]).all() and not found.idx[3:5].any()
    valid = np.isfinite(points).all(1)
    points[~valid] = 0
    kept = np.r_[:3, 5:N]
    idx, dist = oracles.neighbours(queries[kept], points, 20, valid)
    assert np.array_equal(found.idx[kept], idx)
    np.testing.assert_allclose(found.dist[kept], dist)


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("offset", [0.0, 100.0, 1e4, -3e6])
def test_a_common_offset_does_not_cancel(dtype, offset):
    # In float32, |q|^2 - 2 q.p + |p|^2 would have no correct digit.
    queries = jnp.asarray(random(0, N, WIDTH) + offset, dtype)
    points = jnp.asarray(random(1, M, WIDTH) + offset, dtype)
    found = neighbours(queries, points, k0=8)
    assert found.dist.dtype == dtype
    same(found, *oracles.neighbours(queries, points, 8), rtol=1e-5)


@pytest.mark.parametrize("unit", [1e-30, 1e-12, 1e-3, 1e3, 1e12, 1e30])
def test_the_unit_changes_nothing(unit):
    queries, points = random(0, N, WIDTH), random(1, M, WIDTH)
    found = neighbours(jnp.asarray(queries * unit), jnp.asarray(points * unit), k0=8)
    idx, dist = oracles.neighbours(queries, points, 8)
    same(found, idx, dist * unit)


@pytest.mark.parametrize("away", [1e-100, 1e20, 1e60, 1e150])
def test_points_that_coincide_are_found_from_afar(away):
    valid = np.arange(M) % 3 > 0
    queries, points = away * random(0, N, WIDTH), np.tile(random(1, WIDTH), (M, 1))
    points[::2] *= 1 + 1e-15
    found = neighbours(*map(jnp.asarray, (queries, points, valid)), k0=20)
    assert valid[np.asarray(found.idx)].all()
    _, dist = oracles.neighbours(queries, points, 20, valid)
    np.testing.assert_allclose(found.dist, dist, rtol=1e-12)


def test_float32_agrees_but_for_near_ties():
    queries, points = (jnp.asarray(random(s, N, 60), jnp.float32) for s in (0, 1))
    found = neighbours(queries, points, k0=20)
    assert found.idx.dtype == jnp.int32 and found.dist.dtype == jnp.float32
    idx, dist = oracles.neighbours(queries, points, 20)
    np.testing.assert_allclose(found.dist, dist, rtol=1e-5)
    assert (np.asarray(found.idx) != idx).mean() < 1e-3


@given(
    testing.point_sets(N, WIDTH),
    testing.point_sets(M, WIDTH),
    testing.permutations(N),
    testing.permutations(M),
)
def test_relabelling_relabels(queries, points, order, other):
    # Points at equal distances are ordered by their indices, which change.
    plain = neighbours(jnp.asarray(queries), jnp.asarray(points), k0=20)
    moved = neighbours(jnp.asarray(queries[order]), jnp.asarray(points[other]), k0=20)
    assert np.array_equal(moved.dist, plain.dist[order])
    gap = queries[order][:, None] - points[other][moved.idx]
    np.testing.assert_allclose(np.linalg.norm(gap, axis=2), moved.dist)


def test_vmap_equals_the_loop():
    queries, points = jnp.asarray(random(0, 3, N, 4)), jnp.asarray(random(1, 3, M, 4))
    valid = jnp.asarray(random(2, 3, M) > 0)
    run = lambda q, p, v: neighbours(q, p, v, k0=20)
    batch = jax.vmap(run)(queries, points, valid)
    for i in range(3):
        single = run(queries[i], points[i], valid[i])
        same(single, batch.idx[i], batch.dist[i])


def test_more_candidates_change_nothing_but_near_ties():
    queries, points = (jnp.asarray(random(s, N, 60), jnp.float32) for s in (0, 1))
    plain = neighbours(queries, points, k0=5)
    more = neighbours(queries, points, k0=42)
    same(plain, more.idx[:, :5], more.dist[:, :5])


def test_one_query_and_one_point():
    found = neighbours(jnp.zeros((1, 2)), jnp.ones((1, 2)), k0=1)
    same(found, [[0]], [[np.sqrt(2)]])


@pytest.mark.parametrize("k0", [0, 6])
def test_k0_out_of_range_is_an_error(k0):
    with pytest.raises(ValueError, match=f"neighbours: k0 is {k0}, there are 5 points"):
        neighbours(jnp.ones((3, 2)), jnp.ones((5, 2)), k0=k0)


def test_widths_that_differ_are_an_error():
    with pytest.raises(ValueError, match="queries has 2 columns, points has 3"):
        neighbours(jnp.ones((3, 2)), jnp.ones((5, 3)), k0=1)
