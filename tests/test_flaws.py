"""Flaws of people's files: named by check and info, mended by repair, and said."""

import gzip

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_cli_repair import GOOD
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.cli._collection import _meshes_in
from jfsf.apps.cli._collection_jobs import keep, kept
from jfsf.apps.cli._files import matchable
from jfsf.apps.collections._cycles import Sketch
from jfsf.batch._jobs import Job
from jfsf.mesh import (
    MeshError,
    check,
    read,
    repair,
    rounding,
    validate,
    without_holes,
)
from jfsf.mesh._partners import map_of_originals, nearest_kept, without_nonfinite
from jfsf.types import Match, Mesh

BLOB = testing.blob(0)
N = len(BLOB.vertices)
NO_FACES = np.zeros((0, 3), np.int32)


def run(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def said(*args, code=0):
    result = run(*args)
    assert result.exit_code == code, result.output
    return " ".join(result.stdout.split())


def with_values(mesh, *values):
    """A mesh whose first vertices have these x."""
    vertices = mesh.vertices.copy()
    vertices[: len(values), 0] = values
    return Mesh(vertices, mesh.faces)


def write(path, mesh):
    """As any program: the values as they are."""
    lines = ["OFF", f"{len(mesh.vertices)} {len(mesh.faces)} 0"]
    lines += [" ".join(map(repr, row)) for row in mesh.vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


# Coordinates that are not finite.


@given(st.lists(st.sampled_from([np.nan, np.inf, -np.inf]), min_size=1, max_size=9))
def test_vertices_that_are_not_finite_go_with_their_faces(values):
    mesh, k = with_values(BLOB, *values), len(values)
    found = repair(mesh)
    lost = (BLOB.faces < k).any(1)
    number = f"{k} vert{'ices' if k > 1 else 'ex'} with coordinates that are not finite"
    assert found.done[0] == f"{number} removed, with {lost.sum()} faces"
    validate(found.mesh)
    assert (found.partner[:k] == -1).all()
    assert np.array_equal(found.partner[found.index], np.arange(len(found.index)))
    assert np.array_equal(mesh.vertices[found.index], found.mesh.vertices)
    # What has no place goes where a neighbour goes.
    T = nearest_kept(mesh, found)
    assert T.min() >= 0 and T.max() < len(found.index)
    around = [set(BLOB.faces[(BLOB.faces == v).any(1)].ravel()) for v in range(k)]
    for v in range(k):
        if any(w >= k for w in around[v]):
            assert found.index[T[v]] in around[v]


def test_the_rest_is_as_without_them():
    found = without_nonfinite(with_values(BLOB, np.nan))
    assert len(found.mesh.vertices) == N - 1 and check(found.mesh).boundary_edges
    same = without_nonfinite(BLOB)
    assert same.done == () and np.array_equal(same.mesh.faces, BLOB.faces)
    assert repair(with_values(BLOB, np.nan)).mesh.faces.shape == found.mesh.faces.shape
    cloud = Mesh(with_values(BLOB, np.nan, np.inf).vertices, NO_FACES)
    assert len(repair(cloud).mesh.vertices) == N - 2
    stray = Mesh(np.r_[BLOB.vertices, [[np.nan] * 3]], BLOB.faces)
    there = map_of_originals(np.arange(N), stray, repair(stray), repair(stray))
    assert there.shape == (N + 1,) and 0 <= there[-1] < N
    with pytest.raises(MeshError, match="all its faces have a vertex that is not"):
        repair(Mesh(with_values(BLOB, *[np.nan] * (N - 1)).vertices, BLOB.faces))
    with pytest.raises(MeshError, match="N?mesh: vertex 0 is .* not finite"):
        repair(Mesh(BLOB.vertices * np.nan, BLOB.faces))


def test_files_with_them_are_refused_named_and_mended(tmp_path):
    path = write(tmp_path / "scan.off", with_values(BLOB, np.nan, 0.1, np.inf))
    with pytest.raises(MeshError, match=r"2 of \d+ are not finite; .*jfsf.mesh.repair"):
        read(path)
    assert np.isnan(read(path, finite=False).vertices[0, 0])
    words = said("info", path, code=1)
    assert f"not finite: 2 of {N} vertices (0, 2), left out here; --repair" in words
    assert "cannot be matched" in words and "--repair would mend: 2 vertices" in words
    out = tmp_path / "mended.ply"
    assert "can be matched" in said("info", path, "--repair", out)
    assert len(read(out).vertices) == N - 2
    shape = matchable(path, False, mend=True)
    assert len(shape.mesh.vertices) == N - 2 and "not finite" in shape.said[0]
    with pytest.raises(MeshError, match="not finite"):
        matchable(path, False)


# Coordinates that are rounded, far from the origin.


def moved(mesh, to, kind, scale=1.0):
    vertices = mesh.vertices * scale + to
    if kind == "text":
        rounded = [[float(f"{x:.6g}") for x in row] for row in vertices.tolist()]
        return Mesh(np.array(rounded), mesh.faces)
    return Mesh(vertices.astype(kind).astype(float), mesh.faces)


@pytest.mark.parametrize(
    ("to", "kind", "scale"),
    [
        ([5.6e6, 5.6e6, 0], "f4", 1.0),
        ([0, 0, -5.6e6], "f4", 3.0),
        ([3.2e5, 5.6e6, 100], "f4", 2.0),
        ([5e3, 0, 0], "text", 0.1),
        ([1e-3, 0, 0], "f4", 1e-9),
    ],
)
@pytest.mark.parametrize("faces", [BLOB.faces, NO_FACES])
def test_coordinates_rounded_far_away_are_named(to, kind, scale, faces):
    mesh = moved(Mesh(BLOB.vertices, faces), to, kind, scale)
    found = rounding(mesh)
    assert found is not None and found.distance > 10 * scale
    assert "subtract the centre before the export" in str(found)
    report = check(mesh)
    assert report.coordinate_step == found.step / found.edge
    assert "far from the origin" in str(report)
    # The same shape in doubles, or in its place, has no such fault.
    assert rounding(moved(Mesh(BLOB.vertices, faces), to, "f8", scale)) is None
    assert rounding(moved(Mesh(BLOB.vertices, faces), 0, "f4", scale)) is None


def test_what_is_only_far_or_regular_is_not_named():
    assert check(BLOB).coordinate_step is None
    assert rounding(moved(BLOB, 1e3, "f4")) is None
    far = Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) + 100.0, BLOB.faces[:0])
    assert rounding(far) is None
    for scale in (1e-300, 1e300):
        assert rounding(Mesh((BLOB.vertices + 40) * scale, BLOB.faces)) is None
    same = Mesh(np.full((3, 3), 5.0), np.array([[0, 1, 2]]))
    assert rounding(same) is None


