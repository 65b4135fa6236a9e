"""Mesh -> Spectrum against dense algebra, the sphere, and its invariances."""

import sys
from functools import partial

import numpy as np
import oracles
import potpourri3d
import pytest
import scipy.sparse as sp
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from shapes import bumpy, small, sphere

import jfsf.data
from jfsf.mesh import MeshError
from jfsf.spectral import _eigenpairs, spectrum
from jfsf.spectral._laplacian import operators
from jfsf.types import Mesh, Spectrum

NO_FACES = np.zeros((0, 3), np.int32)


def fresh(mesh, k, tol=1e-10, **options):
    return spectrum(mesh, k, cache=False, tol=tol, **options)


def projector(spec, k):
    phi = spec.evecs[:, :k]
    return phi @ (phi.T * spec.mass)


@pytest.mark.parametrize("mass", ["voronoi", "barycentric"])
@given(seed=st.integers(0, 10**6))
def test_operators_match_the_dense_definition(mass, seed):
    mesh = bumpy(seed, 1)
    stiffness, areas = operators(mesh, laplacian="cotan", mass=mass)
    dense, dense_areas = oracles.cotan(*mesh, mass)
    assert np.allclose(stiffness.toarray(), dense)
    assert np.allclose(areas, dense_areas)
    assert np.isclose(areas.sum(), trimesh.Trimesh(*mesh, process=False).area)


def test_stiffness_matches_potpourri3d():
    mesh = jfsf.data.load("child_kick").mesh
    stiffness, _ = operators(mesh)
    gap = stiffness - potpourri3d.cotan_laplacian(mesh.vertices, mesh.faces)
    assert abs(gap).max() < 1e-6 * abs(stiffness).max()


@pytest.mark.parametrize("k", [1, 2, 40, 80, 81, 162])  # Lanczos up to half of 162
def test_eigenpairs_match_the_dense_solver(k):
    mesh = bumpy()
    spec = fresh(mesh, k)
    evals, evecs = oracles.eigenpairs(*oracles.cotan(*mesh), k)
    assert np.allclose(spec.evals, evals, atol=1e-9 * evals[-1] + 1e-9)
    assert spec.evals[0] == 0 and (spec.evecs[:, 0] == 1).all()
    assert (np.diff(spec.evals) >= 0).all()
    # Without symmetry every eigenvalue is simple: columns agree up to sign.
    overlap = np.abs((spec.evecs.T * spec.mass) @ evecs)
    assert np.allclose(overlap, np.eye(k), atol=1e-6)
    assert np.isclose(spec.mass.sum(), 1)
    assert spec.faces.dtype == np.int32 and np.array_equal(spec.faces, mesh.faces)
    assert all(a.dtype == np.float64 for a in spec[:3])


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_the_smallest_mesh(k):
    shape = trimesh.creation.icosahedron()
    mesh = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
    evals, _ = oracles.eigenpairs(*oracles.cotan(*mesh), k)
    assert np.allclose(fresh(mesh, k).evals, evals, atol=1e-9)


def test_the_sphere_has_its_known_eigenvalues():
    spec = fresh(sphere(4), 25)
    exact = np.concatenate([[4 * np.pi * l * (l + 1)] * (2 * l + 1) for l in range(5)])
    assert np.allclose(spec.evals, exact, rtol=0.01)


@pytest.mark.parametrize("laplacian", ["cotan", "robust"])
def test_a_real_shape_has_orthonormal_eigenvectors_that_solve(laplacian):
    mesh = jfsf.data.load("man_walk").mesh
    spec = fresh(mesh, 100, laplacian=laplacian)
    gram = (spec.evecs.T * spec.mass) @ spec.evecs
    assert np.allclose(gram, np.eye(100), atol=1e-9)
    stiffness, areas = operators(mesh, laplacian=laplacian)
    right = spec.mass[:, None] * spec.evecs * spec.evals
    assert np.abs(stiffness @ spec.evecs - right).max() < 1e-6
    assert np.allclose(spec.mass, areas / areas.sum())


@given(
    turn=hnp.arrays(float, (3, 3), elements=st.floats(-1, 1)),
    shift=hnp.arrays(float, 3, elements=st.floats(-3, 3)),
    unit=st.sampled_from([1e-200, 1e-3, 1.0, 1e3, 1e150]),
)
def test_units_and_rigid_motion_change_nothing(turn, shift, unit):
    mesh = bumpy()
    rotation = np.linalg.qr(turn + 3 * np.eye(3))[0]
    moved = Mesh((mesh.vertices @ rotation.T + shift) * unit, mesh.faces)
    spec, other = fresh(mesh, 30), fresh(moved, 30)
    assert np.allclose(other.evals, spec.evals, rtol=1e-8)
    assert np.allclose(other.mass, spec.mass, rtol=1e-8)
    assert np.allclose(projector(other, 30), projector(spec, 30), atol=1e-7)


