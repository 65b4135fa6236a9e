"""Metrics against dense oracles, their invariances, and the authors' numbers."""

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import potpourri3d as pp3d
import pytest
import scipy.sparse as sp
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from experiments.fit.reliability import reliability
from jfsf.evaluate import (
    auc,
    bijectivity,
    coverage,
    error_curve,
    evaluate,
    geodesic_error,
    laplacian_commutativity,
    orthogonality,
    smoothness,
    spectral_chamfer,
    zoomout_energy,
)
from jfsf.evaluate._evaluate import MEASURED
from jfsf.spectral._laplacian import operators
from jfsf.types import Maps, Mesh

seeds = st.integers(0, 10**6)


def mesh_of(shape):
    return Mesh(np.array(shape.vertices), np.array(shape.faces, np.int32))


SPHERE = mesh_of(trimesh.creation.icosphere(2))  # 162 vertices
SMALL = mesh_of(trimesh.creation.icosphere(1))  # 42, the first 42 of SPHERE
N_X, N_Y = len(SPHERE.vertices), len(SMALL.vertices)


def nearest(x, y):
    return np.linalg.norm(x[:, None] - y[None], axis=2).argmin(1)


def normal(seed, *shape, dtype=np.float64):
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


def test_identity_is_perfect():
    every = np.arange(N_X)
    assert (geodesic_error(every, SPHERE, every, every) == 0).all()
    assert (bijectivity(every, every, SPHERE) == 0).all()
    assert coverage(every, np.ones(N_X)) == 1
    assert orthogonality(jnp.eye(7)) == 0
    assert zoomout_energy(jnp.eye(7)) == 0
    evals = jnp.arange(7.0)
    assert laplacian_commutativity(jnp.eye(7), evals, evals) == 0
    emb = jnp.asarray(normal(0, 30, 5))
    assert spectral_chamfer(emb, emb[::-1]) == 0


@pytest.mark.parametrize("exact, atol", [(True, 0.01), (False, 0.05)])
def test_errors_on_the_sphere(exact, atol):
    # X is the fine sphere, Y the coarse one; template points are Y's vertices.
    rng = np.random.default_rng(0)
    T_xy, T_yx = rng.integers(N_Y, size=N_X), rng.integers(N_X, size=N_Y)
    gt_x, gt_y = np.arange(N_Y), np.arange(N_Y)
    angle = lambda a, b: np.arccos(np.clip((a * b).sum(1), -1, 1))

    # Chords shorten both the distances and the area of a coarse sphere.
    root = np.sqrt(trimesh.Trimesh(*SMALL).area)
    truth = angle(SMALL.vertices[T_xy[gt_x]], SMALL.vertices[gt_y]) / root
    found = geodesic_error(T_xy, SMALL, gt_x, gt_y, exact=exact)
    assert np.abs(found - truth).mean() < 3 * atol

    root = np.sqrt(trimesh.Trimesh(*SPHERE).area)
    truth = angle(SPHERE.vertices[T_yx[T_xy]], SPHERE.vertices) / root
    found = bijectivity(T_xy, T_yx, SPHERE, exact=exact)
    assert np.abs(found - truth).mean() < atol
    at = np.array([5, 160, 5])
    some = bijectivity(T_xy, T_yx, SPHERE, at=at, exact=True)
    np.testing.assert_allclose(some, bijectivity(T_xy, T_yx, SPHERE, exact=True)[at])


def test_errors_have_no_unit_and_follow_labels():
    rng = np.random.default_rng(3)
    T_xy, gt_x, gt_y = (rng.integers(n, size=50) for n in (N_Y, 50, N_Y))
    plain = geodesic_error(T_xy, SMALL, gt_x, gt_y, exact=True)
    order = rng.permutation(N_Y)
    back = np.argsort(order)
    other = Mesh(7 * SMALL.vertices[order], back[SMALL.faces])
    found = geodesic_error(back[T_xy], other, gt_x, back[gt_y], exact=True)
    np.testing.assert_allclose(found, plain, atol=1e-9)


