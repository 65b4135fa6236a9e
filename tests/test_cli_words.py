"""What the command line says: options and units, what was left out, no nan."""

import io
import json
import pickle

import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import jfsf
from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.cli._batch_jobs import work
from jfsf.apps.cli._print import print_any_letter, said
from jfsf.apps.export import export_mesh
from jfsf.apps.mapfiles import (
    MapFileError,
    read_match,
    read_notes,
    write_map,
    write_match,
)
from jfsf.apps.mapfiles._formats import FROM_0
from jfsf.apps.report._words import attempts, readings
from jfsf.batch._jobs import Job
from jfsf.batch._pair_list import PairOptions
from jfsf.evaluate import evaluate, geodesic_error
from jfsf.geometry._geodesics import NOT_EXACT
from jfsf.matching import _partial
from jfsf.matching._arguments import check_one_unit, doubtful_units
from jfsf.mesh._check import ONE_COMPONENT
from jfsf.mesh._values import LEAVE_OUT, InputError, MeshError
from jfsf.types import STAGES, Certificate, Maps, Match, MatchInfo, Mesh

X = testing.blob(0)
Y = Mesh(testing.blob(1).vertices, X.faces)
N = len(X.vertices)
GOOD = Certificate(*(jnp.asarray(0.9) for _ in Certificate._fields))
GOOD = GOOD._replace(
    finite=jnp.asarray(True),
    empty=jnp.asarray(0),
    landmarks=jnp.zeros(0),
    region_cost=jnp.asarray(jnp.nan),
)