def test_a_shape_that_is_lost_by_rounding_is_refused(tmp_path):
    lost = moved(testing.blob(0, subdivisions=4), 5.6e6, "f4", 3.0)
    cause = r"rounded to 0.5, .* up to 5.6e\+06; subtract the centre"
    with pytest.raises(MeshError, match=f"^lost: .* no area, and .*{cause}"):
        validate(lost, name="lost")
    path = write(tmp_path / "lost.off", lost)
    words = said("info", path, code=1)
    assert "rounded: its coordinates are rounded to 0.5" in words
    assert "cannot be matched" in words and "subtract the centre" in words
    # Less than that is a matter of noise.
    fair = moved(BLOB, 5.6e6, "f4", 9.0)
    validate(fair)
    words = said("info", write(tmp_path / "fair.off", fair))
    assert "rounded: its coordinates" in words and "can be matched" in words


# Point clouds.


def test_points_of_a_cloud_that_coincide_are_named_and_merged(tmp_path):
    points = np.r_[BLOB.vertices, BLOB.vertices[:2]]
    np.savetxt(path := tmp_path / "scan.xyz", points)
    said_of = "--repair would mend: 2 duplicate vertices merged"
    assert said_of in said("info", path)
    assert matchable(path, False).said == (said_of,)
    found = repair(Mesh(points, NO_FACES))
    assert np.array_equal(found.mesh.vertices, BLOB.vertices)
    assert found.partner.tolist() == [*range(N), 0, 1]


# Separate pieces.


def with_pieces(mesh, *sizes):
    """A mesh with strips of these numbers of faces beside it."""
    for i, size in enumerate(sizes):
        n = len(mesh.vertices)
        j = np.arange(size + 2)
        strip = np.stack([3 + 0 * j, i + j % 2, j], axis=1) / 20.0 + [2, 0, 0]
        faces = np.stack([j[:-2], j[1:-1], j[2:]], axis=1) + n
        mesh = Mesh(np.r_[mesh.vertices, strip], np.r_[mesh.faces, faces])
    return mesh


