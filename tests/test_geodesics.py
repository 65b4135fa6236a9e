"""Geodesics against the plane, the sphere, and each other."""

import sys

import numpy as np
import potpourri3d as pp3d
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from shapes import sphere

from jfsf.geometry import GeodesicSolver, geodesics, pair_distances
from jfsf.geometry._geodesics import vertex_indices
from jfsf.types import Mesh

NO_FACES = np.zeros((0, 3), np.int32)


def square(n=8, seed=0):
    """A flat square, irregularly sampled: geodesics are straight lines."""
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 2, indexing="ij"), -1).reshape(-1, 2)
    inner = np.all((grid > 0) & (grid < n - 1), axis=1)
    move = np.random.default_rng(seed).uniform(-0.2, 0.2, grid.shape)
    flat = grid + np.where(inner[:, None], move, 0)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + n, a + 1], 1), np.stack([a + 1, a + n, a + n + 1], 1)]
    )
    return Mesh(np.c_[flat, np.zeros(n * n)], faces.astype(np.int32))


def side_by_side(*meshes, gap=5.0):
    """Meshes side by side, as the pieces of one."""
    vertices, faces, count = [], [], 0
    for i, mesh in enumerate(meshes):
        vertices.append(mesh.vertices + [i * gap, 0, 0])
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32))


def euclidean(mesh):
    return np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[None], axis=2)


@given(st.integers(0, 10**6))
def test_exact_distances_in_the_plane_are_euclidean(seed):
    mesh = square(seed=seed)
    sources = np.random.default_rng(seed).choice(len(mesh.vertices), 5)
    found = geodesics(mesh, sources, exact=True)
    np.testing.assert_allclose(found, euclidean(mesh)[sources], atol=1e-9)


@pytest.mark.parametrize(
    "exact, worst, mean", [(True, 0.01, 0.005), (False, 0.08, 0.02)]
)
def test_great_circles(exact, worst, mean):
    mesh = sphere(3)
    sources = [0, 17, 300]
    truth = np.arccos(np.clip(mesh.vertices[sources] @ mesh.vertices.T, -1, 1))
    gap = np.abs(geodesics(mesh, sources, exact=exact) - truth)
    assert gap.max() < worst
    assert gap.mean() < mean * truth.mean()


def test_heat_agrees_with_exact():
    mesh = square(20)
    sources = [0, 57, 210]
    exact = geodesics(mesh, sources, exact=True)
    gap = np.abs(geodesics(mesh, sources) - exact)
    assert gap.mean() < 0.03 * exact.mean()


def test_exact_is_a_metric():
    mesh = sphere(1)
    dist = geodesics(mesh, np.arange(len(mesh.vertices)), exact=True)
    np.testing.assert_allclose(dist, dist.T, atol=1e-9)
    assert (np.diag(dist) == 0).all()
    assert (dist[:, :, None] + dist[None] >= dist[:, None] - 1e-9).all()
    assert (dist >= euclidean(mesh) - 1e-9).all()


@pytest.mark.parametrize("exact", [True, False])
def test_units_and_labels(exact):
    mesh = square(6)
    order = np.random.default_rng(1).permutation(len(mesh.vertices))
    back = np.argsort(order)
    relabelled = Mesh(3 * mesh.vertices[order], back[mesh.faces].astype(np.int32))
    plain = geodesics(mesh, order[:4], exact=exact)
    found = geodesics(relabelled, np.arange(4), exact=exact)
    np.testing.assert_allclose(found, 3 * plain[:, order], rtol=1e-5, atol=1e-5)


@given(st.integers(0, 10**6), st.integers(1, 30), st.integers(1, 30))
def test_pairs_are_entries_of_the_full_matrix(seed, few_a, few_b):
    mesh = square(6)
    rng = np.random.default_rng(seed)
    a, b = rng.integers(few_a, size=20), rng.integers(few_b, size=20)
    full = euclidean(mesh)
    found = pair_distances(mesh, a, b, exact=True)
    np.testing.assert_allclose(found, full[a, b], atol=1e-9)
    heat = pair_distances(mesh, a, b)
    np.testing.assert_allclose(heat, full[a, b], atol=0.9)
    assert (heat[a == b] == 0).all()
    assert (pair_distances(mesh, a, a) == 0).all()


