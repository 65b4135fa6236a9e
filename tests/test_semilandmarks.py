"""Semilandmarks: geodesics against those of plane, cylinder and sphere, and patches."""

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay, KDTree

from jfsf.apps.landmarks import Landmarks
from jfsf.apps.landmarks._outlines import Outline, appended, read_outlines
from jfsf.apps.landmarks._place import nearest
from jfsf.apps.landmarks._programs import markups_text
from jfsf.apps.landmarks._semilandmarks import semilandmarks
from jfsf.types import Mesh


def sheet(n=20, seed=0):
    """The unit square in a random triangulation."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, n)]), -1).reshape(-1, 2)
    inner = ((grid > 0) & (grid < 1)).all(1)
    rng = np.random.default_rng(seed)
    grid[inner] += rng.uniform(-0.3, 0.3, (inner.sum(), 2)) / n
    return Mesh(np.pad(grid, [(0, 0), (0, 1)]), Delaunay(grid).simplices)


def ball(subdivisions=3):
    made = trimesh.creation.icosphere(subdivisions)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


SHEET = sheet()
EDGE = 1 / 19


def on(mesh, *points):
    return np.asarray(nearest(mesh, np.array(points, float)).points)


@pytest.mark.parametrize("seed", range(3))
def test_a_curve_on_a_plane_is_straight_and_equally_spaced(seed):
    ends = np.random.default_rng(seed).uniform(0.05, 0.95, (2, 3)) * [1, 1, 0]
    found = semilandmarks(SHEET, ends, [Outline("c", "curve", 7, (0, 1))])
    true = ends[0] + np.linspace(0, 1, 9)[1:-1, None] * (ends[1] - ends[0])
    assert np.linalg.norm(found.points - true, axis=1).max() < 0.02 * EDGE
    assert found.names == tuple(f"c_{i}" for i in range(1, 8))
    assert found.slide[0].tolist() == [0, 2, 3] and found.slide[-1, 2] == 1
    assert (found.slide[:, 1] == np.arange(2, 9)).all() and not len(found.surface)


def test_a_curve_on_a_cylinder_is_straight_when_that_is_unrolled():
    sides = 24
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn)], 1)
    heights = np.linspace(0, 3, 13)
    vertices = np.concatenate([np.insert(ring, 2, h, axis=1) for h in heights])
    at = np.arange(sides * 12).reshape(12, sides)
    along = np.roll(at, -1, 1)
    faces = np.stack([at, along, along + sides, at, along + sides, at + sides], -1)
    mesh = Mesh(vertices, faces.reshape(-1, 3))
    ends = sides * 1 + 2, sides * 10 + 11  # nine sides further, nine rows up
    found = semilandmarks(
        mesh, vertices[list(ends)], [Outline("c", "curve", 8, (0, 1))]
    )
    # The faces of the prism, laid flat: each ninth part of the way is a side wide.
    true = np.insert(ring[3:11], 2, heights[1] + 0.25 * np.arange(1, 9), axis=1)
    np.testing.assert_allclose(found.points, true, atol=1e-9)


def test_a_curve_on_a_sphere_is_a_great_circle():
    mesh, edge = ball(), 0.15
    ends = on(mesh, [1, 0.1, 0.2], [0.1, 1, 0.3])
    found = semilandmarks(mesh, ends, [Outline("c", "curve", 9, (0, 1))])
    a, b = ends / np.linalg.norm(ends, axis=1, keepdims=True)
    angle, share = np.arccos(a @ b), np.linspace(0, 1, 11)[1:-1, None]
    true = np.sin((1 - share) * angle) * a + np.sin(share * angle) * b
    unit = found.points / np.linalg.norm(found.points, axis=1, keepdims=True)
    # Faces are chords, of which the length differs by up to edge^2 / 8.
    away = np.linalg.norm(unit - true / np.sin(angle), axis=1)
    assert away.max() < edge**2 / 8


def test_landmarks_on_a_curve_stay_and_gaps_are_even():
    marks = np.array([[0.1, 0.1, 0], [0.3, 0.1, 0], [0.9, 0.1, 0]])
    found = semilandmarks(SHEET, marks, [Outline("c", "curve", 6, (0, 1, 2))])
    # One on the first third, five on the rest: gaps of 0.1 everywhere.
    x = np.append(marks, found.points, axis=0)[:, 0]
    np.testing.assert_allclose(np.diff(np.sort(x)), 0.1, atol=0.02 * EDGE)
    order = np.argsort(x)
    chain = {tuple(three) for three in zip(order, order[1:], order[2:], strict=False)}
    assert set(map(tuple, found.slide.tolist())) == {c for c in chain if c[1] > 2}


RIM = np.array([[0.15, 0.2], [0.8, 0.15], [0.6, 0.85]])


@pytest.mark.parametrize("number", [1, 12, 60])
def test_points_of_a_patch_lie_within_the_rim_and_are_spread(number):
    marks = np.insert(RIM, 2, 0, axis=1)
    found = semilandmarks(SHEET, marks, [Outline("p", "patch", number, (0, 1, 2))])
    points = found.points[:, :2]
    assert (found.surface == np.arange(3, 3 + number)).all() and not len(found.slide)
    sides = np.roll(RIM, -1, 0) - RIM
    normal = np.stack([-sides[:, 1], sides[:, 0]], 1)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    from_rim = np.einsum("pri,ri->pr", points[:, None] - RIM, normal).min(1)
    assert from_rim.min() > 0
    # As farthest points: no point of the patch is farther from all of them and the rim
    # than they are from each other, but for the lengths of ways along edges.
    weight = np.random.default_rng(0).dirichlet(np.ones(3), 2000)
    inside = weight @ RIM
    away = KDTree(points).query(inside)[0]
    rim = np.einsum("pri,ri->pr", inside[:, None] - RIM, normal).min(1)
    near = np.append(from_rim, KDTree(points).query(points, 2)[0][:, 1])
    assert 1.15 * near.min() > np.minimum(away, rim).max()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_a_patch_is_the_smaller_side_of_its_rim(order):
    mesh = ball()
    marks = on(mesh, [1, 0.1, 0.1], [0.1, 1, 0.1], [0.1, 0.1, 1])
    found = semilandmarks(mesh, marks, [Outline("p", "patch", 30, order)])
    assert (found.points @ np.ones(3)).min() > 0.9 and len(found.points) == 30


def test_rims_that_surround_nothing_and_meshes_that_are_no_surface_are_named():
    ring = trimesh.creation.torus(1, 0.3, 24, 12)
    ring = Mesh(np.asarray(ring.vertices), np.asarray(ring.faces))
    marks = on(ring, [1.3, 0, 0], [-0.65, 1.1, 0], [-0.65, -1.1, 0])
    with pytest.raises(ValueError, match="rim surrounds no part of the surface"):
        semilandmarks(ring, marks, [Outline("p", "patch", 3, (0, 1, 2))])
    flipped = SHEET.faces.copy()
    flipped[5] = flipped[5, ::-1]
    with pytest.raises(ValueError, match="add --repair"):
        curve = Outline("c", "curve", 3, (0, 1))
        semilandmarks(SHEET._replace(faces=flipped), SHEET.vertices[:2], [curve])


def slicer(path, points, kind):
    names = tuple(f"C-{i}" for i in range(1, len(points) + 1))
    tree = json.loads(markups_text(Landmarks(names, np.array(points, float))))
    tree["markups"][0]["type"] = kind
    path.write_text(json.dumps(tree))
    return path


def test_a_curve_of_slicer_is_projected_and_spaced_anew(tmp_path):
    points = [[0.1, 0.5, 0.02], [0.2, 0.5, 0], [0.7, 0.5, -0.01], [0.9, 0.5, 0]]
    path = slicer(tmp_path / "crest.mrk.json", points, "Curve")
    (one,) = read_outlines([path], ("a",))
    assert (one.name, one.kind, one.number) == ("crest", "curve", 2)
    # The second end is the landmark near it; the first is a point that does not slide.
    found = semilandmarks(SHEET, [[0.9, 0.501, 0]], [one])
    true = [[0.1 + 0.8 * i / 3, 0.5, 0] for i in range(3)]
    np.testing.assert_allclose(found.points, true, atol=2e-3)
    assert found.slide.tolist() == [[1, 2, 3], [2, 3, 0]]
    # A table gives it more points.
    (table := tmp_path / "more.csv").write_text("curve,crest,7\n")
    (one,) = read_outlines([table, path], ("a",))
    found = semilandmarks(SHEET, np.zeros((0, 3)), [one])
    np.testing.assert_allclose(found.points[:, 0], np.linspace(0.1, 0.9, 9), atol=2e-3)
    assert found.slide[[0, -1]].tolist() == [[0, 1, 2], [6, 7, 8]]


def test_a_closed_curve_of_slicer_goes_round(tmp_path):
    square = [[0.2, 0.2, 0], [0.8, 0.2, 0], [0.8, 0.8, 0], [0.2, 0.8, 0]]
    path = slicer(tmp_path / "rim.mrk.json", square, "ClosedCurve")
    (tmp_path / "n.csv").write_text("# of Slicer\ncurve,rim,8,,\n")
    (one,) = read_outlines([path, tmp_path / "n.csv"], ())
    found = semilandmarks(SHEET, [[0, 0, 0]], [one])
    middles = (np.array(square) + np.roll(square, -1, 0)) / 2
    true = np.stack([square, middles], 1).reshape(-1, 3)
    np.testing.assert_allclose(found.points, true, atol=0.02 * EDGE)
    assert found.slide[[0, -1]].tolist() == [[8, 1, 2], [7, 8, 1]]
    # A landmark at its third point stays there, and nothing slides onto it.
    (one,) = read_outlines([path], ())
    found = semilandmarks(SHEET, [[0.801, 0.8, 0]], [one._replace(number=3)])
    corners = np.array(square)[[3, 0, 1]]
    np.testing.assert_allclose(found.points, corners, atol=2e-3)
    assert found.slide.tolist() == [[0, 1, 2], [1, 2, 3], [2, 3, 0]]


def test_a_table_names_landmarks_or_counts_them(tmp_path):
    (path := tmp_path / "t.csv").write_text('patch,p,4,1,"b, c",3\ncurve,c,2,a,3\n')
    curve, patch = read_outlines([path], ("a", "b, c", ""))
    assert curve == Outline("c", "curve", 2, (0, 2))
    assert patch == Outline("p", "patch", 4, (0, 1, 2))


@pytest.mark.parametrize(
    "line, words",
    [
        ("curve,c,2,a,x", "line 1: 'x' is no landmark"),
        ("curve,c,2,a,6", "there are 5"),
        ("curve,c,2,a,,b", "'' is no landmark"),
        ("curve,c,2,a,d", "several have this name"),
        ("curve,c,2,a", "has 1 landmarks"),
        ("patch,c,2,a,b,a", "has 2 landmarks"),
        ("curve,c,2,a,a,b", "follows on itself"),
        ("curve,c,0,a,b", "a line is curve,NAME"),
        ("line,c,2,a,b", "a line is curve,NAME"),
        ("curve,c,2", "no curve of Slicer is named 'c'"),
        ("curve,c,2,a,b\ncurve,c,2,a,b", "is there twice"),
        ("", "holds no curve and no patch"),
    ],
)
def test_what_a_table_cannot_say_is_named(tmp_path, line, words):
    (path := tmp_path / "t.csv").write_text(line)
    with pytest.raises(ValueError, match=words) as error:
        read_outlines([path], ("a", "b", "d", "d", ""))
    assert str(path) in str(error.value)


def test_curves_that_cannot_be_slid_are_named(tmp_path):
    points = [[0.1, 0.5, 0], [0.2, 0.5, 0]]
    for kind, words in (("Fiducial", "save one Curve"), ("ClosedCurve", "place 3")):
        with pytest.raises(ValueError, match=words):
            read_outlines([slicer(tmp_path / "a.mrk.json", points, kind)], ())
    with pytest.raises(ValueError, match="unknown format of semilandmarks"):
        read_outlines([tmp_path / "a.ply"], ())
    ring = [[0.5, 0.5, 0], [0.6, 0.6, 0], [0.5, 0.6, 0]]
    (tmp_path / "two.csv").write_text("curve,ring,2\n")
    path = slicer(tmp_path / "ring.mrk.json", ring, "ClosedCurve")
    with pytest.raises(ValueError, match="of 2 points"):
        read_outlines([path, tmp_path / "two.csv"], ())
    with pytest.raises(ValueError, match="'ring_1', as a semilandmark"):
        appended(Landmarks(("ring_1",), np.zeros((1, 3))), ["ring_1"], np.zeros((1, 3)))
