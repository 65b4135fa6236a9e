"""BCICP: each step does what it says, and together they repair maps."""

from functools import cache, partial

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.paper.baselines import _bcicp as steps
from experiments.paper.baselines import bcicp
from jfsf import testing
from jfsf.convert import nearest
from jfsf.evaluate import bijectivity, coverage, geodesic_error
from jfsf.types import Maps, Mesh

# Methods of others, for a table of the experiments: they seldom change.
pytestmark = pytest.mark.slow

K = 20
N_X, N_Y = 642, 162
EVERY_X, EVERY_Y = np.arange(N_X), np.arange(N_Y)
run = partial(bcicp, k=K, num_iters=3)


@cache
def shape(subdivisions=3):
    mesh = testing.blob(2, subdivisions=subdivisions)
    return mesh, testing.blob_spectrum(2, K, subdivisions), steps.surface(mesh)


def covered(T, n):
    return len(np.unique(T)) / n


def random_map(n, m, seed, images=None):
    return np.random.default_rng(seed).integers(images or m, size=n)


def scores(maps, mesh_x, mesh_y, spec_y, gt_x, gt_y):
    T_xy, T_yx = map(np.asarray, maps)
    return (
        geodesic_error(T_xy, mesh_y, gt_x, gt_y).mean(),
        bijectivity(T_xy, T_yx, mesh_x, at=gt_x[::5]).mean(),
        float(coverage(T_xy, np.asarray(spec_y.mass))),
    )


def rough(spec_x, spec_y, wrong, seed=0, k=6):
    """Nearest neighbours in few eigenfunctions of one surface, some then at random."""
    emb = (spec_x.evecs[:, :k], spec_y.evecs[:, :k])
    rng = np.random.default_rng(seed)
    out = []
    for T, m in zip(nearest(*emb), (len(emb[1]), len(emb[0])), strict=True):
        T, bad = np.array(T), rng.random(len(T)) < wrong
        T[bad] = rng.integers(m, size=bad.sum())
        out.append(T)
    return Maps(*out)


def test_a_corrupted_self_map_is_repaired():
    mesh, spec, _ = shape()
    start = rough(spec, spec, 0.3)
    ends = mesh, mesh, spec, EVERY_X[::4], EVERY_X[::4]
    before = scores(start, *ends)
    after = scores(run(mesh, mesh, spec, spec, start), *ends)
    assert after[0] < 0.1 * before[0]
    assert after[1] < 0.1 * before[1]
    assert after[2] > 0.95 > 0.8 > before[2]


def test_shapes_of_other_sizes_and_labels():
    # The coarse sphere's vertices are the fine one's first.
    mesh_x, spec_x, _ = shape()
    order = np.random.default_rng(0).permutation(N_Y)
    mesh_y = testing.relabel(shape(2)[0], order)
    spec_y = testing.blob_spectrum(2, K, 2)
    # Eigenvectors of the two samplings, in one basis.
    by = np.sign(np.sum(np.asarray(spec_x.evecs[:N_Y] * spec_y.evecs), 0))
    spec_y = testing.relabel_spectrum(testing.flip_signs(spec_y, by), order)
    start = rough(spec_x, spec_y, 0.1)
    ends = mesh_x, mesh_y, spec_y, order, EVERY_Y
    before, found = scores(start, *ends), run(mesh_x, mesh_y, spec_x, spec_y, start)
    assert found.T_xy.shape == (N_X,) and found.T_yx.shape == (N_Y,)
    assert found.T_xy.dtype == found.T_yx.dtype == jnp.int32
    after = scores(found, *ends)
    assert after[0] < 0.5 * before[0] and after[1] < 0.7 * before[1]
    assert after[2] == 1


def test_the_same_again_and_in_other_units():
    mesh, spec, _ = shape(2)
    start = rough(spec, spec, 0.3)
    one = run(mesh, mesh, spec, spec, start)
    again = run(mesh, mesh, spec, spec, start)
    big = mesh._replace(vertices=1024 * mesh.vertices)
    other = run(big, mesh, spec, spec, start)
    for T, *rest in zip(one, again, other, strict=True):
        assert all(np.array_equal(T, U) for U in rest)


def test_the_identity_stays():
    mesh, spec, _ = shape()
    same = Maps(EVERY_X, EVERY_X)
    for T in bcicp(mesh, mesh, spec, spec, same, k=K, num_iters=1):
        assert np.array_equal(T, EVERY_X)


