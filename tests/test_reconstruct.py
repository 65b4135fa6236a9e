"""The oriented surface of a point cloud, against the surface it was sampled from."""

import numpy as np
import pytest

from jfsf import basis, data, testing
from jfsf.mesh import check, reconstruct, surface_area
from jfsf.mesh._geometry import face_normals, vertex_components, vertex_normals
from jfsf.types import Mesh

NONE = np.zeros((0, 3), np.int32)


def random(seed=0):
    return np.random.default_rng(seed)


def sphere(n):
    points = random().normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, points


def torus(n):
    """Points of radius 0.4 around a circle of radius 1, and their normals."""
    around, across = random().random((2, n)) * 2 * np.pi
    out = np.stack([np.cos(around), np.sin(around), 0 * around], 1)
    normals = out * np.cos(across)[:, None]
    normals[:, 2] = np.sin(across)
    return out + 0.4 * normals, normals


def shape(name, noise=0.0):
    mesh = data.load(name).mesh
    step = random().normal(size=mesh.vertices.shape)
    moved = mesh.vertices + noise * np.sqrt(surface_area(mesh)) * step
    return moved, vertex_normals(*mesh)


def triangles(faces):
    """The faces, each from its lowest corner on."""
    turn = (faces.argmin(1)[:, None] + np.arange(3)) % 3
    return set(map(tuple, np.take_along_axis(faces, turn, 1).tolist()))


@pytest.mark.parametrize(
    ("cloud", "same", "opposite"),
    [
        (sphere(1000), 1, 0),
        (torus(2000), 0.99, 0),
        (shape("man_walk"), 0.95, 0.005),
        # Thighs on calves, and arms on the trunk.
        (shape("heavy_squat"), 0.95, 0.005),
        (shape("woman_squat", 0.005), 0.85, 0.01),
    ],
)
def test_normals_are_the_true_ones(cloud, same, opposite):
    points, normals = cloud
    surface, whole = reconstruct(Mesh(points, NONE))
    agree = (vertex_normals(*surface) * normals).sum(1)
    assert (agree > 0.5).mean() >= same
    assert (agree < -0.3).mean() <= opposite
    report = check(surface)
    assert report.boundary_edges == 0 and report.degenerate_faces == 0
    # Of every edge, half of the faces run either way.
    assert abs(face_normals(*surface).sum(0)).max() < 1e-9
    if len(whole.faces):
        assert not vertex_components(whole.faces, len(points)).any()
        assert triangles(surface.faces) <= triangles(whole.faces)


def test_the_laplacian_is_the_surface_s_unless_much_is_left_out():
    for noise, filled in ((0.0, True), (0.005, False)):
        cloud = Mesh(shape("man_walk", noise)[0], NONE)
        surface, whole = reconstruct(cloud)
        assert len(surface.faces) and bool(len(whole.faces)) == filled
        spec = basis(cloud, cache=False)
        np.testing.assert_array_equal(spec.faces, surface.faces)
        assert len(spec.mass) == len(cloud.vertices) and spec.mass.min() > 0


def test_most_triangles_are_those_of_the_mesh():
    mesh = data.load("man_up").mesh
    surface = reconstruct(mesh._replace(faces=NONE)).surface
    found = triangles(surface.faces)
    assert len(found & triangles(mesh.faces)) > 0.97 * len(found)
    assert 0.95 < surface_area(surface) / surface_area(mesh) < 1.02


def test_motion_scale_and_labels_change_nothing():
    mesh = testing.blob(1, subdivisions=3)
    points, n = mesh.vertices, len(mesh.vertices)
    plain = reconstruct(Mesh(points, NONE))
    turn = np.linalg.qr(random().normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = reconstruct(Mesh(1e6 * points @ turn.T + 1e5, NONE))
    order = random(1).permutation(n)
    renumbered = reconstruct(Mesh(points[order], NONE))
    for ours, by_motion, by_label in zip(plain, moved, renumbered, strict=True):
        assert triangles(ours.faces) == triangles(by_motion.faces)
        assert triangles(ours.faces) == triangles(order[by_label.faces])


def test_a_mirrored_cloud_has_the_mirrored_surface():
    points = testing.blob(2, subdivisions=3).vertices
    plain = reconstruct(Mesh(points, NONE)).surface.faces
    mirrored = reconstruct(Mesh(points * [-1, 1, 1], NONE)).surface.faces
    assert triangles(mirrored[:, [0, 2, 1]]) == triangles(plain)


def test_a_cut_body_stays_open_and_faces_outward():
    points, normals = shape("man_walk")
    upper = points[:, 1] > points[:, 1].mean()
    surface = reconstruct(Mesh(points[upper], NONE)).surface
    assert check(surface).closed is False
    agree = (vertex_normals(*surface) * normals[upper]).sum(1)
    assert (agree > 0.5).mean() > 0.9 and (agree < -0.3).mean() < 0.02


def wavy_sheet(n):
    x, y = random().random((2, n))
    return np.stack([x, y, 0.1 * np.sin(7 * x) * np.cos(5 * y)], 1)


@pytest.mark.parametrize(
    "points",
    [
        np.eye(3),
        random().random((30, 3)),
        np.arange(200.0)[:, None] * [1, 2, 3],
        random().random((500, 2)) @ [[1, 0, 1], [0, 1, 1]],
        wavy_sheet(1000),
        random().random((1000, 3)),
        sphere(1000)[0] * (1 + 0.1 * random(1).normal(size=(1000, 1))),
        np.repeat(sphere(20)[0], 20, 0),
    ],
    ids=["few", "30", "line", "plane", "sheet", "volume", "noise", "repeated"],
)
def test_what_has_no_outside_gets_no_faces(points):
    cloud = Mesh(points, NONE)
    for mesh in reconstruct(cloud):
        assert mesh.vertices is cloud.vertices
        assert mesh.faces.shape == (0, 3) and mesh.faces.dtype == np.int32
