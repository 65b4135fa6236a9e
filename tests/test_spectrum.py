"""Mesh -> Spectrum against dense algebra, the sphere, and its invariances."""

import sys
import time

import numpy as np
import oracles
import potpourri3d
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import jfsf.data
from jfsf.mesh import MeshError
from jfsf.spectrum import operators, spectrum
from jfsf.types import Mesh

MODULE = sys.modules["jfsf.spectrum"]  # its name may be the function's
NO_FACES = np.zeros((0, 3), np.int32)


def sphere(subdivisions=2):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Mesh(np.array(ball.vertices), np.array(ball.faces, np.int32))


def blob(seed=0, subdivisions=2):
    """A bumpy ellipsoid without symmetry; 162 vertices."""
    mesh = sphere(subdivisions)
    rng = np.random.default_rng(seed)
    v = mesh.vertices
    bumps = 1 + 0.2 * np.sin(v @ rng.normal(size=(3, 4)) * 2) @ rng.normal(size=4)
    return Mesh(v * bumps[:, None] * [1.0, 1.4, 2.0], mesh.faces)


def fresh(mesh, k, **options):
    return spectrum(mesh, k, cache=False, **options)


def projector(spec, k):
    phi = spec.evecs[:, :k]
    return phi @ (phi.T * spec.mass)


@pytest.mark.parametrize("mass", ["voronoi", "barycentric"])
@given(seed=st.integers(0, 10**6))
def test_operators_match_the_dense_definition(mass, seed):
    mesh = blob(seed, 1)
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
    mesh = blob()
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
    mesh = blob()
    rotation = np.linalg.qr(turn + 3 * np.eye(3))[0]
    moved = Mesh((mesh.vertices @ rotation.T + shift) * unit, mesh.faces)
    spec, other = fresh(mesh, 30), fresh(moved, 30)
    assert np.allclose(other.evals, spec.evals, rtol=1e-8)
    assert np.allclose(other.mass, spec.mass, rtol=1e-8)
    assert np.allclose(projector(other, 30), projector(spec, 30), atol=1e-7)


@given(seed=st.integers(0, 10**6))
def test_relabelling_relabels(seed):
    mesh, rng = blob(), np.random.default_rng(seed)
    order = rng.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][rng.permutation(len(mesh.faces))]
    spec, other = fresh(mesh, 30), fresh(Mesh(mesh.vertices[order], faces), 30)
    assert np.allclose(other.evals, spec.evals)
    assert np.allclose(other.mass, spec.mass[order])
    own = projector(spec, 30)[np.ix_(order, order)]
    assert np.allclose(projector(other, 30), own, atol=1e-7)


def test_other_holders_of_the_numbers_give_the_same():
    mesh = blob()
    short = mesh.vertices.astype(np.float32)
    spec = fresh(Mesh(short.astype(float), mesh.faces), 20)
    other = fresh(Mesh(short, mesh.faces.astype(np.uint64)), 20)
    assert all(np.array_equal(a, b) for a, b in zip(spec, other, strict=True))


def test_large_meshes_have_the_same_eigenpairs(monkeypatch):
    mesh = jfsf.data.load("man_walk").mesh
    module = sys.modules[spectrum.__module__]
    orders = []
    dissection = module._dissection
    monkeypatch.setattr(
        module, "_dissection", lambda m: orders.append(dissection(m)) or orders[-1]
    )
    plain = spectrum(mesh, 30, cache=False)
    monkeypatch.setattr(module, "DISSECTED", 1000)
    for missing in (False, True):
        if missing:
            monkeypatch.setitem(sys.modules, "pymetis", None)
        found = spectrum(mesh, 30, cache=False)
        np.testing.assert_allclose(found.evals, plain.evals, rtol=1e-9, atol=1e-9)
        same = np.abs(found.evecs.T * found.mass @ plain.evecs)
        np.testing.assert_allclose(same, np.eye(30), atol=1e-6)
        again = spectrum(mesh, 30, cache=False)
        assert np.array_equal(found.evecs, again.evecs)
    # Without METIS, as on Windows, it takes longer.
    with_metis, _, without, _ = orders
    assert without is None
    if sys.platform != "win32":
        assert sorted(with_metis) == list(range(len(mesh.vertices)))


def test_it_is_deterministic_and_leaves_the_mesh_alone():
    mesh = blob(subdivisions=3)
    before = mesh.vertices.copy()
    spec, again = fresh(mesh, 40), fresh(mesh, 40)
    assert all(np.array_equal(a, b) for a, b in zip(spec, again, strict=True))
    spec.faces[0] = 0
    assert np.array_equal(mesh.vertices, before) and mesh.faces[0].any()


