"""Shapes that a motion lays on each other, and the map that follows from it."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from jfsf import testing
from jfsf.matching import _rigid
from jfsf.matching._rigid import motion, moved_by_map
from jfsf.matching._stiff import nearest_alike, principal_warps
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import vertex_areas
from jfsf.runtime._sizes import pad
from jfsf.types import Mesh, Spectrum

ROUND = testing.blob(0, subdivisions=3)
# Without a direction in which it could roll.
BLOB = Mesh(ROUND.vertices * [1, 0.5, 1.8], ROUND.faces)
N = len(BLOB.vertices)


def spec_of(mesh):
    """Without eigenpairs, which no motion needs."""
    vertices = mesh.vertices / np.sqrt(surface_area(mesh))
    mass = vertex_areas(vertices, mesh.faces)
    vertices = vertices - mass @ vertices
    n = len(vertices)
    return Spectrum(np.zeros(2), np.zeros((n, 2)), mass, mesh.faces, vertices)


def shuffled(mesh, seed=0, mirrors=False):
    """Turned, in another order; mirrored if asked for, wound outward. And the truth."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(mesh.vertices))
    place = np.argsort(order)
    turned = Rotation.random(random_state=seed).apply(mesh.vertices)
    faces = place[mesh.faces]
    if mirrors:
        turned, faces = turned * [-1, 1, 1], faces[:, ::-1]
    return Mesh(turned[order], faces.astype(np.int32)), place


def slid(T, mesh, seed=0, away=0.06):
    """The map with errors: each image is the vertex next to a point somewhat off it."""
    rng = np.random.default_rng(seed)
    unit = np.sqrt(surface_area(mesh))
    direction = rng.normal(size=3)
    shift = away * unit * direction / np.linalg.norm(direction)
    points = mesh.vertices[T] + shift
    return np.linalg.norm(points[:, None] - mesh.vertices[None], axis=2).argmin(1)