@given(seed=st.integers(0, 10**6))
def test_relabelling_relabels(seed):
    mesh, rng = bumpy(), np.random.default_rng(seed)
    order = rng.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))]
    spec, other = fresh(mesh, 30), fresh(Mesh(mesh.vertices[order], faces), 30)
    assert np.allclose(other.evals, spec.evals)
    assert np.allclose(other.mass, spec.mass[order])
    own = projector(spec, 30)[np.ix_(order, order)]
    assert np.allclose(projector(other, 30), own, atol=1e-7)


def test_other_dtypes_of_the_same_numbers_give_the_same():
    mesh = bumpy()
    short = mesh.vertices.astype(np.float32)
    spec = fresh(Mesh(short.astype(float), mesh.faces), 20)
    other = fresh(Mesh(short, mesh.faces.astype(np.uint64)), 20)
    assert all(np.array_equal(a, b) for a, b in zip(spec, other, strict=True))


def symmetric(mesh):
    """M^-1/2 W M^-1/2 at area 1, whose eigenvalues are those of the spectrum."""
    stiffness, areas = operators(mesh)
    root = sp.diags(1 / np.sqrt(areas / areas.sum()))
    return (root @ stiffness @ root).tocsc()


@pytest.mark.parametrize("metis", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_nested_dissection_gives_the_same_eigenpairs(metis, monkeypatch):
    if not metis:  # as on Windows: it takes longer
        monkeypatch.setitem(sys.modules, "pymetis", None)
    matrix = symmetric(small("man_walk", 4000)[0])
    order = _eigenpairs._dissection(matrix)
    if not metis:
        assert order is None
    elif sys.platform != "win32":
        assert sorted(order) == list(range(matrix.shape[0]))
    plain, found, again = (
        _eigenpairs._shift_invert(matrix, 30, 1e-10, dissection_above=above)
        for above in (10**9, 1000, 1000)
    )
    np.testing.assert_allclose(found[0], plain[0], rtol=1e-9, atol=1e-9)
    same = np.abs(found[1].T @ plain[1])
    np.testing.assert_allclose(same, np.eye(30), atol=1e-6)
    assert np.array_equal(found[1], again[1])


def test_a_basis_in_float32_gives_the_same_spectrum(monkeypatch):
    # As that of a large mesh.
    large = partial(_eigenpairs._shift_invert, dissection_above=1000)
    mesh = jfsf.data.load("man_walk").mesh
    exact = fresh(mesh, 128)
    monkeypatch.setattr(_eigenpairs, "_shift_invert", large)
    spec = fresh(mesh, 128, _eigenpairs.TOL)
    assert not np.array_equal(spec.evals, exact.evals)
    np.testing.assert_allclose(spec.evals, exact.evals, rtol=1e-4)
    gram = (spec.evecs.T * spec.mass) @ spec.evecs
    np.testing.assert_allclose(gram, np.eye(128), atol=1e-12)
    assert spec.evecs.dtype == float and (spec.evecs[:, 0] == 1).all()
    low = exact.evecs[:, :100]
    away = low - spec.evecs @ ((spec.evecs.T * spec.mass) @ low)
    assert np.sqrt(spec.mass @ away**2).max() < 1e-3


def test_the_tolerance_bounds_the_error_of_all_pairs():
    mesh = jfsf.data.load("man_walk").mesh
    exact = fresh(mesh, 130)
    for tol, error in ((1e-2, 1e-3), (1e-3, 1e-5), (1e-6, 1e-9)):
        spec = fresh(mesh, 128, tol)
        assert np.allclose(spec.evals, exact.evals[:128], rtol=error)
        low = spec.evecs[:, :100]
        mixed = low - exact.evecs @ ((exact.evecs.T * exact.mass) @ low)
        assert np.sqrt(exact.mass @ mixed**2).max() < max(10 * error, 1e-5)


@given(k=st.integers(1, 150), seed=st.integers(0, 10**6))
@settings(max_examples=10)
def test_all_copies_of_an_eigenvalue_are_found(k, seed):
    # As many as 21 lie close together, more than a block holds.
    mesh, rng = sphere(4), np.random.default_rng(seed)
    order = rng.permutation(len(mesh.vertices))
    mesh = Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces].astype(np.int32))
    spec = fresh(mesh, k, tol=_eigenpairs.TOL)
    exact = np.concatenate([[4 * np.pi * l * (l + 1)] * (2 * l + 1) for l in range(13)])
    assert np.allclose(spec.evals, exact[:k], rtol=0.07)