def test_no_round_is_the_start():
    mesh, spec, x = shape(2)
    start = rough(spec, spec, 0.3)
    same = bcicp(mesh, mesh, spec, spec, start, k=K, num_iters=0, num_start=0)
    improved = steps.improve(start.T_xy, start.T_yx, x, x)
    assert all(np.array_equal(a, b) for a, b in zip(same, improved, strict=True))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("images", [5, 40, None])
def test_coverage_steps_never_lower_coverage(seed, images):
    x = shape(2)[2]
    T_xy = random_map(N_Y, N_Y, seed, images)
    T_yx = random_map(N_Y, N_Y, seed + 100)
    fills = (
        steps.fill_from_inverse(T_xy, T_yx),
        steps.fill_nearby(T_xy, T_yx, x),
        steps.fill_nearby(T_xy, T_yx, x, slack=0.02),
    )
    for T_new in fills:
        moved = T_new != T_xy
        gained = len(np.unique(T_new)) - len(np.unique(T_xy))
        assert moved.any() and gained == moved.sum()
        assert not np.isin(T_new[moved], T_xy).any()
    for T_new, slack in zip(fills[1:], (0.0, 0.02), strict=True):
        w = np.flatnonzero(T_new != T_xy)
        old, new = x.dist[T_yx[T_xy[w]], w], x.dist[T_yx[T_new[w]], w]
        assert (new <= old * (1 + slack)).all()
    # The inverse map says which vertex covers which.
    w = np.flatnonzero(fills[0] != T_xy)
    assert np.array_equal(T_yx[fills[0][w]], w)


def test_improving_raises_coverage_and_mends_tears():
    _, spec, x = shape()
    T_xy, T_yx = rough(spec, spec, 0.2)
    found = steps.improve(T_xy, T_yx, x, x)
    for T_new, T in zip(found, (T_xy, T_yx), strict=True):
        assert len(np.unique(T_new)) > 1.05 * len(np.unique(T))
        assert len(steps._torn(T_new, x, x)[0]) < 0.5 * len(steps._torn(T, x, x)[0])
    gap = lambda maps: x.dist[EVERY_X, maps[1][maps[0]]].mean()
    assert gap(found) < 0.5 * gap((T_xy, T_yx))


def test_all_that_share_an_image_do_not_leave_it_at_once():
    # 1, 2, 3 all map to 0, and the inverse offers each of them another image.
    T = steps.fill_from_inverse(np.array([4, 0, 0, 0, 4]), np.array([1, 1, 2, 3, 0]))
    assert 0 in T and len(np.unique(T)) == 4


def test_planted_outliers_are_replaced_and_nothing_else():
    x = shape()[2]
    # Places where two edges are shorter than the longest one anywhere.
    rings = [x.ring[v].indices for v in range(N_X)]
    second = [np.setdiff1d(x.ring[r].indices, [*r, v]) for v, r in enumerate(rings)]
    reach = np.array([x.dist[v, s].min() for v, s in enumerate(second)])
    planted, free = [], reach < 0.9 * x.longest
    for v in range(N_X):
        if free[v]:
            planted.append(v)
            free[x.dist[v] < 4 * x.longest] = False
    assert len(planted) > 2
    T = EVERY_X.copy()
    T[planted] = np.argmax(x.dist[planted], 1)
    found = steps.replace_outliers(T, x, x)
    around = np.unique(np.concatenate([[v, *rings[v]] for v in planted]))
    away = np.setdiff1d(EVERY_X, around)
    assert np.array_equal(found[away], away)
    # Where they go is where the nearest vertex that was not torn goes.
    for v in planted:
        nearest_good = away[x.dist[v, away].argmin()]
        assert x.dist[v, found[v]] == x.dist[v, nearest_good] < x.longest
    # The rest of the step puts every one of them right.
    for _ in range(4):
        found = steps.replace_outliers(steps._smooth_torn(found, x, x), x, x)
    assert x.dist[EVERY_X, found].max() <= x.longest