@pytest.mark.parametrize("mirrors", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_map_that_slides_is_mended(mirrors, seed):
    y, truth = shuffled(BLOB, seed, mirrors)
    T = slid(truth, y, seed)
    spec_x, spec_y = spec_of(BLOB), spec_of(y)
    padded = pad(spec_x, N + 5, len(BLOB.faces) + 7)
    given = np.concatenate([T, np.zeros(5, int)])
    found = moved_by_map(padded, spec_y, given, mirrors=mirrors)
    points = spec_y.vertices
    off = lambda T: np.linalg.norm(points[T] - points[truth], axis=1).mean()
    away = np.linalg.norm(found.bent.moved_x[:N] - points[truth], axis=1)
    assert found.apart < 0.006 and away.mean() < 0.15 * off(T)


def test_how_far_apart_the_surfaces_stay():
    y, truth = shuffled(Mesh(BLOB.vertices * [1, 1, 1.1], BLOB.faces))
    found = moved_by_map(spec_of(BLOB), spec_of(y), truth, mirrors=False)
    assert found.apart < 0.002


def test_other_poses_and_clouds_are_left_alone():
    angle = 2 * BLOB.vertices[:, 2]
    twisted = Rotation.from_rotvec(np.outer(angle, [0, 0, 1])).apply(BLOB.vertices)
    bent, truth = shuffled(Mesh(twisted, BLOB.faces))
    assert moved_by_map(spec_of(BLOB), spec_of(bent), truth, mirrors=False) is None
    cloud = spec_of(BLOB)._replace(faces=np.zeros((0, 3), np.int32))
    T = np.arange(N)
    assert moved_by_map(cloud, spec_of(BLOB), T, mirrors=False) is None
    assert moved_by_map(spec_of(BLOB), cloud, T, mirrors=False) is None


@pytest.mark.parametrize("mirrors", [False, True])
@pytest.mark.parametrize("scale", [0.7, 1.0, 3.0])
def test_a_motion_is_found_exactly(mirrors, scale):
    rng = np.random.default_rng(0)
    points, weight = rng.normal(size=(20, 3)), rng.uniform(0.1, 1, 20)
    side = [-1, 1, 1] if mirrors else [1, 1, 1]
    turn = Rotation.random(random_state=1)
    images = scale * turn.apply(points * side) + [1, 2, 3]
    move = motion(points, images, weight, mirrors=mirrors, scaled=True)
    np.testing.assert_allclose(move(points), images, atol=1e-9)
    rigid = motion(points, images, weight, mirrors=mirrors)
    edges = np.linalg.norm(np.diff(rigid(points), axis=0), axis=1)
    wanted = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(edges, wanted, atol=1e-9)


def deformed(mesh, by=1.0):
    """Stretched, bent along its length and turned in itself: smooth on the whole."""
    x, y, z = (mesh.vertices / np.ptp(mesh.vertices[:, 2])).T
    there = np.stack([x + 0.15 * by * z**2, y * (1 + 0.2 * by), z * (1 + 0.1 * by)], 1)
    turns = np.outer(0.3 * by * z, [0, 0, 1])
    return Mesh(Rotation.from_rotvec(turns).apply(there), mesh.faces)


@pytest.mark.parametrize("mirrors", [False, True])
def test_a_smooth_deformation_is_recovered(mirrors, monkeypatch):
    y, truth = shuffled(deformed(BLOB), 1, mirrors)
    spec_x, spec_y = spec_of(BLOB), spec_of(y)
    padded = pad(spec_x, N + 5, len(BLOB.faces) + 7)
    T = np.concatenate([slid(truth, y), np.zeros(5, int)])
    moved = moved_by_map(padded, spec_y, T, mirrors=mirrors)
    monkeypatch.setattr(_rigid, "stiffly_onto", lambda mesh, laid, *_, **__: laid)
    laid = moved_by_map(padded, spec_y, T, mirrors=mirrors)
    assert moved.apart < 0.3 * laid.apart
    target = Mesh(spec_y.vertices, y.faces)
    off = lambda there: np.linalg.norm(there - target.vertices[truth], axis=1).mean()
    back = lambda there: np.linalg.norm(there[truth] - spec_x.vertices, axis=1).mean()
    assert off(moved.bent.moved_x[:N]) < 0.5 * off(laid.bent.moved_x[:N])
    assert back(moved.bent.moved_y) < 0.5 * back(laid.bent.moved_y)
    for one in (moved, laid):
        assert not one.bent.moved_x[N:].any()
    error = lambda one: off(
        target.vertices[
            nearest_alike(
                Mesh(one.bent.moved_x[:N], BLOB.faces), target, mirrors=mirrors
            )
        ]
    )
    assert error(moved) < 0.6 * error(laid)


def test_shapes_that_coincide_stay():
    spec = spec_of(BLOB)
    moved = moved_by_map(spec, spec, np.arange(N), mirrors=False)
    for points in moved.bent:
        np.testing.assert_allclose(points, spec.vertices, atol=1e-6)


def test_a_turn_and_the_size_of_x_change_nothing():
    y, truth = shuffled(deformed(BLOB), 1)
    other = Mesh(3 * Rotation.random(random_state=5).apply(BLOB.vertices), BLOB.faces)
    found = [
        moved_by_map(spec_of(x), spec_of(y), truth, mirrors=False).bent.moved_x
        for x in (BLOB, other)
    ]
    np.testing.assert_allclose(*found, atol=1e-5)


def test_warps_have_the_energy_of_a_thin_plate():
    """Of the fields through given values at the centres theirs has the least energy."""
    rng = np.random.default_rng(0)
    centres, points = rng.normal(size=(2, 30, 3))
    warps, energy = principal_warps(points, centres)
    ours = warps(centres)
    plain = RBFInterpolator(centres, ours, kernel="linear", degree=1)
    at = rng.normal(size=(50, 3))
    np.testing.assert_allclose(warps(at), plain(at), atol=1e-6)
    kernel = -np.linalg.norm(centres[:, None] - centres, axis=2)
    affine = np.hstack([np.ones((30, 1)), centres])
    system = np.block([[kernel, affine], [affine.T, np.zeros((4, 4))]])
    weight = np.linalg.solve(system, np.vstack([ours, np.zeros((4, ours.shape[1]))]))
    np.testing.assert_allclose(
        np.diag(weight[:30].T @ kernel @ weight[:30]), energy, rtol=1e-5, atol=1e-6
    )
    assert (np.diff(energy[4:]) >= 0).all() and energy[4] > 0
    square = np.mean(warps(points)[:, 4:20] ** 2, 0)
    np.testing.assert_allclose(square, 1, rtol=1e-3)