def run(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def words(text):
    return " ".join(text.split())


@pytest.fixture
def folder(tmp_path):
    export_mesh(tmp_path / "x.ply", X)
    export_mesh(tmp_path / "y.ply", Y)
    return tmp_path


@pytest.mark.parametrize(
    "error, words",
    [
        (
            MapFileError("holds a 0", FROM_0, "a.map"),
            "a.map: holds a 0; pass --base 0",
        ),
        (MeshError("has no faces", "triangulate it", "mesh_x"), "X: has no faces; tri"),
        (MeshError("is small", name="part of mesh_y"), "part of Y: is small"),
        (
            MeshError("has 2", ONE_COMPONENT, "/a/mesh_x.ply"),
            "/a/mesh_x.ply: has 2; keep one with match --largest-component, match all "
            "with match --components, or join seams of coincident vertices with match "
            "--repair",
        ),
        (MeshError("has nan", LEAVE_OUT), "has nan; leave them out with --repair"),
        (
            InputError("needs a manifold", NOT_EXACT, "geodesics"),
            "geodesics: needs a manifold; leave out --exact",
        ),
        (MeshError("is\nempty", name="weld.ply"), "weld.ply: is empty"),
        (ValueError("made with {'largest_component': True}"),) * 2,
    ],
)
def test_messages_name_options(error, words):
    assert said(error).startswith(str(words))


@pytest.mark.parametrize("kind", [InputError, MeshError, MapFileError])
def test_errors_reach_other_processes_with_their_fields(kind):
    error = kind("is empty", "export it again", "a.ply")
    assert str(error) == "a.ply: is empty; export it again"
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is kind and vars(found) == vars(error)
    assert str(found.named("b.ply")) == "b.ply: is empty; export it again"
    assert str(kind("a.ply: is empty")) == "a.ply: is empty"


def test_names_in_letters_that_a_terminal_lacks_do_not_end_a_command(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", stream)
    monkeypatch.setattr("sys.stderr", io.StringIO())  # which has no encoding
    print_any_letter()
    Console(file=stream).print("wrote 鼻尖.npz")
    stream.flush()
    assert stream.buffer.getvalue().startswith(b"wrote \\u9f3b\\u5c16.npz")  # type: ignore


def test_unknown_figures_have_words():
    names = "gap", "share", "recall", "residual", "log_odds", "energy", "orientation"
    nan = jnp.asarray(np.nan)
    found = readings(GOOD._replace(**dict.fromkeys(names, nan)))
    assert found["gap"] == ("no rival", "no second candidate was compared")
    assert found["share"][0] == "not compared"
    assert all("nan" not in text for text, _ in found.values())
    assert all(reading for _, reading in found.values())
    assert readings(GOOD._replace(gap=jnp.asarray(np.inf)))["gap"][0] == "no rival"
    none = np.full(len(STAGES), np.nan)
    tried = MatchInfo(np.array([1, 3]), np.array([np.nan, 0.8]), np.array(1), none)
    assert "search unknown, coarse copies 0.80" in attempts(tried)


def test_a_text_map_of_the_other_base_is_refused_with_the_option(folder):
    write_map(folder / "zero.map", np.arange(N, dtype=np.int32), base=0)
    meshes = folder / "x.ply", folder / "y.ply"
    result = run("evaluate", *meshes, folder / "zero.map")
    assert result.exit_code == 1 and "pass --base 0" in words(result.stderr)
    assert run("evaluate", *meshes, folder / "zero.map", "--base", 0).exit_code == 0
    out = "--out", folder / "r.ply", "--map", folder / "zero.map"
    assert "pass --base 0" in words(run("register", *meshes, *out).stderr)


def test_landmarks_that_the_mesh_lacks_are_refused_with_their_file(folder):
    (pairs := folder / "pairs.txt").write_text(f"3,4\n0,{N}\n")
    args = "match", folder / "x.ply", folder / "y.ply", "--out", folder / "m.npz"
    result = run(*args, "--landmarks", pairs)
    assert result.exit_code == 1
    assert f"{pairs}: landmark 2 names vertex {N} of Y, which has vertices 0 to" in (
        words(result.stderr)
    )


# Units of parts.


def half(mesh):
    kept = mesh.vertices[:, 2] > 0
    faces = mesh.faces[kept[mesh.faces].all(1)]
    return jfsf.mesh.largest_component(Mesh(mesh.vertices, faces)).mesh


@pytest.mark.parametrize(
    "factor, fine, coarse",
    [
        (1000.0, "millimetres", "metres"),
        (25.4, "millimetres", "inches"),
        (100.0, "centimetres", "metres"),
    ],
)
def test_parts_in_two_units_are_refused(folder, factor, fine, coarse):
    part = half(X)
    large = Y._replace(vertices=Y.vertices * factor)
    with pytest.raises(ValueError) as caught:
        check_one_unit(part, large)
    said = str(caught.value)
    assert f"If mesh_y is in {fine}, and mesh_x in {coarse}, multiply" in said
    assert said.endswith(f"mesh_x by {factor:g}, or give same_unit=False")
    check_one_unit(part, Y)
    assert not doubtful_units(part, Y._replace(vertices=Y.vertices * 2))
    maybe = Y._replace(vertices=Y.vertices * 7)
    check_one_unit(part, maybe)
    assert "millimetres" in doubtful_units(part, maybe)
    # A small piece that was cut out of a large shape has triangles as large.
    few = Mesh(X.vertices[X.faces[0]], np.array([[0, 1, 2]]))
    assert not doubtful_units(few, X, above=2)

    fine_part = testing.blob(0, subdivisions=3)
    export_mesh(folder / "part.ply", half(fine_part))
    export_mesh(folder / "large.ply", large)
    args = folder / "part.ply", folder / "large.ply", "--out", folder / "m.npz"
    result = run("match", *args, "--partial")
    assert result.exit_code == 1
    assert f"--partial: {folder / 'large.ply'} is" in words(result.stderr)
    with pytest.raises(ValueError, match="multiply the coordinates of mesh_x"):
        jfsf.match(half(fine_part), large, partial=True)


def test_parts_in_two_units_are_taken_where_units_may_differ(folder, monkeypatch):
    def searched(*_, same_unit, **__):
        raise ValueError(f"searched with same_unit={same_unit}")

    monkeypatch.setattr(_partial, "match_parts", searched)
    files = folder / "part.ply", folder / "large.ply"
    export_mesh(files[0], half(testing.blob(0, subdivisions=3)))
    export_mesh(files[1], Y._replace(vertices=Y.vertices * 25.4))
    out = folder / "m.npz"
    result = run("match", *files, "--out", out, "--partial", "--any-unit")
    assert result.exit_code == 1
    assert "searched with same_unit=False" in words(result.stderr)
    options = PairOptions("preserve", False, True, False)
    job = Job(files, folder / "job.npz", options=options)
    with pytest.raises(ValueError, match="searched with same_unit=False"):
        work(job, same_unit=False)
    with pytest.raises(ValueError, match="or give --any-unit"):
        work(job)


# Vertices that belong to no face.


def with_strays(mesh):
    return Mesh(np.concatenate([mesh.vertices, mesh.vertices[:2] * 1.1]), mesh.faces)


def test_ground_truth_on_stray_vertices_is_left_out_and_counted(folder):
    export_mesh(folder / "stray.ply", with_strays(Y))
    np.savez(folder / "m.npz", T_xy=np.arange(N), T_yx=[*range(N), 0, 1])
    np.savetxt(folder / "x.vts", np.arange(N) + 1, "%d")
    np.savetxt(folder / "y.vts", np.r_[1:N, N + 2], "%d")
    args = "evaluate", folder / "x.ply", folder / "stray.ply", folder / "m.npz"
    truth = "--gt-x", folder / "x.vts", "--gt-y", folder / "y.vts"
    result = run(*args, *truth, "--json", folder / "f.json")
    assert result.exit_code == 0, result.output
    said = f"ground truth: 1 of {N} points is left out, on vertices that belong to no"
    assert said in words(result.stdout) and "inf" not in result.stdout
    record = json.loads((folder / "f.json").read_text())
    assert record["points"] == N and record["points_left_out"] == 1
    assert record["figures"]["error_mean"] == 0 == record["figures"]["bijectivity_y"]
    np.savetxt(folder / "y.vts", np.full(N, N + 1), "%d")
    result = run(*args, *truth)
    assert result.exit_code == 1 and f"all {N} points are left out" in result.stderr


def test_another_piece_is_at_no_finite_distance(folder):
    far = Mesh(Y.vertices + 9, Y.faces + N)
    both = Mesh(np.r_[Y.vertices, far.vertices], np.r_[Y.faces, far.faces])
    export_mesh(folder / "both.ply", both)
    np.savez(folder / "m.npz", T_xy=np.r_[1:N, N + 3])
    for side in "xy":
        np.savetxt(folder / f"{side}.vts", np.arange(N) + 1, "%d")
    truth = "--gt-x", folder / "x.vts", "--gt-y", folder / "y.vts"
    files = folder / "x.ply", folder / "both.ply", folder / "m.npz"
    result = run("evaluate", *files, *truth, "--every", 7, "--json", folder / "f.json")
    assert result.exit_code == 0, result.output
    assert "no finite distance" in result.stdout and "another piece" in result.stdout
    assert "Infinity" not in (folder / "f.json").read_text()


def test_metrics_leave_out_vertices_without_a_face():
    stray = with_strays(Y)
    gt_y = np.r_[1:N, N + 1]
    T_xy = np.r_[1:N, 0]
    error = geodesic_error(T_xy, stray, np.arange(N), gt_y)
    assert np.isnan(error[-1]) and not error[:-1].any()
    maps = Maps(T_xy, np.r_[N - 1, 0 : N - 1, 0, 0])
    only = "error", "bijectivity_x", "bijectivity_y"
    figures = evaluate(maps, X, stray, truth=(np.arange(N), gt_y), only=only)
    assert figures.error_left_out == 1 and figures.error_mean == 0
    assert figures.bijectivity_x == 0 == figures.bijectivity_y
    # An image without a face is a fault of the map: it is not left out.
    T_xy[0] = N
    assert np.isinf(geodesic_error(T_xy, stray, np.arange(N), gt_y)[0])
    with pytest.raises(ValueError, match="all 2 points of the ground truth"):
        evaluate(maps, X, stray, truth=([1, 2], [N, N + 1]), only=only)


def test_notes_are_kept_with_a_match(tmp_path):
    T = np.arange(5)
    found = Match(T, T, jnp.eye(3), GOOD)
    write_match(tmp_path / "a.npz", found, notes=["x.ply: 鼻尖", "b"])
    assert read_notes(tmp_path / "a.npz") == ["x.ply: 鼻尖", "b"]
    assert np.array_equal(read_match(tmp_path / "a.npz").T_xy, T)
    write_match(tmp_path / "b.npz", found)
    assert read_notes(tmp_path / "b.npz") == []
    np.savez(tmp_path / "c.npz", notes=T)
    with pytest.raises(MapFileError, match="expected lines of text"):
        read_notes(tmp_path / "c.npz")
