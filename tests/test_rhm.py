"""Reversible harmonic maps: exact blocks; smoother, more bijective maps."""

from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.distance import cdist

from experiments.paper.baselines import _rhm as module
from experiments.paper.baselines import rhm
from experiments.paper.baselines._rhm import embed, rhm_energy, rhm_precise
from jfsf.convert import to_vertex
from jfsf.evaluate import bijectivity, smoothness
from jfsf.geometry import geodesics
from jfsf.spectral._laplacian import operators
from jfsf.types import Maps, Mesh

# Methods of others, for a table of the experiments: they seldom change.
pytestmark = pytest.mark.slow


def ellipsoid(subdivisions):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Mesh(np.array(ball.vertices) * [1, 1.3, 1.8], np.array(ball.faces, "i4"))


X, Y = ellipsoid(3), ellipsoid(2)
N_X, N_Y = 642, 162


def closest(a, b):
    return np.linalg.norm(a[:, None] - b[None], axis=2).argmin(1)


def moved(seed, radius=0.5):
    """The true maps with every image moved at random to a vertex nearby."""
    rng = np.random.default_rng(seed)
    shift = lambda mesh: radius * rng.normal(size=mesh.vertices.shape)
    T_xy = closest(X.vertices + shift(X), Y.vertices)
    return Maps(T_xy, closest(Y.vertices + shift(Y), X.vertices))


NOISY = moved(0)
RUN = {"growth": 10, "num_iters": 20}


@cache
def found():
    return rhm_precise(X, Y, NOISY, **RUN)


def apart(T, a, b):
    """Mean distance in space from the image to the true point."""
    return np.linalg.norm(b.vertices[np.asarray(T)] - a.vertices, axis=1).mean()


def test_points_lie_on_triangles():
    for pmap, mesh, n in ((found().pmap_xy, Y, N_X), (found().pmap_yx, X, N_Y)):
        bary, known = np.asarray(pmap.bary), {tuple(face) for face in mesh.faces}
        assert bary.shape == (n, 3) and (bary >= 0).all()
        np.testing.assert_allclose(bary.sum(1), 1, atol=1e-9)
        assert all(tuple(corner) in known for corner in np.asarray(pmap.corners))


def test_better_smoother_and_more_bijective_than_the_start():
    maps = Maps(to_vertex(found().pmap_xy), to_vertex(found().pmap_yx))
    assert apart(maps.T_xy, X, Y) < 0.6 * apart(NOISY.T_xy, X, Y)
    assert apart(maps.T_yx, Y, X) < 0.6 * apart(NOISY.T_yx, Y, X)
    stiffness = operators(X)[0]
    rough, smooth = (smoothness(m.T_xy, Y.vertices, stiffness) for m in (NOISY, maps))
    assert smooth < 0.2 * rough
    before, after = (bijectivity(*m, X).mean() for m in (NOISY, maps))
    assert after < 0.4 * before


def test_the_energy_of_the_maps_falls():
    before = rhm_energy(X, Y, NOISY)
    after = rhm_energy(X, Y, (found().pmap_xy, found().pmap_yx))
    assert after[0] < before[0] and after[1] < before[1]
    rounded = Maps(to_vertex(found().pmap_xy), to_vertex(found().pmap_yx))
    assert sum(after) < sum(rhm_energy(X, Y, rounded)) < sum(before)


def test_every_block_lowers_the_energy_at_a_fixed_penalty():
    alpha, beta = 1e-2, 5e-2
    x, y = module._shapes("rhm", X, Y, 8)
    P, Q = module._selection(NOISY.T_xy, N_Y), module._selection(NOISY.T_yx, N_X)
    F, G = P @ y.emb, Q @ x.emb
    energy = lambda: module._energies(x, y, P, Q, F, G, alpha, beta)[3]
    seen = [energy()]
    for _ in range(4):
        Q = module._matrix(module._project(y, x, G, F, alpha, beta), N_X)
        seen.append(energy())
        G = module._solve(y, x, Q, P, alpha, beta)
        seen.append(energy())
        # The solution is the minimum: any change costs.
        kept, G = G, G + 1e-3 * np.random.default_rng(0).normal(size=G.shape)
        assert energy() > seen[-1]
        G = kept
        P = module._matrix(module._project(x, y, F, G, alpha, beta), N_Y)
        seen.append(energy())
        F = module._solve(x, y, P, Q, alpha, beta)
        seen.append(energy())
    assert (np.diff(seen) <= 1e-6 * seen[0]).all()
    assert seen[-1] < 0.5 * seen[0]


