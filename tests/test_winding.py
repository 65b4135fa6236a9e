"""A few bad faces do not change the winding of the others; `unclear_winding`."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from jfsf import data, testing
from jfsf.mesh import check, orient, read, repair, surface_area, unclear_winding
from jfsf.mesh._geometry import face_areas
from jfsf.mesh._winding import MAX_UNCLEAR
from jfsf.types import Mesh

EXTERNAL = Path(os.environ.get("JFSF_DATA", "data")) / "external"
SHAPES = {
    "blob": testing.blob(3),
    "man": data.load("man_walk").mesh,
    "child": data.load("child_kick").mesh,
}


def added(mesh, faces, vertices=None):
    """With more faces, and vertices for them."""
    more = mesh.vertices[:0] if vertices is None else vertices
    faces = np.concatenate([mesh.faces, np.reshape(faces, (-1, 3))])
    return Mesh(np.concatenate([mesh.vertices, more]), faces.astype(np.int32))


def doubled(mesh, rng):
    return added(mesh, mesh.faces[rng.integers(len(mesh.faces))])


def back_to_back(mesh, rng):
    return added(mesh, mesh.faces[rng.integers(len(mesh.faces)), ::-1])


def flap(mesh, rng):
    """Two faces back to back that stand on an edge."""
    one, two = mesh.faces[rng.integers(len(mesh.faces)), :2]
    new = len(mesh.vertices)
    point = mesh.vertices[[one, two]].mean(0) + step(mesh) * rng.normal(size=3) / 2
    return added(mesh, [[one, two, new], [two, one, new]], point[None])


def fins(mesh, rng, number=1):
    """Single faces that stand on edges."""
    edges = mesh.faces[rng.choice(len(mesh.faces), number, replace=False), :2]
    points = mesh.vertices[edges].mean(1)
    points = points + step(mesh) * rng.normal(size=points.shape) / 2
    new = len(mesh.vertices) + np.arange(number)
    return added(mesh, np.column_stack([edges, new]), points)


def bridges(mesh, rng, number=1):
    """Faces between an edge and a vertex near it."""
    edges = mesh.faces[rng.choice(len(mesh.faces), number, replace=False), :2]
    near = KDTree(mesh.vertices).query(mesh.vertices[edges[:, 0]], k=10)[1]
    near = np.asarray(near)
    return added(mesh, np.column_stack([edges, near[:, -1]]))


def one_sided(mesh, rng):
    """Two faces lost, and a strip from one hole to the other that changes sides."""
    start = rng.integers(len(mesh.faces))
    centres = mesh.vertices[mesh.faces].mean(1)
    near = np.asarray(KDTree(centres).query(centres[start], k=24)[1])
    apart = [f for f in near if not np.isin(mesh.faces[f], mesh.faces[start]).any()]
    (a, b, _), (c, d, _) = mesh.faces[start], mesh.faces[apart[0]]
    kept = np.delete(mesh.faces, [start, apart[0]], axis=0)
    return added(Mesh(mesh.vertices, kept), [[b, a, c], [b, c, d]])


DAMAGES = {
    "doubled": doubled,
    "back to back": back_to_back,
    "flap": flap,
    "fin": fins,
    "bridge": bridges,
    "one-sided": one_sided,
}


def step(mesh):
    """The usual distance of neighbouring vertices."""
    return np.sqrt(surface_area(mesh) / len(mesh.faces))


def flipped(mesh, which):
    faces = np.where(which[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
    return Mesh(mesh.vertices, faces)


def sides(faces):
    """Each face from its lowest vertex on."""
    first = faces.argmin(axis=1)[:, None]
    return np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)


def wound_as(damaged, clean):
    """All faces of the clean mesh that are left are wound as there."""
    there = {tuple(face) for face in sides(clean.faces).tolist()}
    known = {tuple(sorted(face)) for face in there}
    wound = sides(orient(damaged).faces).tolist()
    # Of two faces with the same vertices one is the clean one.
    found = {tuple(face) for face in wound}
    return all(
        tuple(face) in there or tuple(np.array(face)[[0, 2, 1]]) in found & there
        for face in wound
        if tuple(sorted(face)) in known
    )


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", DAMAGES)
def test_a_bad_place_changes_no_other_face(shape, kind):
    clean = SHAPES[shape]
    rng = np.random.default_rng(0)
    damaged = DAMAGES[kind](clean, rng)
    assert not check(damaged).consistent or kind == "bridge" or kind == "one-sided"
    assert wound_as(damaged, clean)
    assert unclear_winding(damaged) < MAX_UNCLEAR
    mixed = flipped(damaged, rng.random(len(damaged.faces)) < 0.5)
    assert wound_as(mixed, clean)
    wound = orient(mixed)
    assert np.array_equal(orient(wound).faces, wound.faces)


@pytest.mark.parametrize("shape", ["man", "child"])
@pytest.mark.parametrize("kind", [fins, bridges])
def test_thirty_edges_with_three_faces_do_no_harm(shape, kind):
    clean = SHAPES[shape]
    damaged = kind(clean, np.random.default_rng(1), 30)
    assert (check(damaged).nonmanifold_edges or 0) >= 30
    assert wound_as(damaged, clean) and unclear_winding(damaged) < MAX_UNCLEAR


@pytest.mark.parametrize("shape", SHAPES)
def test_ten_faces_turned_over_are_turned_back(shape):
    clean = SHAPES[shape]
    some = np.zeros(len(clean.faces), bool)
    some[np.random.default_rng(0).choice(len(some), 10, replace=False)] = True
    assert np.array_equal(orient(flipped(clean, some)).faces, clean.faces)
    assert unclear_winding(flipped(clean, some)) == 0


@settings(max_examples=20)
@given(testing.seeds, st.lists(st.sampled_from(sorted(DAMAGES)), max_size=4))
def test_less_than_a_hundredth_of_the_area_decides_nothing(seed, kinds):
    rng = np.random.default_rng(seed)
    clean = SHAPES["man"]
    damaged = clean
    for kind in kinds:
        damaged = DAMAGES[kind](damaged, rng)
    known = {tuple(face) for face in np.sort(clean.faces, axis=1).tolist()}
    new = [tuple(face) not in known for face in np.sort(damaged.faces, 1).tolist()]
    if face_areas(*damaged)[new].sum() < 0.01 * surface_area(clean):
        mixed = flipped(damaged, rng.random(len(damaged.faces)) < 0.3)
        assert wound_as(mixed, clean)
        assert unclear_winding(mixed) < MAX_UNCLEAR


def test_the_share_is_the_same_before_and_after():
    damaged = fins(SHAPES["child"], np.random.default_rng(2), 30)
    share = unclear_winding(damaged)
    assert 0 < share < MAX_UNCLEAR
    assert unclear_winding(orient(damaged)) == share


def strip(width=0.25, number=100, one_sided=True):
    """A strip round a circle; with one side it turns by half a turn."""
    turn, across = np.meshgrid(np.arange(number), [-1, 0, 1], indexing="ij")
    angle, side = 2 * np.pi * turn.ravel() / number, across.ravel() * width
    lean = angle / 2 if one_sided else np.full(len(angle), np.pi / 2)
    radius = 1 + side * np.cos(lean)
    points = radius * np.cos(angle), radius * np.sin(angle), side * np.sin(lean)
    faces = []
    for i in range(number):
        for j in range(2):
            a, b = 3 * i + j, 3 * i + j + 1
            c, d = a + 3, b + 3
            if i == number - 1:
                c, d = (2 - j, 1 - j) if one_sided else (j, j + 1)
            faces += [[a, c, b], [b, c, d]]
    return Mesh(np.stack(points, 1), np.array(faces, np.int32))


def klein(n=60, k=30):
    """A Klein bottle, the figure of eight turned round a circle."""
    u, v = np.meshgrid(np.arange(n) / n, np.arange(k) / k, indexing="ij")
    u, v = 2 * np.pi * u, 2 * np.pi * v
    across = np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    up = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    points = np.stack([(2 + across) * np.cos(u), (2 + across) * np.sin(u), up], -1)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(k), indexing="ij"))
    at = lambda i, j: np.where(i == n, -j % k, i * k + j % k)
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(points.reshape(-1, 3), faces.astype(np.int32))


@pytest.mark.parametrize("mesh", [strip(), strip(0.4, 40), klein()])
def test_one_sided_surfaces_are_unclear(mesh):
    assert unclear_winding(mesh) > 2 * MAX_UNCLEAR
    for seed in range(3):
        some = np.random.default_rng(seed).random(len(mesh.faces)) < 0.5
        wound = orient(flipped(mesh, some))
        assert np.array_equal(orient(wound).faces, wound.faces)
        assert unclear_winding(wound) > 2 * MAX_UNCLEAR


def test_a_surface_needs_an_outside():
    grid = trimesh.creation.icosphere(subdivisions=4)
    ball = Mesh(np.asarray(grid.vertices), np.asarray(grid.faces, np.int32))
    cap = Mesh(ball.vertices, ball.faces[ball.vertices[ball.faces].mean(1)[:, 2] > 0.6])
    assert unclear_winding(ball) == unclear_winding(cap) == 0
    # A dome and a sheet; what decides is the height over the width.
    flat = Mesh(cap.vertices * [1, 1, 1e-3], cap.faces)
    assert unclear_winding(flat) == 1
    # The sign of its volume is an accident, so the file is believed.
    inside_out = [flipped(own, np.ones(len(cap.faces), bool)) for own in (cap, flat)]
    assert np.array_equal(orient(inside_out[0]).faces, cap.faces)
    for own in (flat, inside_out[1]):
        assert np.array_equal(orient(own).faces, own.faces)
    # Closed, a thin thing has an outside.
    assert unclear_winding(Mesh(ball.vertices * [1, 1, 1e-3], ball.faces)) == 0
    assert unclear_winding(strip(one_sided=False)) == 0
    pillow = Mesh(np.eye(3), np.array([[0, 1, 2], [2, 1, 0]], np.int32))
    assert unclear_winding(pillow) == 1
    assert unclear_winding(Mesh(ball.vertices, ball.faces[:0])) == 0


def test_all_faces_twice_are_one_surface():
    clean = SHAPES["blob"]
    for more in (clean.faces, clean.faces[:, ::-1]):
        twice = added(clean, more)
        assert unclear_winding(twice) == 0 and wound_as(twice, clean)
        found = repair(twice)
        assert np.array_equal(found.mesh.faces, clean.faces)


def test_a_piece_goes_by_the_faces_that_it_continues():
    """A wall in a ball: its halves meet only in edges with three faces."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    points, faces = np.asarray(ball.vertices), np.asarray(ball.faces, np.int32)
    rim = np.flatnonzero(np.abs(points[:, 2]) < 1e-9)
    order = rim[np.argsort(np.arctan2(points[rim, 1], points[rim, 0]))]
    wall = np.column_stack([order, np.roll(order, -1), 0 * order + len(points)])
    clean = Mesh(points, faces)
    if len(wall) < 3:
        pytest.skip("this ball has no equator")
    whole = added(clean, wall, np.zeros((1, 3)))
    upper = points[faces].mean(1)[:, 2] > 0
    mixed = flipped(whole, np.append(upper, np.zeros(len(wall), bool)))
    assert wound_as(mixed, clean)
    # The wall itself has no outside.
    share = np.pi / (np.pi + surface_area(clean))
    assert unclear_winding(mixed) == pytest.approx(share, rel=0.02)


FOLDERS = ("smal_whole", "psmal", "topkids_low", "becos_ff")


@pytest.mark.skipif(not EXTERNAL.is_dir(), reason="set JFSF_DATA to data not shipped")
@pytest.mark.parametrize("folder", FOLDERS)
def test_real_shapes_are_clear_and_no_repair_harms_them(folder):
    for path in sorted((EXTERNAL / folder / "off").glob("*.off"))[:8]:
        mesh = read(path)
        share, before = unclear_winding(mesh), check(mesh)
        assert share < MAX_UNCLEAR
        mended = repair(mesh).mesh
        after = check(mended)
        assert unclear_winding(mended) <= share
        for name in before._fields[2:9]:
            assert getattr(after, name) <= getattr(before, name), (path, name)
        assert repair(mended).done == ()