def test_point_cloud_error():
    cloud = SPHERE._replace(faces=np.zeros((0, 3), np.int32))
    T_xy, every = np.roll(np.arange(N_X), 1), np.arange(N_X)
    there = geodesic_error(T_xy, cloud, every[:9], every[:9])
    truth = geodesic_error(T_xy, SPHERE, every[:9], every[:9], exact=True)
    np.testing.assert_allclose(there, truth, rtol=0.3)


@given(seeds, st.sampled_from([(1, 1, 0), (30, 20, 5), (9, 30, 2)]))
def test_coverage(seed, sizes):
    n_x, n_y, extra = sizes
    rng = np.random.default_rng(seed)
    T_xy, mass_y = rng.integers(n_y, size=n_x), rng.uniform(0.1, 1, n_y)
    truth = sum(mass_y[j] for j in set(T_xy.tolist())) / mass_y.sum()
    np.testing.assert_allclose(coverage(T_xy, mass_y), truth)
    # Padding of X points at vertex 0 and must not cover it; padding of Y weighs 0.
    found = coverage(
        jnp.asarray(np.r_[T_xy, np.zeros(extra, int)]),
        np.r_[mass_y, np.zeros(extra)],
        mass_x=np.r_[np.ones(n_x), np.zeros(extra)],
    )
    np.testing.assert_allclose(found, truth)


def test_coverage_ignores_what_is_out_of_range_on_the_device():
    assert coverage(jnp.array([-1, 5, 2]), np.ones(4)) == 0.25


def test_smoothness():
    stiffness = pp3d.cotan_laplacian(SPHERE.vertices, SPHERE.faces)
    T_xy = np.random.default_rng(0).integers(N_Y, size=N_X)
    box = SMALL.vertices * [1, 2, 5] + 3
    scaled = (box - box.min(0)) / (box.max(0) - box.min(0))
    pulled = scaled[T_xy]
    truth = np.mean([f @ stiffness.toarray() @ f for f in pulled.T])
    np.testing.assert_allclose(smoothness(T_xy, box, stiffness), truth)
    # Neither unit matters; a constant map is perfectly smooth; noise is not smooth.
    np.testing.assert_allclose(smoothness(T_xy, 9 * box, stiffness), truth)
    assert abs(smoothness(np.zeros(N_X, int), box, stiffness)) < 1e-9
    assert smoothness(nearest(SPHERE.vertices, SMALL.vertices), box, stiffness) < truth
    # A coordinate function of the unit sphere has energy 8 pi / 3; here its range is 2.
    every = np.arange(N_X)
    found = smoothness(every, SPHERE.vertices, stiffness)
    np.testing.assert_allclose(found, 2 * np.pi / 3, rtol=0.05)
    flat = SPHERE.vertices * [1, 1, 0]
    np.testing.assert_allclose(smoothness(every, flat, stiffness), found * 2 / 3, 0.05)


@given(seeds, st.sampled_from([(1, 1), (1, 4), (8, 5), (5, 8), (7, 7)]))
def test_functional_metrics_match_the_formulas(seed, sizes):
    k_x, k_y = sizes
    C = normal(seed, k_x, k_y)
    evals_x = np.sort(np.abs(normal(seed + 1, k_x)))
    evals_y = np.sort(np.abs(normal(seed + 2, k_y)))
    gap = lambda C: C.T @ C - np.eye(C.shape[1])
    np.testing.assert_allclose(
        orthogonality(jnp.asarray(C)), np.linalg.norm(gap(C), 2), rtol=1e-9
    )
    truth = sum(
        np.linalg.norm(gap(C[:k, :k]), "fro") / k for k in range(1, min(k_x, k_y) + 1)
    )
    np.testing.assert_allclose(zoomout_energy(jnp.asarray(C)), truth, rtol=1e-9)
    commutator = np.diag(evals_x) @ C - C @ np.diag(evals_y)
    for ord in (2, "fro"):
        truth = np.linalg.norm(commutator, ord) / np.linalg.norm(C, ord)
        found = laplacian_commutativity(C, evals_x, evals_y, ord=ord)
        np.testing.assert_allclose(found, truth, rtol=1e-9)