def test_energies_by_round():
    by_round = rhm_precise(X, Y, NOISY, growth=1, num_iters=12, tol=0.0)
    assert by_round.energies.shape == (24, 4)
    total = by_round.energies[:, 3]
    np.testing.assert_allclose(by_round.energies[:, :3].sum(1), total)
    assert (np.diff(total) <= 1e-6 * total[0]).all()
    assert len(rhm_precise(X, Y, NOISY, growth=1, tol=1.0).energies) == 12


def test_a_shape_with_itself_stays():
    own = Maps(np.arange(N_Y), np.arange(N_Y))
    maps = rhm(Y, Y, own, growth=10, num_iters=12)
    assert (np.asarray(maps.T_xy) == own.T_xy).mean() > 0.95


def test_unit_and_order_change_nothing():
    order = np.random.default_rng(0).permutation(N_Y)
    place = np.argsort(order).astype(np.int32)
    other = Mesh(40 * Y.vertices[order] + 3, place[Y.faces])
    start = Maps(place[NOISY.T_xy], NOISY.T_yx[order])

    def points(maps, mesh):
        corners = mesh.vertices[np.asarray(maps.pmap_xy.corners)]
        return np.einsum("nc,ncd->nd", maps.pmap_xy.bary, corners)

    moved = rhm_precise(X, other, start, **RUN)
    gap = (points(moved, other) - 3) / 40 - points(found(), Y)
    # The samples start at vertex 0, so the embeddings differ a little.
    assert np.linalg.norm(gap, axis=1).mean() < 0.05


def test_the_embedding_keeps_geodesic_distances():
    unit = np.sqrt(operators(X)[1].sum())
    at = np.arange(3, N_X, 29)
    dist = geodesics(X, at)[:, at] / unit
    gap = lambda points: np.abs(cdist(points, points) - dist).mean() / dist.mean()
    straight = gap(X.vertices[at] / unit)
    # From all vertices, and from few, which leaves the rest to interpolation.
    for num_samples in (N_X, 100):
        # A closed surface does not fit into Euclidean space without stress.
        assert gap(embed(X, num_samples=num_samples)[at]) < 0.75 * straight
    assert embed(X, dim=3, num_samples=50).shape == (N_X, 3)


def test_errors():
    for maps, message in (
        (Maps(NOISY.T_yx, NOISY.T_xy), "rhm: maps.T_xy holds"),
        (Maps(NOISY.T_xy[:9], NOISY.T_yx), "rhm: maps have 9 and 162 entries"),
        (Maps(NOISY.T_xy / 1.0, NOISY.T_yx), "rhm: maps.T_xy is float64"),
    ):
        with pytest.raises(ValueError, match=message):
            rhm(X, Y, maps)
    for options, message in (
        ({"alpha": 1.0}, "rhm: alpha is 1.0, it must be between 0 and 1"),
        ({"beta": 0.0}, "rhm: beta is 0.0, it must be positive"),
        ({"num_iters": 0}, "growth and num_iters must be 1 or more, got 100 and 0"),
        ({"dim": 0}, "rhm: dim is 0, it must be in 1..499: mesh_x has 500 samples"),
    ):
        with pytest.raises(ValueError, match=message):
            rhm(X, Y, NOISY, **options)
    with pytest.raises(ValueError, match="embed: mesh has 0 faces"):
        embed(X._replace(faces=X.faces[:0]))
    two = np.concatenate([Y.vertices, Y.vertices + 9])
    with pytest.raises(ValueError, match="embed: mesh has 2 pieces"):
        embed(Mesh(two, np.concatenate([Y.faces, Y.faces + N_Y])))