def test_arpack_answers_where_one_sweep_does_not_converge(monkeypatch):
    matrix = symmetric(jfsf.data.load("man_walk").mesh)
    evals, evecs = _eigenpairs._shift_invert(matrix, 30, 1e-10)
    asked = []

    def gives_up(apply, start, k, **options):
        asked.append(k)

    monkeypatch.setattr(_eigenpairs, "largest_eigenpairs", gives_up)
    other_evals, other_evecs = _eigenpairs._shift_invert(matrix, 30, 1e-10)
    assert asked == [30]
    np.testing.assert_allclose(other_evals, evals, rtol=1e-9, atol=1e-9)
    same = np.abs(other_evecs.T @ evecs)
    np.testing.assert_allclose(same, np.eye(30), atol=1e-6)


def test_it_is_deterministic_and_leaves_the_mesh_alone():
    mesh = bumpy(subdivisions=3)
    before = mesh.vertices.copy()
    spec, again = fresh(mesh, 40), fresh(mesh, 40)
    assert all(np.array_equal(a, b) for a, b in zip(spec, again, strict=True))
    spec.faces[0] = 0
    assert np.array_equal(mesh.vertices, before) and mesh.faces[0].any()


def test_blas_threads_are_as_before():
    from threadpoolctl import threadpool_info

    before = [(pool["filepath"], pool["num_threads"]) for pool in threadpool_info()]
    fresh(bumpy(), 20)
    after = [(pool["filepath"], pool["num_threads"]) for pool in threadpool_info()]
    assert before == after


# Input that is not a clean manifold.


def fin(mesh):
    """`mesh` with a third face on one of its edges."""
    a, b = mesh.faces[0, :2]
    tip = 1.5 * mesh.vertices[a]
    faces = np.concatenate([mesh.faces, [[a, b, len(mesh.vertices)]]])
    return Mesh(np.concatenate([mesh.vertices, [tip]]), faces.astype(np.int32))


def with_face(mesh, *corners):
    return mesh._replace(faces=np.concatenate([mesh.faces, [corners]]).astype(np.int32))


@pytest.mark.parametrize(
    "broken",
    [
        fin(bumpy()),
        with_face(bumpy(), 0, 1, 1),
        with_face(bumpy(), *bumpy().faces[5]),
        Mesh(
            np.concatenate([np.eye(3), [[0.5, 0.5, 0]]]),
            np.array([[0, 1, 2], [1, 0, 3]]),
        ),
    ],
    ids=["non-manifold", "repeated vertex", "repeated face", "no area"],
)
def test_auto_goes_robust_where_it_must(broken):
    k = min(20, len(broken.vertices))
    spec, robust = fresh(broken, k), fresh(broken, k, laplacian="robust")
    assert np.array_equal(spec.evals, robust.evals)
    gram = (spec.evecs.T * spec.mass) @ spec.evecs
    assert np.allclose(gram, np.eye(k), atol=1e-8)
    assert spec.evals[1] > 1e-3 and np.isfinite(spec.evals).all()


def test_auto_takes_cotan_for_a_clean_mesh():
    spec, cotan = fresh(bumpy(), 20), fresh(bumpy(), 20, laplacian="cotan")
    robust = fresh(bumpy(), 20, laplacian="robust")
    assert np.array_equal(spec.evals, cotan.evals)
    assert not np.array_equal(spec.evals, robust.evals)
    assert np.allclose(spec.evals, robust.evals, rtol=0.05)


@pytest.mark.parametrize("subdivisions", [2, 3])  # 162 and 642 points
def test_a_point_cloud_has_nearly_the_spectrum_of_its_mesh(subdivisions):
    mesh = sphere(subdivisions)
    spec = fresh(Mesh(mesh.vertices, NO_FACES), 9)
    assert spec.faces.shape == (0, 3) and np.isclose(spec.mass.sum(), 1)
    assert np.allclose(spec.evals, fresh(mesh, 9).evals, rtol=0.1)