# Few sizes: each is compiled anew.
@pytest.mark.slow
@given(seeds, st.sampled_from([(1, 1, 1), (40, 7, 3), (9, 30, 5)]))
def test_chamfer_matches_the_dense_formula(seed, sizes):
    n_x, n_y, extra = sizes
    x, y = normal(seed, n_x, 4), normal(seed + 1, n_y, 4)
    dist = np.linalg.norm(x[:, None] - y[None], axis=2)
    truth = dist.min(1).mean() + dist.min(0).mean()
    found = spectral_chamfer(jnp.asarray(x), jnp.asarray(y))
    np.testing.assert_allclose(found, truth, rtol=1e-6)
    np.testing.assert_allclose(spectral_chamfer(jnp.asarray(y), jnp.asarray(x)), found)
    pad = lambda a: jnp.asarray(np.r_[a, np.zeros((extra, 4))])
    mass = lambda n: jnp.asarray(np.r_[np.full(n, 0.1), np.zeros(extra)])
    padded = spectral_chamfer(pad(x), pad(y), mass_x=mass(n_x), mass_y=mass(n_y))
    np.testing.assert_allclose(padded, found)


def test_vmap_equals_the_loop():
    C, x, y = (jnp.asarray(normal(i, 3, *s)) for i, s in enumerate(SHAPES))
    evals_x, evals_y = jnp.abs(x[:, :6, 0]), jnp.abs(y[:, :5, 0])
    T_xy = jnp.asarray(np.random.default_rng(0).integers(9, size=(3, 20)))
    for f, args in [
        (orthogonality, (C,)),
        (zoomout_energy, (C,)),
        (laplacian_commutativity, (C, evals_x, evals_y)),
        (spectral_chamfer, (x, y)),
        (coverage, (T_xy, jnp.abs(y[:, :9, 0]))),
    ]:
        loop = jnp.stack([f(*one) for one in zip(*args, strict=True)])
        np.testing.assert_allclose(jax.vmap(f)(*args), loop, rtol=1e-9)


SHAPES = [(6, 5), (20, 4), (15, 4)]  # of C_yx, emb_x, emb_y


def test_float32_stays_float32():
    C, x, y = (jnp.asarray(normal(i, *s), jnp.float32) for i, s in enumerate(SHAPES))
    evals_x, evals_y = jnp.arange(6, dtype=x.dtype), jnp.arange(5, dtype=x.dtype)
    wide = [a.astype(jnp.float64) for a in (C, x, y, evals_x, evals_y)]
    for f, args in [
        (orthogonality, [0]),
        (zoomout_energy, [0]),
        (laplacian_commutativity, [0, 3, 4]),
        (spectral_chamfer, [1, 2]),
    ]:
        found = f(*([C, x, y, evals_x, evals_y][i] for i in args))
        assert found.dtype == jnp.float32
        np.testing.assert_allclose(found, f(*(wide[i] for i in args)), rtol=1e-5)


def test_gradients_are_finite_where_the_metric_is_zero():
    evals = jnp.arange(5.0)
    emb = jnp.asarray(normal(0, 12, 3))
    for grad in (
        jax.grad(orthogonality)(jnp.eye(5)),
        jax.grad(zoomout_energy)(jnp.eye(5)),
        jax.grad(lambda C: laplacian_commutativity(C, evals, evals))(2 * jnp.eye(5)),
        jax.grad(spectral_chamfer)(emb, emb),
    ):
        assert jnp.isfinite(grad).all()


def test_chamfer_gradient():
    x, y = jnp.asarray(normal(0, 12, 3)), jnp.asarray(normal(1, 9, 3))
    step = jnp.asarray(normal(2, 12, 3))
    along = lambda t: spectral_chamfer(x + t * step, y)
    numeric = (along(1e-6) - along(-1e-6)) / 2e-6
    np.testing.assert_allclose(jax.grad(along)(0.0), numeric, rtol=1e-5)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.floats(0.01, 2))
