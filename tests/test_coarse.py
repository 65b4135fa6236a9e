"""Coarse copies: shapes at few vertices, on which further starts are tried."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from shapes import small

import jfsf
from jfsf import testing
from jfsf.matching import Settings, carried
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._coarse import CoarseCopy, coarse_copy, padded_copies
from jfsf.mesh._geometry import vertex_areas, vertex_normals
from jfsf.runtime._sizes import pad
from jfsf.spectral import functional_map
from jfsf.types import Mesh, Spectrum

NAMES = "man_walk", "man_up"
FEW = Settings(coarse_vertices=300)


@cache
def whole(name):
    mesh, vertex = small(name, 2000)
    return jfsf.basis(mesh, cache=False), vertex


@cache
def copy(name):
    return coarse_copy(whole(name)[0], settings=FEW)


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_has_the_eigenfunctions_of_the_whole(name):
    (spec, _), (own, on_whole, on_copy) = whole(name), copy(name)
    n = len(own.mass)
    assert 250 < n < 350 < len(spec.mass)
    assert on_whole.shape == (n,) and on_copy.shape == spec.mass.shape
    np.testing.assert_array_equal(own.evals, spec.evals)
    np.testing.assert_array_equal(own.evecs, np.asarray(spec.evecs)[on_whole])
    assert own.mass.min() > 0
    np.testing.assert_allclose(own.mass.sum(), 1)
    assert own.faces.min() == 0 and own.faces.max() == n - 1


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_lies_on_the_whole(name):
    spec, (own, on_whole, on_copy) = whole(name)[0], copy(name)
    points = np.asarray(spec.vertices)
    nearest = KDTree(points).query(own.vertices)[0]
    away = np.linalg.norm(points[on_whole] - own.vertices, axis=1)
    assert away.max() < 0.06 and np.quantile(away - nearest, 0.9) < 0.01
    nearest = KDTree(own.vertices).query(points)[0]
    away = np.linalg.norm(own.vertices[on_copy] - points, axis=1)
    assert away.max() < 0.1 and np.quantile(away - nearest, 0.9) < 0.01


def test_a_copy_reads_the_sheet_that_it_lies_on():
    # A lens so thin that the nearest vertex may be on the other side.
    ball = trimesh.creation.icosphere(4)
    turn = Rotation.from_rotvec([0.3, 0.5, 0.2])  # else vertices lie above each other
    points = turn.apply(ball.vertices) * [0.4, 0.4, 0.004]
    mass = vertex_areas(points, ball.faces)
    evecs = np.zeros((len(points), 2))
    spec = Spectrum(np.zeros(2), evecs, mass, ball.faces, points)  # type: ignore
    own, on_whole, _ = coarse_copy(spec, settings=FEW)
    meshes = (points, ball.faces), (own.vertices, own.faces)
    up, copy_up = (vertex_normals(*mesh)[:, 2] > 0 for mesh in meshes)
    inner = np.hypot(*np.asarray(own.vertices).T[:2]) < 0.3  # not at the rim
    np.testing.assert_array_equal(up[on_whole][inner], copy_up[inner])
    nearest = KDTree(points).query(own.vertices)[1]
    assert np.mean(up[nearest][inner] != copy_up[inner]) > 0.1


def test_a_functional_map_of_the_copies_is_one_of_the_whole_shapes():
    k = 20
    (spec_x, at_x), (spec_y, at_y) = map(whole, NAMES)
    own_x, own_y = (copy(name).spectrum for name in NAMES)
    # The true map, as the template says it.
    near = KDTree(np.asarray(spec_x.vertices)[at_x]).query(spec_x.vertices)[1]
    T_xy = at_y[near]
    T_copies = copy("man_up").on_copy[T_xy[copy("man_walk").on_whole]]
    cut = lambda spec: spec._replace(evals=spec.evals[:k], evecs=spec.evecs[:, :k])
    there, here = (
        np.asarray(functional_map(jnp.asarray(T), cut(x), cut(y)))
        for T, x, y in ((T_xy, spec_x, spec_y), (T_copies, own_x, own_y))
    )
    assert np.linalg.norm(there - here) < 0.2 * np.linalg.norm(there)


def turned(points, seed, mirrored):
    """Rotated and shifted, and mirrored."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn)) * (-1 if mirrored else 1)
    return points @ turn.T + rng.normal(size=3)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_whole_shape_follows_a_rigid_motion_of_its_copy(mirrored):
    spec, few = whole("man_up")[0], copy("man_up")
    moved = turned(few.spectrum.vertices, 0, mirrored)
    found = carried(moved, few, spec, mirrored=mirrored)
    truth = turned(np.asarray(spec.vertices), 0, mirrored)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_a_whole_shape_follows_the_pose_of_its_copy():
    spec, few = whole("man_walk")[0], copy("man_walk")
    v = np.asarray(spec.vertices)
    bent = v + np.maximum(v[:, 1:2] - v[:, 1].mean(), 0) ** 2 * [[0.0, 0.0, 1.5]]
    # The copy does not lie exactly on the whole shape.
    w = few.spectrum.vertices
    moved = w + np.maximum(w[:, 1:2] - v[:, 1].mean(), 0) ** 2 * [[0.0, 0.0, 1.5]]
    n = len(v)
    padded = pad(spec, n + 5, len(spec.faces) + 3)
    found = carried(np.concatenate([moved, np.ones((4, 3))]), few, padded)
    assert np.abs(bent - v).max() > 0.3 and np.abs(found[n:]).max() == 0
    away = np.linalg.norm(found[:n] - bent, axis=1)
    nearest = np.linalg.norm(moved[few.on_copy] - bent, axis=1)
    assert away.mean() < 0.25 * nearest.mean()
    assert away.max() < 0.05


