"""Frames found from the geometry: feet down, facing the viewer, in any axes."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jfsf.apps.plot._colours import frame
from jfsf.apps.plot._upright import find_frame, find_frames
from jfsf.data import load, names
from jfsf.mesh import coarsen, face_normals, largest_component
from jfsf.types import Mesh

# From y up and front z, as the shapes are.
TURNS = {
    "z up": Rotation.from_euler("x", 90, degrees=True),
    "x up": Rotation.from_euler("z", -90, degrees=True),
    "-y up": Rotation.from_euler("z", 180, degrees=True),
    "random": Rotation.random(rng=3),
}
PLAIN = np.eye(3)


def turned(mesh, rotation):
    return mesh._replace(vertices=rotation.apply(mesh.vertices))


def degrees(one, other):
    """Of the rotation between two frames."""
    return np.degrees(Rotation.from_matrix(one @ other.T).magnitude())


@pytest.mark.parametrize("name", names())
def test_a_body_stands_and_faces_the_viewer_in_any_axes(name):
    mesh = load(name).mesh
    plain = find_frame(mesh).axes
    # A walking or kicking body has no exact up; its trunk leans.
    up, front = np.degrees(np.arccos(np.diag(plain)[1:]))
    assert up < 25 and front < 30
    # Each body in two ways, and each way for three bodies or more.
    others = [turn for way, turn in TURNS.items() if way != "random"]
    for turn in (TURNS["random"], others[names().index(name) % len(others)]):
        found = find_frame(turned(mesh, turn)).axes
        assert np.allclose(found.T @ found, PLAIN) and np.linalg.det(found) > 0
        assert degrees(found, turn.apply(plain.T).T) < 3


def identity_of(mesh):
    return np.arange(len(mesh.vertices), dtype=np.int32)


@pytest.mark.parametrize("name", ["man_up", "child_kick"])
def test_a_pair_is_seen_from_one_side_whatever_the_axes_of_its_files(name):
    mesh = load(name).mesh
    other = turned(mesh, TURNS["random"])
    one, two = find_frames(mesh, other, identity_of(mesh))
    assert degrees(two.axes, TURNS["random"].apply(one.axes.T).T) < 3


@pytest.mark.parametrize("swapped", [False, True])
def test_a_part_stands_as_the_whole_does(swapped):
    whole = load("woman_squat").mesh
    kept = whole.vertices[:, 1] > np.quantile(whole.vertices[:, 1], 0.4)
    faces = whole.faces[kept[whole.faces].all(1)]
    part, index = largest_component(Mesh(whole.vertices, faces))
    nearest = KDTree(part.vertices).query(whole.vertices)[1]
    if swapped:
        other, own = find_frames(whole, part, nearest)
    else:
        own, other = find_frames(part, whole, index)
    assert degrees(own.axes, other.axes) < 3
    assert degrees(other.axes, find_frame(whole).axes) < 3
    assert degrees(find_frame(part).axes, other.axes) > 90  # on its own it would not


def test_the_surer_shape_decides(monkeypatch):
    from jfsf.apps.plot import _upright
    from jfsf.apps.plot._upright import Frame

    mesh = load("man_up").mesh
    turn = Rotation.from_euler("y", 90, degrees=True)
    frames = {0: Frame(PLAIN, 5.0), 1: Frame(PLAIN, 0.5)}
    for first in (0, 1):
        order = iter([frames[first], frames[1 - first]])
        monkeypatch.setattr(
            _upright, "find_frame", lambda mesh, order=order: next(order)
        )
        one, two = find_frames(mesh, turned(mesh, turn), identity_of(mesh))
        sure = one if first == 0 else two
        assert sure.margin == 5 and np.array_equal(sure.axes, PLAIN)
        assert degrees(two.axes, turn.apply(one.axes.T).T) < 1e-3


def test_two_sure_shapes_keep_their_frames(monkeypatch):
    from jfsf.apps.plot import _upright
    from jfsf.apps.plot._upright import Frame

    mesh = load("man_up").mesh
    monkeypatch.setattr(_upright, "find_frame", lambda mesh: Frame(PLAIN, 2.0))
    # As by a map that exchanges arms and legs.
    found = find_frames(mesh, turned(mesh, TURNS["-y up"]), identity_of(mesh))
    assert all(np.array_equal(frame.axes, PLAIN) for frame in found)


def test_a_mirrored_map_leaves_both_facing_the_viewer():
    mesh = load("man_up").mesh
    mirrored = Mesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1])
    one, two = find_frames(mesh, mirrored, identity_of(mesh))
    assert degrees(one.axes, two.axes) < 35


def test_a_wrong_map_leaves_each_shape_its_own_frame():
    x, y = load("man_up").mesh, turned(load("man_walk").mesh, TURNS["z up"])
    chance = np.random.default_rng(0).integers(0, len(y.vertices), len(x.vertices))
    one, two = find_frames(x, y, chance)
    assert np.array_equal(one.axes, find_frame(x).axes)
    assert np.array_equal(two.axes, find_frame(y).axes)


def test_up_that_is_known_leaves_the_front_to_be_found():
    mesh = turned(load("man_up").mesh, TURNS["z up"])
    found = find_frame(mesh, np.array([0.0, 0, 1]))
    assert np.allclose(found.axes[:, 1], [0, 0, 1])
    assert degrees(found.axes, frame("z")) < 20


def mask(n=27):
    """A relief with nose, chin and eyes, which bulges towards z, up y; an open disk."""
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1.4, 1.4, n))
    bump = lambda at, up, size: np.exp(-((x - at) ** 2 + (y - up) ** 2) / size**2)
    z = 0.9 - 0.6 * x**2 - 0.25 * y**2 + 0.4 * bump(0, -0.1, 0.2)
    z -= 0.15 * (bump(-0.4, 0.3, 0.18) + bump(0.4, 0.3, 0.18))
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    faces = np.concatenate(
        [np.stack(q, -1).reshape(-1, 3) for q in ((a, b, c), (a, c, d))]
    )
    inside = (x / 1) ** 2 + ((y + 0.1 * (1 - x**2)) / 1.3) ** 2 < 1
    faces = faces[inside.ravel()[faces].all(1)]
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    return largest_component(Mesh(points, faces.astype(np.int32))).mesh


def mean_normal(mesh):
    total = face_normals(mesh.vertices, mesh.faces).sum(0)
    return total / np.linalg.norm(total)


def test_a_sheet_is_seen_along_its_mean_normal():
    face, way = mask(), TURNS["random"]
    mesh = turned(face, way)
    found = find_frame(mesh)
    assert found.sheet
    assert np.degrees(np.arccos(found.axes[:, 2] @ mean_normal(mesh))) < 5
    assert degrees(found.axes, way.as_matrix() @ find_frame(face).axes) < 5
    # Whichever way it is wound, from the side on which it bulges.
    other = find_frame(Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    assert degrees(other.axes, found.axes) < 5
    assert not find_frame(load("man_up").mesh).sheet
    known = find_frame(face, np.array([1.0, 1, 0]))
    assert known.axes[:, 2] @ mean_normal(face) > 0.99
    assert np.allclose(known.axes[:, 1] @ [1, 1, 0], np.sqrt(2), atol=0.02)


@pytest.mark.parametrize("turn", [0, 85])
def test_a_turn_of_a_sheet_about_its_normal_is_seen(turn):
    # A map that turns a round sheet: where a point of X comes to lie on Y.
    face = mask()
    centred = face.vertices - face.vertices.mean(0)
    way = Rotation.from_rotvec(np.radians(turn) * mean_normal(face))
    T = KDTree(centred[:, :2]).query(way.apply(centred)[:, :2])[1]
    one, two = find_frames(face, turned(face, TURNS["random"]), T)
    back = TURNS["random"].inv().apply(two.axes.T).T
    for axes in (one.axes, back):
        assert np.degrees(np.arccos(axes[:, 2] @ mean_normal(face))) < 5
    # Either the shapes are seen turned, or their colours are.
    seen = np.degrees(Rotation.from_matrix(back @ one.axes.T).magnitude())
    assert seen < 5 or abs(seen - turn) < 15


def test_shapes_that_tell_little_have_a_frame_all_the_same():
    cloud = load("man_up").mesh._replace(faces=np.zeros((0, 3), np.int32))
    cube = np.array(np.meshgrid(*3 * [[0.0, 1]])).reshape(3, -1).T
    flat = np.random.default_rng(0).random((50, 3)) * [1, 1, 0]
    none = np.zeros((0, 3), np.int32)
    with np.errstate(divide="raise", invalid="raise"):
        find_frame(cloud)
    for mesh in (cloud, Mesh(cube, none), Mesh(flat, none), Mesh(cube[:1], none)):
        axes = find_frame(mesh).axes
        assert np.allclose(axes.T @ axes, PLAIN) and np.linalg.det(axes) > 0


def test_a_second_piece_does_not_count():
    mesh = load("man_up").mesh
    piece = Mesh(mesh.vertices[:3] + 9, np.array([[0, 1, 2]], np.int32))
    both = Mesh(
        np.concatenate([mesh.vertices, piece.vertices]),
        np.concatenate([mesh.faces, piece.faces + len(mesh.vertices)]),
    )
    assert degrees(find_frame(both).axes, find_frame(mesh).axes) < 1e-3


def test_large_meshes_are_looked_at_coarsely():
    mesh = load("man_up").mesh
    coarse = coarsen(mesh, 2000).mesh
    assert degrees(find_frame(coarse).axes, find_frame(mesh).axes) < 15


@pytest.mark.parametrize("axis", ["x", "y", "z", "-x", "-y", "-z"])
def test_axes_by_name_are_rotations_with_that_axis_up(axis):
    axes = frame(axis)
    assert np.allclose(axes.T @ axes, PLAIN) and np.linalg.det(axes) > 0
    assert axes["xyz".index(axis[-1]), 1] == (-1 if axis[0] == "-" else 1)