def test_curve_and_area(errors, limit):
    thresholds = np.linspace(0, limit, 2001)
    curve = error_curve(errors, thresholds)
    truth = [(np.array(errors) <= t).mean() for t in thresholds]
    np.testing.assert_allclose(curve, truth)
    assert (np.diff(curve) >= 0).all()
    area = np.trapezoid(curve, thresholds) / limit
    assert abs(auc(errors, limit=limit) - area) < 1e-3


def test_nan_counts_as_wrong():
    errors = [0.0, np.nan]
    np.testing.assert_array_equal(error_curve(errors, [0, 9]), [0.5, 0.5])
    assert auc(errors) == 0.5


class WithFunctionalMap(NamedTuple):
    T_xy: np.ndarray
    T_yx: np.ndarray
    C_yx: np.ndarray


def random_maps():
    rng = np.random.default_rng(5)
    T_xy, T_yx = rng.integers(N_Y, size=N_X), rng.integers(N_X, size=N_Y)
    return WithFunctionalMap(T_xy, T_yx, normal(6, 9, 8))


def test_evaluate_is_the_metrics_one_by_one():
    maps = random_maps()
    T_xy, T_yx, C_yx = maps
    truth = np.arange(N_Y), np.arange(N_Y)[::-1].copy()
    steps = []
    found = evaluate(
        maps,
        SPHERE,
        SMALL,
        truth=truth,
        every=5,
        progress=lambda *step: steps.append(step),
    )
    error = geodesic_error(T_xy, SMALL, truth[0][::5], truth[1][::5])
    np.testing.assert_array_equal(found.error, error)
    assert found.error_mean == error.mean() and found.error_max == error.max()
    assert found.error_median == np.median(error)
    on_x, on_y = np.arange(0, N_X, 5), np.arange(0, N_Y, 5)
    assert found.bijectivity_x == bijectivity(T_xy, T_yx, SPHERE, at=on_x).mean()
    assert found.bijectivity_y == bijectivity(T_yx, T_xy, SMALL, at=on_y).mean()
    (stiffness_x, mass_x), (_, mass_y) = operators(SPHERE), operators(SMALL)
    assert found.coverage_xy == coverage(T_xy, mass_y)
    assert found.coverage_yx == coverage(T_yx, mass_x)
    assert found.smoothness == smoothness(T_xy, SMALL.vertices, stiffness_x)
    assert found.orthogonality == orthogonality(C_yx)
    assert found.zoomout_energy == zoomout_energy(C_yx)
    names = [name for name, _, _ in steps]
    assert list(dict.fromkeys(names)) == ["error", "bijectivity_x", "bijectivity_y"]
    assert steps[-1][1] == steps[-1][2]

    shared = {"operators_x": operators(SPHERE), "operators_y": operators(SMALL)}
    again = evaluate(maps, SPHERE, SMALL, only=("coverage_xy", "smoothness"), **shared)
    assert again.coverage_xy == found.coverage_xy
    assert again.smoothness == found.smoothness
    assert np.isnan(again.bijectivity_x) and np.isnan(again.orthogonality)


def test_evaluate_leaves_out_figures_without_input():
    T_xy, T_yx, _ = random_maps()
    both = evaluate(Maps(T_xy, T_yx), SPHERE, SMALL, every=20)
    assert len(both.error) == 0 and np.isnan(both.error_mean)
    assert np.isnan(both.orthogonality) and both.bijectivity_y > 0
    alone = evaluate(SimpleNamespace(T_xy=T_xy), SPHERE, SMALL)
    measured = {name for name in MEASURED[1:] if not np.isnan(getattr(alone, name))}
    assert measured == {"coverage_xy", "smoothness"}
    assert alone.coverage_xy == both.coverage_xy


def test_evaluate_refuses():
    maps = random_maps()
    with raises("every is 0"):
        evaluate(maps, SPHERE, SMALL, every=0)
    with raises("only holds .'speed'., the figures are .'error', "):
        evaluate(maps, SPHERE, SMALL, only=("error", "speed"))
    with raises("smoothness: T_xy holds|bijectivity: T_xy has"):
        evaluate(maps, SMALL, SPHERE)


