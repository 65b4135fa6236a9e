"""The command line on damaged meshes: what it says of them, and maps after a repair."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.cli._files import matchable
from jfsf.apps.cli._stored import kept_match, write_found
from jfsf.apps.export import export_mesh
from jfsf.apps.mapfiles import read_match
from jfsf.mesh import read, repair
from jfsf.types import Certificate, Match, Mesh

X = testing.blob(0)
Y = Mesh(testing.blob(1).vertices, X.faces)
N = len(X.vertices)
VALUES = {"empty": 0, "bijectivity_x": 0, "bijectivity_y": 0, "finite": True}
VALUES |= {"rivals": 0, "mirrored": 0.0, "region_cost": float("nan")}
GOOD = Certificate(*(jnp.asarray(VALUES.get(n, 0.9)) for n in Certificate._fields))
GOOD = GOOD._replace(landmarks=jnp.zeros(0))


def run(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def broken(mesh):
    """A flake in front, a stray vertex behind, and copies of two vertices of a face."""
    flake = np.array([[9.0, 9, 9], [9.1, 9, 9], [9, 9.1, 9]])
    vertices = np.concatenate([flake, mesh.vertices, [[7.0, 0, 0]]])
    faces = mesh.faces + 3
    copies = vertices[faces[0, :2]]
    last = len(vertices)
    faces = np.concatenate([[[last, last + 1, faces[0, 2]]], faces[1:], [[0, 1, 2]]])
    return Mesh(np.concatenate([vertices, copies]), faces.astype(np.int32))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Meshes, broken ones, and a match that knows the vertices of the good ones."""
    for name, mesh in (("x", X), ("y", Y)):
        export_mesh(tmp_path / f"{name}.ply", mesh)
        export_mesh(tmp_path / f"{name}_broken.ply", broken(mesh))
    return tmp_path


@pytest.fixture
def seen(monkeypatch):
    """The options of the last match, which gets the good meshes."""
    options = {}

    def match(x, y, **given):
        for mine, theirs in zip((*X, *Y), (*x, *y), strict=True):
            assert np.array_equal(mine, theirs)
        options.update(given)
        there = (np.arange(N) + 5) % N
        likely = jnp.linspace(0, 1, N)
        match = Match(there, np.argsort(there), jnp.eye(3), GOOD)
        return match._replace(confidence_x=likely, confidence_y=likely[::-1])

    monkeypatch.setattr("jfsf.matching.match", match)
    return options


def match_of(folder, *options):
    out = folder / "map.npz"
    pair = (folder / f"{name}_broken.ply" for name in "xy")
    return out, run("match", *pair, "--out", out, *options)


def test_match_repair_maps_between_all_vertices(folder, seen):
    out, result = match_of(folder, "--repair")
    assert result.exit_code == 0, result.output
    for side in "xy":
        assert f"{folder / f'{side}_broken.ply'}: 2 duplicate vertices merged, " in (
            result.stdout
        )
    assert "1 small component removed" in result.stdout
    found, there = read_match(out), (np.arange(N) + 5) % N
    with np.load(out) as file:
        assert not {"index_x", "index_y"} & set(file)
    assert found.T_xy.shape == found.T_yx.shape == (N + 6,)
    assert np.array_equal(found.T_xy[3 : N + 3], there + 3)
    assert np.array_equal(found.T_yx[there + 3], np.arange(N) + 3)
    assert np.array_equal(found.T_xy[-2:], there[X.faces[0, :2]] + 3)
    likely = np.linspace(0, 1, N)
    assert found.confidence_x is not None and found.confidence_y is not None
    assert np.allclose(found.confidence_x[3 : N + 3], likely)
    assert np.allclose(found.confidence_x[-2:], likely[X.faces[0, :2]])
    assert np.allclose(found.confidence_y[3 : N + 3], likely[::-1])
    # Flakes and strays have images too.
    assert found.T_xy.min() >= 3 and found.T_xy.max() < N + 3


def test_a_match_is_read_as_it_wkept_match(folder):
    x, y = (matchable(folder / f"{name}_broken.ply", False, True) for name in "xy")
    there, inside = (np.arange(N) + 5) % N, np.arange(N) < 50
    found = Match(there, np.argsort(there), jnp.eye(3), GOOD, inside, ~inside)
    found = found._replace(membership_x=np.where(inside, 0.9, 0.2))
    write_found(folder / "map.npz", found, x, y)
    read_back = kept_match(read_match(folder / "map.npz"), x, y)
    for name in ("T_xy", "T_yx", "matched_x", "matched_y", "membership_x"):
        assert np.array_equal(getattr(read_back, name), getattr(found, name)), name
    assert read_back.confidence_x is None