def test_only_the_fewer_distinct_sources_are_computed():
    mesh, seen = square(6), []
    a, b = np.arange(12), np.array([3, 7] * 6)
    pair_distances(mesh, a, b, progress=lambda done, all: seen.append((done, all)))
    assert seen == [(1, 2), (2, 2)]
    seen.clear()
    pair_distances(mesh, b, b, progress=lambda done, all: seen.append((done, all)))
    assert seen == []
    geodesics(mesh, [1, 2], progress=lambda done, all: seen.append((done, all)))
    assert seen == [(1, 2), (2, 2)]


@pytest.fixture
def factored(monkeypatch):
    """Sizes of the pieces that the heat method has factored so far."""
    made, build = [], pp3d.MeshHeatMethodDistanceSolver

    def counted(vertices, faces):
        made.append(len(vertices))
        return build(vertices, faces)

    monkeypatch.setattr(pp3d, "MeshHeatMethodDistanceSolver", counted)
    return made


def test_a_kept_solver_factors_each_piece_once(factored):
    mesh = side_by_side(square(5), sphere(1))
    n, m = 25, 42
    solver = GeodesicSolver(mesh)
    assert factored == []
    first = solver.rows([3, 4])
    assert factored == [n]
    both = solver.rows([3, n + 1]), solver.pairs([3, n + 1, 3], [4, n + 5, n])
    assert factored == [n, m]
    np.testing.assert_array_equal(solver.rows([3, 4]), first)
    assert factored == [n, m]
    np.testing.assert_array_equal(geodesics(mesh, [3, 4]), first)
    np.testing.assert_array_equal(geodesics(mesh, [3, n + 1]), both[0])
    alone = pair_distances(mesh, [3, n + 1, 3], [4, n + 5, n])
    np.testing.assert_array_equal(alone, both[1])
    assert factored == [n, m, n, n, m, n, m]


@pytest.mark.parametrize("exact", [True, False])
def test_a_kept_solver_gives_the_distances_of_fresh_ones(exact):
    mesh, rng = sphere(2), np.random.default_rng(0)
    solver = GeodesicSolver(mesh, exact=exact)
    for _ in range(3):
        a, b = rng.integers(len(mesh.vertices), size=(2, 6))
        fresh = geodesics(mesh, a, exact=exact)
        np.testing.assert_array_equal(solver.rows(a), fresh)
        pairs = pair_distances(mesh, a, b, exact=exact)
        np.testing.assert_array_equal(solver.pairs(a, b), pairs)


def test_nothing_asked_nothing_given():
    mesh = square(4)
    assert geodesics(mesh, []).shape == (0, 16)
    assert pair_distances(mesh, [], []).shape == (0,)


@pytest.mark.parametrize("exact", [True, False])
def test_pieces_are_infinitely_far_apart(exact):
    mesh = side_by_side(square(5), sphere(1))
    loose = Mesh(np.r_[mesh.vertices, [[9.0, 9, 9]]], mesh.faces)
    n, m = 25, 42
    found = geodesics(loose, [3, n + 1, n + m], exact=exact)
    assert np.isfinite(found[0, :n]).all() and np.isinf(found[0, n:]).all()
    assert np.isfinite(found[1, n:-1]).all() and np.isinf(found[1, :n]).all()
    assert found[2, -1] == 0 and np.isinf(found[2, :-1]).all()
    alone = geodesics(square(5), [3], exact=exact)[0]
    np.testing.assert_allclose(found[0, :n], alone)


@pytest.mark.parametrize("exact", [True, False])
def test_faces_that_crash_the_solvers_are_left_out(exact):
    mesh = square(5)
    extra = np.array([[3, 3, 4], [7, 7, 7], mesh.faces[0], mesh.faces[1][::-1]])
    messy = mesh._replace(faces=np.concatenate([mesh.faces, extra]).astype(np.int32))
    found = geodesics(messy, [0, 12], exact=exact)
    np.testing.assert_allclose(found, geodesics(mesh, [0, 12], exact=exact), atol=1e-9)