def test_a_large_region_is_no_outlier():
    x = shape()[2]
    # A fifth of the shape goes where nothing else of it goes.
    region = np.argsort(x.dist[0])[: N_X // 5]
    T = np.full(N_X, np.argmax(x.dist[0]))
    T[region] = 0
    found = steps.replace_outliers(T, x, x)
    inside = region[x.dist[0, region] < x.dist[0, region].max() - 2 * x.longest]
    assert len(inside) > 5 and (found[inside] == 0).all()
    # A small one follows the rest, but for what is too far inside.
    T[:] = np.argmax(x.dist[0])
    T[region[:20]] = 0
    found = steps.replace_outliers(T, x, x)
    assert 0 < (found == 0).sum() < 20


def test_a_torn_vertex_is_smoothed_back():
    x = shape()[2]
    torn = np.array([3, 200, 600])
    T = EVERY_X.copy()
    T[torn] = [400, 7, 100]
    assert np.array_equal(steps.smooth(T, x, x, torn), EVERY_X)
    assert np.isin(torn, steps._torn(T, x, x)[0]).all()
    # Few images say nothing about continuity: left alone.
    few = np.zeros(N_X, int)
    assert np.array_equal(steps._smooth_torn(few, x, x), few)


@pytest.mark.parametrize("seed", range(3))
def test_smooth_agrees_with_the_plain_loop(seed):
    x, y = shape()[2], shape(2)[2]
    rng = np.random.default_rng(seed)
    T = np.asarray(nearest(jnp.asarray(x.points), jnp.asarray(y.points)).T_xy).copy()
    bad = rng.random(N_X) < 0.4
    T[bad] = rng.integers(N_Y, size=bad.sum())
    which = np.sort(rng.choice(N_X, 100, replace=False))
    expected = T.copy()
    for v in which:
        ring = x.ring[v].indices
        reach = {w for u in np.unique(T[ring]) for w in (u, *y.ring[u].indices)}
        parts = []
        while reach:
            part, queue = set(), [min(reach)]
            while queue:
                u = queue.pop()
                if u in reach:
                    reach.remove(u)
                    part.add(u)
                    queue.extend(y.ring[u].indices)
            parts.append(sorted(part))
        best = max(parts, key=len)
        if len(best) > 2:
            aim = x.points[v] + (y.points[T[ring]] - x.points[ring]).mean(0)
            expected[v] = best[((y.points[best] - aim) ** 2).sum(1).argmin()]
    assert np.array_equal(steps.smooth(T, x, y, which), expected)


def test_a_crowd_is_spread():
    x = shape()[2]
    crowd = np.array([5, *x.ring[5].indices])
    T = EVERY_X.copy()
    T[crowd] = 5
    found = steps.spread(T, x, x)
    assert len(np.unique(found[crowd])) > 4 and found[5] == 5
    rest = np.setdiff1d(EVERY_X, crowd)
    assert np.array_equal(found[rest], rest)
    # Up to four preimages are no crowd.
    T = EVERY_X.copy()
    T[crowd[:4]] = 5
    assert np.array_equal(steps.spread(T, x, x), T)


def test_the_surface():
    mesh, _, x = shape(2)
    one, two, three = (x.points[mesh.faces[:, i]] for i in range(3))
    doubled = np.linalg.norm(np.cross(two - one, three - one), axis=1)
    assert np.isclose(doubled.sum() / 2, 1)
    assert len(x.edges) == 480 and x.ring.nnz == 960
    length = np.linalg.norm(x.points[x.edges[:, 0]] - x.points[x.edges[:, 1]], axis=1)
    assert np.isclose(x.longest, length.max())
    np.testing.assert_allclose(x.dist[tuple(x.edges.T)], length, rtol=1e-6)
    np.testing.assert_allclose(x.dist, x.dist.T, rtol=1e-5)


def test_errors():
    mesh, spec, _ = shape(2)
    maps = Maps(EVERY_Y, EVERY_Y)
    cloud = Mesh(mesh.vertices, np.zeros((0, 3), np.int32))
    with pytest.raises(ValueError, match="mesh_y has no faces"):
        run(mesh, cloud, spec, spec, maps)
    with pytest.raises(ValueError, match="spec_x has 642 vertices, mesh_x has 162"):
        run(mesh, mesh, shape()[1], spec, maps)
    with pytest.raises(ValueError, match="k is 21, spec_x has 20 eigenpairs"):
        bcicp(mesh, mesh, spec, spec, maps, k=21)
    with pytest.raises(ValueError, match=r"T_yx must be 162 integers in 0..161"):
        run(mesh, mesh, spec, spec, Maps(EVERY_Y, EVERY_Y + 1))
    with pytest.raises(ValueError, match=r"T_xy must be 162 .*\(642,\)"):
        run(mesh, mesh, spec, spec, Maps(EVERY_X, EVERY_Y))
    with pytest.raises(ValueError, match="must not be negative, got -1, 4 and 5"):
        bcicp(mesh, mesh, spec, spec, maps, k=K, num_iters=-1)