def raises(text):
    return pytest.raises(ValueError, match=text)


def test_value_errors():
    T_xy = np.zeros(N_X, int)
    with raises("T_xy holds 42, the mesh has 42"):
        geodesic_error([42], SMALL, [0], [0])
    with raises("gt_x holds 162, the mesh has 162"):
        geodesic_error(T_xy, SMALL, [162], [0])
    with raises("gt_y holds 42"):
        geodesic_error(T_xy, SMALL, [0], [42])
    with raises("gt_x has 2 points, gt_y has 1"):
        geodesic_error(T_xy, SMALL, [0, 1], [0])
    with raises("T_xy has 162 entries, X has 42"):
        bijectivity(T_xy, np.zeros(N_Y, int), SMALL)
    with raises("T_xy holds 2"):
        bijectivity([2] * N_Y, [0, 0], SMALL)
    with raises("T_yx holds 42"):
        bijectivity([0] * N_Y, [0, 42], SMALL)
    with raises("at holds 42"):
        bijectivity([0] * N_Y, [0], SMALL, at=[42])
    with raises("T_xy holds 4, "):
        coverage(np.array([4]), np.ones(4))
    with raises(r"T_xy is \(1, 1\) and mass_y \(4,\)"):
        coverage(np.array([[0]]), np.ones(4))
    with raises(r"mass_x is \(2,\), T_xy is \(1,\)"):
        coverage(np.array([0]), np.ones(4), mass_x=np.ones(2))
    stiffness = sp.csr_matrix(np.eye(N_X))
    with raises(r"stiffness_x is \(162, 162\), T_xy has 42"):
        smoothness(np.arange(N_Y), SMALL.vertices, stiffness)
    with raises("T_xy holds 161"):
        smoothness(np.arange(N_X), SMALL.vertices, stiffness)
    with raises(r"C_yx is \(3, 2\), evals_x and evals_y are \(2,\) and \(3,\)"):
        laplacian_commutativity(jnp.ones((3, 2)), jnp.ones(2), jnp.ones(3))
    with raises("ord is 1"):
        laplacian_commutativity(jnp.ones((3, 2)), jnp.ones(3), jnp.ones(2), ord=1)  # type: ignore
    with raises(r"C_yx is \(3,\)"):
        orthogonality(jnp.ones(3))
    with raises(r"C_yx is \(3,\)"):
        zoomout_energy(jnp.ones(3))
    with raises(r"emb_x is \(3, 2\), emb_y is \(3, 3\)"):
        spectral_chamfer(jnp.ones((3, 2)), jnp.ones((3, 3)))
    with raises(r"mass_y is \(3,\), its embedding is \(4, 2\)"):
        spectral_chamfer(jnp.ones((3, 2)), jnp.ones((4, 2)), mass_y=jnp.ones(3))
    with raises(r"errors are \(0,\)"):
        error_curve([], [1])
    with raises(r"thresholds are \(\)"):
        error_curve([1], 1)
    with raises("limit is 0"):
        auc([1], limit=0)