def test_the_rim_of_a_piece_is_no_hole(tmp_path):
    words = said("info", write(tmp_path / "a.off", with_pieces(BLOB, 1)), code=1)
    assert "separate pieces: 1 beside the largest, of 1 face, 0.0" in words
    assert "holes" not in words
    for sizes, expected in (
        ((1, 1, 1), "3 beside the largest, of 1 face each,"),
        ((2, 5), "2 beside the largest, of 2 to 5 faces, "),
        ((7,), "1 beside the largest, of 7 faces, "),
    ):
        mesh = with_pieces(BLOB, *sizes)
        assert len(without_holes(mesh).faces) == len(mesh.faces)
        words = said("info", write(tmp_path / "a.off", mesh), code=1)
        assert f"separate pieces: {expected}" in words and "holes" not in words
    # A hole of the shape itself is closed as before.
    holed = Mesh(BLOB.vertices, np.delete(BLOB.faces, 5, axis=0))
    mesh = with_pieces(holed, 1)
    assert len(without_holes(mesh).faces) == len(mesh.faces) + 1
    assert "separate pieces" not in said("info", write(tmp_path / "a.off", BLOB))


def test_what_the_largest_component_leaves_out_is_said(tmp_path):
    path = write(tmp_path / "a.off", with_pieces(BLOB, 2, 5))
    mesh = read(path)
    mesh = Mesh(np.r_[mesh.vertices, [[9.0, 9, 9]]], mesh.faces)
    share = 1 - check(BLOB).area / check(mesh).area
    words = f"2 other pieces with 12 vertices and {share:.2%} of the area"
    shape = matchable(write(path, mesh), True)
    assert shape.said == (f"--largest-component leaves out {words}",)
    one = write(tmp_path / "b.off", with_pieces(BLOB, 1))
    assert (
        "leaves out 1 other piece with 3 vertices and" in matchable(one, True).said[0]
    )
    lone = write(tmp_path / "c.off", Mesh(mesh.vertices[[*range(N), -1]], BLOB.faces))
    assert "leaves out 1 vertices without" in matchable(lone, True).said[0]
    assert matchable(write(tmp_path / "d.off", BLOB), True).said == ()
    mended = matchable(path, True, mend=True).said
    assert "2 small components removed" in mended[0] and "11 vertices" in mended[0]


def test_match_says_what_it_leaves_out_and_passes_over(tmp_path, monkeypatch):
    path = write(tmp_path / "a.off", with_pieces(BLOB, 1))
    packed = tmp_path / "b.off.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    same = np.arange(N)
    found = Match(same, same, jnp.eye(3), GOOD)
    monkeypatch.setattr("jfsf.matching.match", lambda x, y, **options: found)
    words = said(
        *("match", path, packed, "--largest-component"),
        *("--out", tmp_path / "map.npz"),
    )
    for file in (path, packed):
        left_out = "--largest-component leaves out 1 other piece with 3 vertices and"
        assert f"{file}: {left_out}" in words


def test_a_collection_remembers_what_was_said(tmp_path, monkeypatch):
    path = write(tmp_path / "a.off", with_pieces(BLOB, 1))
    numbers = Sketch(*[np.zeros(2)] * len(Sketch._fields))
    monkeypatch.setattr("jfsf.matching.basis", lambda mesh, name: mesh)
    monkeypatch.setattr(
        "jfsf.apps.collections._cycles.sketch", lambda spectrum: numbers
    )
    monkeypatch.setattr(
        "jfsf.apps.collections._collection.check_surface", lambda mesh, name: None
    )
    for largest, mend in ((True, False), (False, True)):
        keep(Job((path,), tmp_path / "a.npz"), largest, mend)
        own = kept(tmp_path / "a.npz")
        assert len(own.said) == 1 and "3 vertices" in own.said[0]
        assert len(own.mesh.vertices) == N


def test_a_folder_of_a_collection_may_hold_other_files(tmp_path):
    for name in ("a.ply", "b.off.gz", "c.xyz", "d.npy", "e.txt", "f.txt.gz"):
        (tmp_path / name).write_bytes(b"")
    assert list(_meshes_in(tmp_path)) == ["a", "b"]
    (tmp_path / "b.OBJ").write_bytes(b"")
    with pytest.raises(ValueError, match="has the name of .*; rename one"):
        _meshes_in(tmp_path)
