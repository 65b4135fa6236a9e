"""Meshes mended on request: what is wrong goes, the shape and all numbers stay."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.mesh import MeshError, check, orient, repair, surface_area, validate
from jfsf.mesh._denoise import spikes
from jfsf.mesh._partners import map_of_originals
from jfsf.types import Mesh

BLOB = testing.blob(3)
N, M = len(BLOB.vertices), len(BLOB.faces)


def with_seam(mesh):
    """Each face of the upper half has corners of its own there."""
    vertices, faces = mesh
    upper = vertices[faces].mean(1)[:, 2] > 0
    copies = faces[upper].ravel()
    new = faces.copy()
    new[upper] = len(vertices) + np.arange(len(copies)).reshape(-1, 3)
    return Mesh(np.concatenate([vertices, vertices[copies]]), new)


def with_spikes(mesh, rng):
    """On opposite sides, long beside the edges of this coarse shape."""
    vertices = mesh.vertices.copy()
    one = rng.integers(len(vertices))
    other = np.linalg.norm(vertices - vertices[one], axis=1).argmax()
    vertices[[one, other]] += 12 * rng.choice([-1, 1], (2, 3))
    return Mesh(vertices, mesh.faces)


def with_flakes(mesh):
    """Two small triangles beside the shape."""
    flake = np.array([[9.0, 9, 9], [9.1, 9, 9], [9, 9.1, 9]])
    vertices = np.concatenate([flake, mesh.vertices, flake + 5])
    last = len(mesh.vertices) + 3 + np.arange(3)
    faces = np.concatenate([[[0, 1, 2]], mesh.faces + 3, [last]])
    return Mesh(vertices, faces.astype(np.int32))


def with_strays(mesh):
    return Mesh(np.concatenate([mesh.vertices, [[7.0, 0, 0], [8.0, 0, 0]]]), mesh.faces)


def with_repeats(mesh):
    """Faces twice, once turned over, and one that is a vertex and an edge."""
    extra = np.array([mesh.faces[0], mesh.faces[5, ::-1], [4, 4, 9]], np.int32)
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, extra]))


def turned(mesh, rng):
    some = rng.random(len(mesh.faces)) < 0.4
    return Mesh(mesh.vertices, np.where(some[:, None], mesh.faces[:, ::-1], mesh.faces))


def with_middle(mesh, face=11, side=1):
    """A vertex in the middle of a side that one of its two faces does not use."""
    a, b, c = np.roll(mesh.faces[face], -side)
    middle = (mesh.vertices[a] + mesh.vertices[b]) / 2
    new = len(mesh.vertices)
    faces = np.concatenate(
        [np.delete(mesh.faces, face, 0), [[a, new, c], [new, b, c], [a, b, new]]]
    )
    return Mesh(np.concatenate([mesh.vertices, [middle]]), faces.astype(np.int32))


DAMAGES = {
    "seam": (with_seam, "duplicate vertices merged"),
    "flakes": (with_flakes, "2 small components removed"),
    "strays": (with_strays, "2 vertices without a face removed"),
    "repeats": (with_repeats, "2 duplicate faces removed"),
    "middle": (with_middle, "1 face without area mended"),
}


def frozen(mesh):
    for array in mesh:
        array.flags.writeable = False
    return mesh


def consistent(mesh, found):
    """Both index maps fit each other and the meshes, and the repair is finished."""
    index, partner = found.index, found.partner
    assert index.dtype == partner.dtype == np.int32
    assert len(index) == len(found.mesh.vertices)
    assert len(partner) == len(mesh.vertices)
    assert (np.diff(index) > 0).all()
    assert np.array_equal(partner[index], np.arange(len(index)))
    assert partner.min() >= -1 and partner.max() == len(index) - 1
    again = repair(found.mesh)
    assert again.done == ()
    assert all(
        np.array_equal(*pair) for pair in zip(again.mesh, found.mesh, strict=True)
    )


def test_a_clean_mesh_stays():
    found = repair(frozen(BLOB))
    assert found.done == ()
    assert all(np.array_equal(*pair) for pair in zip(found.mesh, BLOB, strict=True))
    assert np.array_equal(found.index, np.arange(N))
    assert np.array_equal(found.partner, np.arange(N))


@pytest.mark.parametrize("kind", DAMAGES)
def test_damage_is_named_and_mended(kind):
    damage, words = DAMAGES[kind]
    mesh = frozen(damage(BLOB))
    found = repair(mesh)
    assert any(words in line for line in found.done), found.done
    consistent(mesh, found)
    validate(found.mesh)
    report = check(found.mesh)
    assert report.closed and report.consistent and report.outward
    assert not report.degenerate_faces and not report.duplicate_faces
    assert np.isclose(surface_area(found.mesh), surface_area(BLOB), rtol=1e-12)
    # Vertices that are left did not move.
    assert np.array_equal(mesh.vertices[found.index], found.mesh.vertices)


@given(testing.seeds, st.permutations(["seam", "flakes", "strays", "repeats"]))
def test_all_damage_at_once(seed, order):
    rng = np.random.default_rng(seed)
    mesh = turned(BLOB, rng)
    for kind in order:
        mesh = DAMAGES[kind][0](mesh)
    mesh = frozen(mesh)
    before = [array.copy() for array in mesh]
    found = repair(mesh)
    assert all(np.array_equal(*pair) for pair in zip(before, mesh, strict=True))
    consistent(mesh, found)
    validate(found.mesh)
    assert len(found.mesh.vertices) == N and len(found.mesh.faces) == M
    assert check(found.mesh).outward
    # Coordinates of merged vertices are those of their partners.
    left = found.partner >= 0
    where = found.mesh.vertices[found.partner[left]]
    assert np.array_equal(mesh.vertices[left], where)


@given(testing.seeds)
def test_spikes_are_flattened_where_they_are(seed):
    mesh = with_spikes(BLOB, np.random.default_rng(seed))
    found = repair(frozen(mesh))
    assert "moved from spikes" in found.done[0]
    assert not spikes(found.mesh).any()
    away = np.linalg.norm(found.mesh.vertices - BLOB.vertices, axis=1)
    assert away.max() < 0.5 and (away > 0).sum() <= 2


def test_winding_is_the_work_of_orient():
    mesh = turned(BLOB, np.random.default_rng(0))
    found = repair(mesh)
    assert "faces turned over" in found.done[0]
    assert np.array_equal(found.mesh.faces, orient(mesh).faces)


def test_large_components_are_kept_unless_asked():
    two = Mesh(
        np.concatenate([BLOB.vertices, 0.6 * BLOB.vertices + 9]),
        np.concatenate([BLOB.faces, BLOB.faces + N]),
    )
    assert repair(two).done == ()
    found = repair(two, small=np.inf)
    assert found.done == (
        f"1 small component removed, 26.47% of the area and {N} vertices",
    )
    assert np.array_equal(found.partner, np.r_[np.arange(N), np.full(N, -1)])


def test_a_cloud_loses_its_duplicates():
    points = np.concatenate([BLOB.vertices, BLOB.vertices[3:5]])
    found = repair(Mesh(points, BLOB.faces[:0]))
    assert found.done == ("2 duplicate vertices merged",)
    assert np.array_equal(found.mesh.vertices, BLOB.vertices)
    assert found.partner[-2:].tolist() == [3, 4]


def test_what_cannot_be_mended_is_refused():
    for mesh, words in (
        (Mesh(BLOB.vertices, np.full((2, 3), 5, np.int32)), "has an area"),
        (Mesh(BLOB.vertices * np.nan, BLOB.faces), "not finite"),
        (Mesh(BLOB.vertices, BLOB.faces + 1), "counted from 0"),
    ):
        with pytest.raises(MeshError, match=words):
            repair(mesh, name="scan.ply")


@given(testing.seeds)
def test_maps_go_back_to_the_original_vertices(seed):
    rng = np.random.default_rng(seed)
    x, y = with_flakes(with_seam(BLOB)), with_strays(with_seam(BLOB))
    x_, y_ = repair(x), repair(y)
    T = rng.integers(0, len(y_.index), len(x_.index))
    whole = map_of_originals(T, x, x_, y_)
    assert whole.shape == (len(x.vertices),) and whole.dtype == np.int32
    assert np.array_equal(y_.partner[whole[x_.index]], T)
    # Copies go where their partners go; flakes where the nearest vertex goes.
    for vertex in range(len(x.vertices)):
        away = np.linalg.norm(x.vertices[x_.index] - x.vertices[vertex], axis=1)
        assert whole[vertex] == y_.index[T[away.argmin()]]


def test_the_identity_comes_back():
    mesh = with_seam(BLOB)
    found = repair(mesh)
    whole = map_of_originals(np.arange(len(found.index)), mesh, found, found)
    assert np.array_equal(mesh.vertices[whole], mesh.vertices)


def with_flap(mesh):
    """Two faces back to back on an edge, and a copy of a face elsewhere."""
    a, b, _ = mesh.faces[7]
    new = len(mesh.vertices)
    point = mesh.vertices[[a, b]].mean(0) * 1.1
    faces = np.array([[a, b, new], [b, a, new], mesh.faces[20]], np.int32)
    vertices = np.concatenate([mesh.vertices, [point]])
    return Mesh(vertices, np.concatenate([mesh.faces, faces]))


def test_both_faces_of_a_flap_go():
    mesh = frozen(with_flap(BLOB))
    found = repair(mesh)
    assert found.done == (
        "1 duplicate face removed",
        "2 faces back to back removed",
        "1 vertex without a face removed",
    )
    consistent(mesh, found)
    assert np.array_equal(found.mesh.faces, BLOB.faces)


def test_surfaces_that_only_touch_stay_apart():
    # Two balls that have an edge in the same place, and one that has a vertex there.
    edge = BLOB.faces[0, :2]
    one, two = BLOB.vertices[edge]
    away = 2 * one - BLOB.vertices
    axis = (two - one) / np.linalg.norm(two - one)
    out = BLOB.vertices - one
    turned_round = one + 2 * (out @ axis)[:, None] * axis - out
    turned_round[edge] = one, two
    for other, wound in ((away, BLOB.faces[:, ::-1]), (turned_round, BLOB.faces)):
        other = other.copy()
        other[edge[0]] = one
        faces = np.concatenate([BLOB.faces, wound + N])
        both = Mesh(np.concatenate([BLOB.vertices, other]), faces)
        found = repair(both)
        assert found.done == ()
        report = check(found.mesh)
        assert report.closed and report.components == 2 and report.outward