def test_landmarks_count_the_vertices_of_the_file(folder, seen):
    pairs = folder / "pairs.txt"
    pairs.write_text(f"3 8\n{N + 4} 9\n")
    _, result = match_of(folder, "--repair", "--landmarks", pairs)
    assert result.exit_code == 0, result.output
    assert seen["landmarks"].tolist() == [[0, 5], [X.faces[0, 0], 6]]
    for lost, why in (
        (0, "is not in the largest piece"),
        (N + 3, "is not in the largest piece"),
        (N + 6, f"which has vertices 0 to {N + 5}"),
    ):
        pairs.write_text(f"3 {lost}\n")
        _, result = match_of(folder, "--repair", "--landmarks", pairs)
        assert result.exit_code == 1
        assert f"vertex {lost} of Y" in result.stderr and why in result.stderr


def test_evaluate_repair_measures_as_on_the_good_meshes(folder, seen):
    figures = []
    for suffix, options in (("", []), ("_broken", ["--repair"])):
        pair = [folder / f"{name}{suffix}.ply" for name in "xy"]
        for name in "xy":
            points = np.arange(N) if not suffix else np.arange(N) + 3
            np.savetxt(folder / f"{name}.vts", points + 1, "%d")
        out, record = folder / "map.npz", folder / "figures.json"
        result = run("match", *pair, "--out", out, *options)
        assert result.exit_code == 0, result.output
        truth = ("--gt-x", folder / "x.vts", "--gt-y", folder / "y.vts")
        result = run("evaluate", *pair, out, *options, *truth, "--json", record)
        assert result.exit_code == 0, result.output
        figures.append(json.loads(record.read_text())["figures"])
    assert figures[0] == pytest.approx(figures[1])
    assert figures[0]["error_mean"] > 0.01


def test_evaluate_repair_refuses_maps_of_other_vertices(folder, seen):
    pair = [folder / f"{name}_broken.ply" for name in "xy"]
    out = folder / "other.npz"
    np.savez(out, T_xy=np.zeros(N + 6, int))
    result = run("evaluate", *pair, out, "--repair")
    assert result.exit_code == 1 and "vertices of" in result.stderr
    index = repair(read(pair[0])).index
    np.savez(out, T_xy=np.arange(N), T_yx=np.arange(N), index_x=index, index_y=index)
    result = run("evaluate", *pair, out, "--repair")
    assert result.exit_code == 1 and "leave the option out" in result.stderr


def test_info_says_what_would_mend_a_mesh(folder):
    path, out = folder / "x_broken.ply", folder / "mended.ply"
    result = run("info", path)
    assert result.exit_code == 1
    words = " ".join(result.stdout.split())
    assert "--repair would mend: 2 duplicate vertices merged, " in words
    assert "1 vertex without a face removed" in words
    assert "repaired, it can be: pass --repair to match" in words
    before = path.read_bytes()
    result = run("info", path, "--repair", out)
    assert result.exit_code == 0, result.output
    assert "mended: 2 duplicate" in result.stdout and f"wrote {out}" in result.stdout
    assert "can be matched" in result.stdout
    assert path.read_bytes() == before
    assert all(np.array_equal(*pair) for pair in zip(read(out), X, strict=True))

    assert "--repair" not in run("info", out).stdout
    result = run("info", path, "--repair", path)
    assert result.exit_code == 1 and "is an input" in result.stderr
    assert run("info", path, "--repair", folder / "a.off").exit_code == 1


def test_info_says_what_no_repair_mends(folder):
    few = folder / "few.ply"
    export_mesh(few, Mesh(np.eye(3)[[0, 1, 2, 2]], np.array([[0, 1, 3]])))
    result = run("info", few)
    assert result.exit_code == 1 and "it still could not" in result.stdout
    flat = folder / "flat.ply"
    export_mesh(flat, Mesh(X.vertices, np.array([[0, 0, 1]])))
    result = run("info", flat)
    assert result.exit_code == 1 and "none of its faces has an area" in result.stdout


def test_info_measures_noise_spikes_and_holes(folder):
    rng = np.random.default_rng(0)
    mesh = testing.blob(0, subdivisions=4)
    mesh.vertices[:] += 0.02 * rng.normal(size=mesh.vertices.shape)
    mesh.vertices[7] *= 3
    mesh = Mesh(mesh.vertices, np.delete(mesh.faces, [90], axis=0))
    export_mesh(folder / "noisy.ply", mesh)
    result = run("info", folder / "noisy.ply")
    assert result.exit_code == 0
    assert "spikes: match flattens them, at 1 or more" in result.stdout
    assert "of sqrt(area); match smooths it away" in result.stdout
    assert "small holes: match closes them, with 1 new" in result.stdout
