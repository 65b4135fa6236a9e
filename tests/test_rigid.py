"""Shapes that a motion lays on each other, and the map that follows from it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jfsf import testing
from jfsf.matching._rigid import motion, moved_by_map
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
    assert found.apart < 0.006 and off(found.T_xy) < 0.15 * off(T)


def test_how_far_apart_the_surfaces_stay():
    y, truth = shuffled(Mesh(BLOB.vertices * [1, 1, 1.1], BLOB.faces))
    found = moved_by_map(spec_of(BLOB), spec_of(y), truth, mirrors=False)
    assert 0.002 < found.apart < 0.03


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