def test_point_cloud():
    mesh = sphere(3)
    cloud = mesh._replace(faces=NO_FACES)
    truth = np.arccos(np.clip(mesh.vertices[[0]] @ mesh.vertices.T, -1, 1))
    found = geodesics(cloud, [0])
    assert found[0, 0] == 0
    assert np.abs(found - truth).mean() < 0.03 * truth.mean()
    # Heat distances are not quite symmetric; the pair may be solved from either end.
    assert abs(pair_distances(cloud, [0], [9])[0] - truth[0, 9]) < 0.1


def test_errors(monkeypatch):
    mesh = square(4)
    with pytest.raises(ValueError, match="sources holds 16, the mesh has 16"):
        geodesics(mesh, [16])
    with pytest.raises(ValueError, match="b holds -1, the mesh has 16"):
        pair_distances(mesh, [0], [-1])
    with pytest.raises(ValueError, match="a has 2 vertices, b has 1"):
        pair_distances(mesh, [0, 1], [0])
    with pytest.raises(ValueError, match=r"f: v has shape \(1, 1\)"):
        vertex_indices("f", "v", [[0]], 3)
    with pytest.raises(ValueError, match="f: v is float64"):
        vertex_indices("f", "v", [0.0], 3)
    with pytest.raises(ValueError, match=r"faces span 0\.\.16, the mesh has 16"):
        geodesics(mesh._replace(faces=np.array([[0, 1, 16]])), [0])
    broken = mesh.vertices.copy()
    broken[5, 1] = np.nan
    with pytest.raises(ValueError, match="vertex 5 is .* not finite"):
        geodesics(mesh._replace(vertices=broken), [0])
    with pytest.raises(ValueError, match="need faces, the mesh has 0"):
        geodesics(mesh._replace(faces=NO_FACES), [0], exact=True)
    with pytest.raises(ValueError, match="at least 32 points, this one has 16"):
        geodesics(mesh._replace(faces=NO_FACES), [0])

    fin = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]]),
        np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
    )
    with pytest.raises(ValueError, match="1 edges have more than 2 faces"):
        geodesics(fin, [0], exact=True)
    assert np.isfinite(geodesics(fin, [0])).all()
    bow = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0]]),
        np.array([[0, 1, 2], [0, 3, 4]]),
    )
    with pytest.raises(ValueError, match="2 of 5 vertices hang on by a single vertex"):
        geodesics(bow, [1], exact=True)

    monkeypatch.setitem(sys.modules, "pygeodesic.geodesic", None)
    with pytest.raises(ValueError, match=r"jfsf\[exact\]"):
        geodesics(mesh, [0], exact=True)


def test_pieces_of_a_cloud_are_not_connected():
    ball = np.asarray(trimesh.creation.icosphere(subdivisions=2).vertices)
    both = Mesh(np.concatenate([ball, ball + 50]), NO_FACES)
    found = geodesics(both, [3, len(ball) + 3])
    alone = geodesics(Mesh(ball, NO_FACES), [3])[0]
    np.testing.assert_allclose(found[0, : len(ball)], alone)
    np.testing.assert_allclose(found[1, len(ball) :], alone, atol=1e-6)
    assert (
        np.isinf(found[0, len(ball) :]).all() and np.isinf(found[1, : len(ball)]).all()
    )


@pytest.mark.parametrize("points", [np.zeros((40, 3)), np.arange(120.0).reshape(40, 3)])
def test_clouds_without_a_surface_are_an_error(points):
    with pytest.raises(ValueError, match="40 points of the cloud have no surface"):
        geodesics(Mesh(points, NO_FACES), [0])


@pytest.mark.parametrize("faces", [np.zeros((3, 4), int), np.full((2, 3), 0.7)])
def test_faces_that_are_no_triangles_are_an_error(faces):
    with pytest.raises(ValueError, match=r"pass \(m, 3\) integers"):
        geodesics(Mesh(np.eye(3), faces), [0])
