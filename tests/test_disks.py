"""Disks: which shapes are, how they lie in the plane, and the turns between two."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay

from jfsf import testing
from jfsf.matching._disks import as_disk, is_disk, turned_maps
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import vertex_areas
from jfsf.runtime._sizes import pad
from jfsf.types import Mesh, Spectrum


def spec_of(mesh):
    """Without eigenpairs, which no disk needs."""
    vertices = mesh.vertices / np.sqrt(surface_area(mesh))
    vertices = vertices - vertices.mean(0)
    n = len(vertices)
    mass = vertex_areas(vertices, mesh.faces)
    return Spectrum(np.zeros(2), np.zeros((n, 2)), mass, mesh.faces, vertices)


def relief(points):
    """Height above a disk: bumps at places of no symmetry."""
    bumps = ((0.5, 0.1, 0.5), (-0.3, 0.4, 0.3), (0.0, -0.6, 0.25))
    away = [((points - [x, y]) ** 2).sum(1) for x, y, _ in bumps]
    heights = [h * np.exp(-d / 0.05) for d, (*_, h) in zip(away, bumps, strict=True)]
    return np.sum(heights, 0) - 0.3 * (points**2).sum(1)


def double_area(a, b, c):
    """Of flat triangles; negative where they are clockwise."""
    (x, y), (u, v) = (b - a).T, (c - a).T
    return x * v - y * u


def disk(n, seed, hole=False):
    """A relief, meshed anew for each seed."""
    rng = np.random.default_rng(seed)
    i = np.arange(n) + 0.5
    radius, angle = np.sqrt(i / n), np.pi * (1 + 5**0.5) * i + rng.uniform(0, 7)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    faces = Delaunay(flat).simplices
    a, b, c = (flat[faces[:, j]] for j in range(3))
    area = double_area(a, b, c)
    faces = np.where((area < 0)[:, None], faces[:, ::-1], faces)
    kept = abs(area) > 0.1 / n
    if hole:
        kept &= np.linalg.norm(flat[faces].mean(1), axis=1) > 0.2
    mesh = Mesh(np.c_[flat, relief(flat)], faces[kept].astype(np.int32))
    mesh, used = compact(mesh)
    return mesh, flat[used]


def compact(mesh):
    """Without vertices that belong to no face; and which are kept."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    return Mesh(mesh.vertices[used], faces), used


def test_which_shapes_are_disks():
    assert is_disk(spec_of(disk(300, 0)[0]))
    assert is_disk(spec_of(disk(400, 0, hole=True)[0]))  # a short rim is a hole
    tube = trimesh.creation.cylinder(1, 3, sections=24)
    open_tube = Mesh(tube.vertices, tube.faces[abs(tube.face_normals[:, 2]) < 0.5])
    assert not is_disk(spec_of(compact(open_tube)[0]))
    assert not is_disk(spec_of(testing.blob(0)))


def test_a_disk_lies_in_the_plane_without_folds():
    mesh, _ = disk(300, 0)
    spec = spec_of(mesh)
    n = len(mesh.vertices)
    found = as_disk(pad(spec, n + 7, len(mesh.faces) + 5))
    assert found.points.shape == (n, 3) and found.flat.shape == (n, 2)
    np.testing.assert_allclose(found.share.sum(), 1)
    assert np.linalg.norm(found.flat, axis=1).max() < 1 + 1e-9
    a, b, c = (found.flat[mesh.faces[:, j]] for j in range(3))
    # As the faces are wound: seen from outside.
    assert double_area(a, b, c).min() > 0


@pytest.mark.parametrize("mirrors", [False, True])
def test_the_first_turn_is_the_right_one(mirrors):
    (x, flat_x), (y, flat_y) = disk(500, 0), disk(450, 3)
    if mirrors:
        y = testing.mirror(y)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    y = testing.move(y, (turn * np.sign(np.linalg.det(turn)), np.ones(3)))
    maps = turned_maps(as_disk(spec_of(x)), as_disk(spec_of(y)), mirrors=mirrors)
    away = [np.linalg.norm(flat_y[T] - flat_x, axis=1).mean() for T in maps]
    assert away[0] < 0.06 and 1 <= len(maps) <= 3
    assert all(other > 0.15 for other in away[1:])