def test_what_is_unknown_of_a_copy_stays_near_there():
    spec, few = whole("man_walk")[0], copy("man_walk")
    moved = np.array(few.spectrum.vertices)
    moved[7] = np.nan
    found = carried(moved, few, spec)
    near = np.linalg.norm(spec.vertices - few.spectrum.vertices[7], axis=1) < 0.3
    assert np.isnan(found).any() and not np.isnan(found[~near]).any()


def test_sheets_that_touch_are_carried_apart():
    # Two squares at a distance of half an edge of the copy, wound outward.
    fine, rough = sheets(51), sheets(26)
    n = len(rough.vertices)
    few = CoarseCopy(flat_spectrum(rough), np.zeros(n, int), np.zeros(n, int))
    spec = flat_spectrum(fine)
    upper = lambda mesh: mesh.vertices[:, 2] > 0
    moved = rough.vertices + np.where(upper(rough)[:, None], [[0, 0, 1.0]], 0)
    found = carried(moved, few, spec)
    truth = fine.vertices + np.where(upper(fine)[:, None], [[0, 0, 1.0]], 0)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def flat_spectrum(mesh):
    """Of the constant function."""
    n = len(mesh.vertices)
    return Spectrum(
        np.zeros(1), np.ones((n, 1)), np.full(n, 1 / n), mesh.faces, mesh.vertices
    )


def sheets(size):
    """Two squares of so many vertices a side, one above the other."""
    i, j = np.divmod(np.arange(size**2), size)
    flat = np.stack([i, j, 0 * i], 1) / (size - 1)
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    quads = corner[:, None] + [0, size, size + 1, 1]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    both = np.concatenate([flat + [0, 0, 0.02], flat])
    return Mesh(both, np.concatenate([faces, size**2 + faces[:, ::-1]]))


def test_padding_is_left_out():
    spec = testing.blob_spectrum(0, 40, 3)
    n, m = len(spec.mass), len(spec.faces)
    plain = coarse_copy(spec, settings=FEW)
    padded = coarse_copy(pad(spec, n + 7, m + 9), settings=FEW)
    for ours, theirs in zip(padded.spectrum, plain.spectrum, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(padded.on_copy, plain.on_copy)


def test_a_shape_of_few_vertices_is_its_own_copy():
    spec = testing.blob_spectrum(0, 40)
    own, on_whole, on_copy = coarse_copy(spec, settings=FEW)
    n = len(spec.mass)
    np.testing.assert_array_equal(own.evecs, spec.evecs)
    np.testing.assert_array_equal(own.faces, spec.faces)
    np.testing.assert_array_equal(on_whole, np.arange(n))
    np.testing.assert_array_equal(on_copy, np.arange(n))


def test_a_shape_that_falls_apart_is_its_own_copy():
    spec = testing.blob_spectrum(0, 40, 3)
    # Of its surface a small piece is left.
    torn = spec._replace(faces=spec.faces[:20])
    assert len(coarse_copy(torn, settings=FEW).spectrum.mass) == len(spec.mass)


def test_arguments_move_to_the_copies():
    specs = [whole(name)[0] for name in NAMES]
    landmarks = np.array([3, 70]), np.array([8, 20])
    descriptors = tuple(np.asarray(spec.vertices) for spec in specs)
    given = MatchInputs(landmarks, descriptors, np.eye(30), sign=-1)
    pair, found = padded_copies([copy(name) for name in NAMES], given)
    assert found.initial is None and found.sign == -1
    for spec, own, at, there in zip(
        specs, pair, landmarks, found.landmarks, strict=True
    ):
        away = np.asarray(own.vertices)[there] - np.asarray(spec.vertices)[at]
        assert np.linalg.norm(away, axis=1).max() < 0.1
    for own, values in zip(pair, found.descriptors, strict=True):
        real = np.asarray(own.mass) > 0
        assert len(values) == len(real) > real.sum()
        assert np.linalg.norm(values - own.vertices, axis=1)[real].max() < 0.05


def test_few_coarse_vertices_are_an_error():
    with pytest.raises(ValueError, match="coarse_vertices is 100; give 160 or more"):
        Settings(coarse_vertices=100)