@pytest.mark.slow
def test_the_authors_numbers():
    """Their metrics of their maps, recomputed: agreement to every digit they print."""
    data = Path(os.environ.get("JFSF_DATA", "data")) / "authors_pair"
    reference = data.parent.parent / "reference" / "authors_pair.json"
    if not (data.is_dir() and reference.is_file()):
        pytest.skip("needs the authors' pair: set JFSF_DATA")
    reference = json.loads(reference.read_text())
    shapes = []
    for name in ("Man0", "Man1"):
        text = (data / f"{name}.off").read_text().split()
        n = int(text[1])
        vertices = np.array(text[4 : 4 + 3 * n], float).reshape(n, 3)
        faces = np.array(text[4 + 3 * n :], int).reshape(-1, 4)[:, 1:]
        mesh = Mesh(vertices, faces.astype(np.int32))
        stiffness, mass = operators(mesh, laplacian="cotan", mass="voronoi")
        root = sp.diags(mass**-0.5)
        symmetric = (root @ stiffness @ root).tocsc()
        evals, evecs = sp.linalg.eigsh(symmetric, 100, sigma=-1e-6)
        shapes.append((mesh, stiffness, mass, evals, mass[:, None] ** -0.5 * evecs))
    (x, stiffness_x, _, evals_x, evecs_x), (y, _, mass_y, evals_y, evecs_y) = shapes
    n = len(x.vertices)

    # Conversion at k = 100 by nearest neighbour in the adjoint space.
    truth = reference["conversion"]["rows"][-1]["nn"]
    T_xy = nearest_in_blocks(evecs_x @ (np.linalg.pinv(evecs_x) @ evecs_y), evecs_y)
    assert round(float(coverage(T_xy, mass_y)), 4) == truth["coverage"]
    assert round(smoothness(T_xy, y.vertices, stiffness_x), 3) == truth["smoothness"]
    # Theirs is Euclidean: shorter, but close where the errors are small.
    straight = np.linalg.norm(y.vertices[T_xy] - y.vertices, axis=1)
    area_x, area_y = (trimesh.Trimesh(*m, process=False).area for m in (x, y))
    assert round(straight.mean() / np.sqrt(area_y), 5) == truth["error"]
    some = np.arange(0, n, 10)
    error = geodesic_error(T_xy, y, some, some, exact=True).mean()
    straight = straight[some].mean() / np.sqrt(area_y)
    assert straight <= error < 1.1 * straight

    # ZoomOut by nearest neighbour from the rough map.
    truth = reference["refinement"]["rows"]["zoomout_nn"]
    T_xy = np.loadtxt(data / "Man0_Man1.map").astype(int) - 1
    for k in range(20, 101, 16):
        C_yx = np.linalg.pinv(evecs_x[:, :k]) @ evecs_y[T_xy, :k]
        T_xy = nearest_in_blocks(evecs_x[:, :k], evecs_y[:, :k] @ C_yx.T)
    C_yx = np.linalg.pinv(evecs_x) @ evecs_y[T_xy]
    found = laplacian_commutativity(C_yx, evals_x, evals_y)
    assert round(float(found), 1) == truth["laplacian_commutativity"]
    assert round(float(zoomout_energy(C_yx)), 3) == truth["zoomout_energy"]
    assert round(float(orthogonality(C_yx)), 4) == truth["orthogonality"]
    sums = n * float(spectral_chamfer(evecs_x @ C_yx, evecs_y))
    assert round(sums, -1) == truth["chamfer"]
    # On shapes of area 1 it is sqrt(area of Y) times that.
    unit_C = C_yx * np.sqrt(area_y / area_x)
    unit = spectral_chamfer(
        np.sqrt(area_x) * evecs_x @ unit_C, np.sqrt(area_y) * evecs_y
    )
    np.testing.assert_allclose(n * unit / np.sqrt(area_y), sums, rtol=1e-6)


def nearest_in_blocks(queries, points):
    offset = (points**2).sum(1) / 2
    blocks = np.array_split(queries, 8)
    return np.concatenate([(block @ points.T - offset).argmax(1) for block in blocks])


def test_reliability_compares_probabilities_with_what_came():
    found = reliability([0.1, 0.15, 0.9, 1.0], [False, True, True, True])
    assert np.array_equal(np.flatnonzero(found.weight), [1, 9])
    np.testing.assert_allclose(found.probability[[1, 9]], [0.125, 0.95])
    np.testing.assert_allclose(found.share[[1, 9]], [0.5, 1])
    assert found.calibration_error == pytest.approx((0.375 + 0.05) / 2)
    assert np.isnan(found.share[0])
    weighed = reliability([0.1, 0.9], [False, False], weights=[3, 1], bins=2)
    assert weighed.calibration_error == pytest.approx(0.75 * 0.1 + 0.25 * 0.9)
    rng = np.random.default_rng(0)
    p = rng.uniform(size=50_000)
    assert reliability(p, rng.uniform(size=len(p)) < p).calibration_error < 0.01