def test_blas_threads_are_as_before():
    from threadpoolctl import threadpool_info

    before = [(pool["filepath"], pool["num_threads"]) for pool in threadpool_info()]
    fresh(blob(), 20)
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
        fin(blob()),
        with_face(blob(), 0, 1, 1),
        with_face(blob(), *blob().faces[5]),
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
    spec, cotan = fresh(blob(), 20), fresh(blob(), 20, laplacian="cotan")
    robust = fresh(blob(), 20, laplacian="robust")
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
        (blob(), {"k": 163}, "162 vertices, fewer than the 163"),
        (line(), {"k": 5}, "no Laplacian could be built"),
        (two_clouds(), {"k": 5}, "falls into 2 pieces"),
        (
            Mesh(blob().vertices, NO_FACES),
            {"k": 5, "laplacian": "cotan"},
            "no cotangents",
        ),
        (with_face(blob(), 0, 1, 1), {"k": 5, "laplacian": "cotan"}, "without area"),
    ],
)
def test_errors_name_the_mesh(mesh, options, message):
    with pytest.raises(MeshError, match=f"^scan.off: .*{message}"):
        spectrum(mesh, cache=False, name="scan.off", **options)


def test_no_area_anywhere_is_an_error(monkeypatch):
    stiffness, areas = operators(blob())
    areas[3] = 0
    monkeypatch.setattr(MODULE, "operators", lambda *_, **__: (stiffness, areas))
    with pytest.raises(MeshError, match="mesh: vertex 3 has area 0"):
        fresh(blob(), 10)


def test_no_convergence_is_an_error(monkeypatch):
    from scipy.sparse.linalg import ArpackNoConvergence

    def fail(*_, **__):
        raise ArpackNoConvergence("%s", np.zeros(3), np.zeros((162, 3)))

    monkeypatch.setattr(MODULE, "eigsh", fail)
    with pytest.raises(MeshError, match="only 3 of 10 eigenpairs converged"):
        fresh(blob(), 10)


@pytest.mark.parametrize("function", [spectrum, operators])
@pytest.mark.parametrize("option", ["laplacian", "mass"])
def test_unknown_options_are_errors(function, option):
    with pytest.raises(ValueError, match=f"{option} is .* not 'fem'"):
        function(blob(), **{option: "fem"})


def test_k_below_one_is_an_error():
    with pytest.raises(ValueError, match="k is 0"):
        spectrum(blob(), 0)


# The cache.


@pytest.fixture
def computed(monkeypatch, tmp_path):
    """Counts the spectra computed rather than read."""
    calls, inner = [], MODULE._spectrum
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(MODULE, "_spectrum", lambda *a: calls.append(1) or inner(*a))
    return calls


def test_the_cache_returns_the_same_bits(computed, tmp_path):
    first, second = spectrum(blob(), 20), spectrum(blob(), 20)
    assert len(computed) == 1
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a, b) and a.dtype == b.dtype
    assert [f.suffix for f in (tmp_path / "cache").iterdir()] == [".npz"]


def test_what_changes_the_numbers_changes_the_key(computed):
    other = blob()
    other.vertices[7, 1] += 1e-12
    spectrum(blob(), 20)
    for mesh, k, options in [
        (other, 20, {}),
        (blob(), 21, {}),
        (blob(), 20, {"mass": "barycentric"}),
        (blob(), 20, {"laplacian": "robust"}),
    ]:
        before = len(computed)
        spectrum(mesh, k, **options)
        assert len(computed) == before + 1


def test_the_cache_can_be_off(computed, tmp_path):
    spectrum(blob(), 20, cache=False)
    assert len(computed) == 1 and not (tmp_path / "cache").exists()


def test_errors_are_not_cached(computed, tmp_path):
    for _ in range(2):
        with pytest.raises(MeshError, match="scan: its Laplacian"):
            spectrum(two_clouds(), 5, name="scan")
    assert len(computed) == 2 and not (tmp_path / "cache").exists()


@pytest.mark.slow
def test_it_is_fast_enough():
    mesh = jfsf.data.load("man_walk").mesh
    times = []
    for _ in range(3):
        start = time.perf_counter()
        fresh(mesh, 200)
        times.append(time.perf_counter() - start)
    assert min(times) < 1.5  # 0.6 s on one idle core