def test_a_small_point_cloud_works():
    spec = fresh(Mesh(sphere(0).vertices, NO_FACES), 4)  # 12 points, k = 30 neighbours
    assert np.isfinite(spec.evecs).all() and spec.evals[1] > 1


def line(n=40):
    return Mesh(np.linspace(0, 1, n)[:, None] * np.ones(3), NO_FACES)


def two_clouds():
    v = sphere(2).vertices
    return Mesh(np.concatenate([v, v + 100]), NO_FACES)


@pytest.mark.parametrize(
    "mesh, options, message",
    [
        (bumpy(), {"k": 163}, "162 vertices, fewer than the 163"),
        (line(), {"k": 5}, "no Laplacian could be built"),
        (two_clouds(), {"k": 5}, "falls into 2 pieces"),
        (
            Mesh(bumpy().vertices, NO_FACES),
            {"k": 5, "laplacian": "cotan"},
            "no cotangents",
        ),
        (with_face(bumpy(), 0, 1, 1), {"k": 5, "laplacian": "cotan"}, "without area"),
    ],
)
def test_errors_name_the_mesh(mesh, options, message):
    with pytest.raises(MeshError, match=f"^scan.off: .*{message}"):
        spectrum(mesh, cache=False, name="scan.off", **options)


def test_a_vertex_without_area_is_an_error():
    stiffness, areas = operators(bumpy())
    areas[3] = 0
    with pytest.raises(MeshError, match="vertex 3 has area 0"):
        _eigenpairs._check_operators(stiffness, areas)


def test_no_convergence_is_an_error():
    matrix = symmetric(bumpy(subdivisions=3))
    start = np.random.default_rng(0).normal(size=matrix.shape[0])
    with pytest.raises(MeshError, match=r"only \d+ of 40 eigenpairs converged"):
        _eigenpairs._arpack(lambda b: matrix @ b, 40, start, max_restarts=1)


@pytest.mark.parametrize("function", [spectrum, operators])
@pytest.mark.parametrize("option", ["laplacian", "mass"])
def test_unknown_options_are_errors(function, option):
    with pytest.raises(ValueError, match=f"{option} is .* not 'fem'"):
        function(bumpy(), **{option: "fem"})


@pytest.mark.parametrize("tol", [0, -1e-3, np.nan])
def test_a_tolerance_that_cannot_be_met_is_an_error(tol):
    with pytest.raises(ValueError, match=f"tol is {tol}"):
        spectrum(bumpy(), 5, tol=tol)


def test_k_below_one_is_an_error():
    with pytest.raises(ValueError, match="k is 0"):
        spectrum(bumpy(), 0)


# The cache.


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """The folder of the cache, not made yet."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("JFSF_CACHE", str(folder))
    return folder


def stored(cache):
    return sorted(cache.iterdir()) if cache.exists() else []


def mark(file):
    """Double the eigenvalues in a cached file, to see whether it is read."""
    with np.load(file) as held:
        arrays = {name: held[name] for name in Spectrum._fields}
    np.savez(file, **(arrays | {"evals": 2 * arrays["evals"]}))


def test_the_cache_returns_the_same_bits(cache):
    first, second = spectrum(bumpy(), 20), spectrum(bumpy(), 20)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a, b) and a.dtype == b.dtype
    (file,) = stored(cache)
    assert file.suffix == ".npz"
    mark(file)
    assert np.array_equal(spectrum(bumpy(), 20).evals, 2 * first.evals)


def test_what_changes_the_numbers_changes_the_key(cache):
    other = bumpy()
    other.vertices[7, 1] += 1e-12
    spectrum(bumpy(), 20)
    for mesh, k, options in [
        (other, 20, {}),
        (bumpy(), 21, {}),
        (bumpy(), 20, {"mass": "barycentric"}),
        (bumpy(), 20, {"laplacian": "robust"}),
    ]:
        before = len(stored(cache))
        spectrum(mesh, k, **options)
        assert len(stored(cache)) == before + 1


def test_the_cache_can_be_off(cache):
    plain = spectrum(bumpy(), 20, cache=False)
    assert not stored(cache)
    spectrum(bumpy(), 20)
    mark(*stored(cache))
    assert np.array_equal(spectrum(bumpy(), 20, cache=False).evals, plain.evals)


def test_errors_are_not_cached(cache):
    for _ in range(2):
        with pytest.raises(MeshError, match="scan: its Laplacian"):
            spectrum(two_clouds(), 5, name="scan")
    assert not stored(cache)
