"""jfsf collection, from files to files."""

import contextlib
import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from shapes import small
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.cli._collection import _meshes_in, _with_template
from jfsf.apps.cli._collection_carried import points_of
from jfsf.apps.cli._collection_runner import _write_way
from jfsf.apps.mapfiles import read_match
from jfsf.apps.model import read_model
from jfsf.batch._jobs import Job, is_done
from jfsf.mesh import read
from jfsf.mesh._edit import mirror_image
from jfsf.types import Mesh

pytest.importorskip("distributed")
BODIES = "man_walk", "man_t", "woman_walk"
LANDMARKS = 3


def run(*args):
    return CliRunner().invoke(app, ["collection", *map(str, args)])


def write(path, mesh):
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def content(folder):
    """Bytes of all results, by name."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.slow  # matches in earnest, in processes of its own
def test_a_folder_becomes_one_topology_and_a_model(tmp_path):
    scans, out = tmp_path / "scans", tmp_path / "model"
    scans.mkdir()
    truth = {}
    for i, name in enumerate(BODIES):
        mesh, truth[name] = small(name, 1200 + 100 * i)
        write(scans / f"{name}.ply", mesh._replace(vertices=(1 + i) * mesh.vertices))
    (scans / "broken.off").write_text("OFF\n3 1 0\n0 0 0\n")
    template = read(scans / "man_walk.ply")
    marks = tmp_path / "template.csv"
    rows = [f"p{i},{x},{y},{z}" for i, (x, y, z) in enumerate(template.vertices[:3])]
    marks.write_text("\n".join(["name,x,y,z", *rows, ""]))
    args = scans, "--out", out, "--template", scans / "man_walk.ply"
    np.save(tmp_path / "heights.npy", template.vertices[:, 1])
    args = *args, "--landmarks", marks, "--values", tmp_path / "heights.npy"
    args = *args, "--workers", "1"
    found = run(*args)
    assert found.exit_code == 1, found.output  # for the broken file
    assert f"left out: {scans / 'broken.off'}" in found.output.replace("\n", "")
    with (out / "summary.csv").open() as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert set(rows) == {*BODIES, "broken"}
    assert "export it again" in rows["broken"]["reason"]
    model = read_model(out / "model.npz")
    assert model.mean.shape == template.vertices.shape
    for name in BODIES:
        own = read(out / "registered" / f"{name}.ply")
        assert (own.faces == template.faces).all()
        assert float(rows[name]["mean_distance"]) < 0.01
        assert int(rows[name]["flipped"]) == 0
        # Vertices of the template lie where they should, in the shape's own unit.
        scan, unit = read(scans / f"{name}.ply"), 1 + BODIES.index(name)
        at = own.vertices[truth["man_walk"]] - scan.vertices[truth[name]]
        assert np.linalg.norm(at, axis=1).mean() < 0.1 * unit
        carried = (out / "landmarks" / f"{name}.csv").read_text().splitlines()
        assert len(carried) == LANDMARKS + 1
        heights = np.load(out / "values" / f"{name}.npy")
        assert heights.shape == (len(scan.vertices),) and np.isfinite(heights).all()
    T_xy = np.asarray(read_match(out / "maps" / "man_t.npz").T_xy)
    assert len(T_xy) == len(template.vertices)
    # What was made is kept, and what is missing is made again, to the byte.
    before = content(out)
    for lost in ("pairs/man_t__man_walk.npz", "registered/man_t.npz", "maps/man_t.npz"):
        (out / lost).unlink()
    assert run(*args).exit_code == 1
    assert content(out) == before
    # Another shape by what is there, which stays as it is.
    more, new = tmp_path / "more", tmp_path / "new"
    more.mkdir()
    scan, at = small("man_up", 1400)
    write(more / "man_up.ply", scan._replace(vertices=5 * scan.vertices))
    found = run(more, "--onto", out, "--out", new, "--workers", "1", "--report")
    assert found.exit_code == 0, found.output
    assert content(out) == before
    own = read(new / "registered" / "man_up.ply").vertices[truth["man_walk"]]
    assert np.linalg.norm(own - 5 * scan.vertices[at], axis=1).mean() < 0.1 * 5
    lines = (new / "landmarks.csv").read_text().splitlines()
    assert lines[1].startswith("man_up,") and len(lines) == 2
    assert np.load(new / "values" / "man_up.npy").shape == (len(scan.vertices),)
    assert "man_up, man_walk: 0." in (new / "index.html").read_text()
    # Of a mesh that is gone nothing stays that counts.
    (scans / "woman_walk.ply").unlink()
    assert run(*args).exit_code == 1
    left = {name for name in content(out) if Path(name).stem == "woman_walk"}
    assert {Path(name).parts[0] for name in left} <= {"shapes", "ways"}


@pytest.mark.slow  # matches in earnest, in processes of its own
def test_another_template_leaves_nothing_of_the_first(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    for i, name in enumerate(BODIES):
        write(scans / f"{name}.ply", small(name, 1200 + 100 * i)[0])
    for out, templates in (("new", ["man_t"]), ("again", ["man_walk", "man_t"])):
        for name in templates:
            args = "--template", scans / f"{name}.ply", "--workers", "1"
            found = run(scans, "--out", tmp_path / out, *args)
            assert found.exit_code == 0, found.output
    new, again = (content(tmp_path / out) for out in ("new", "again"))
    assert set(new) == set(again)
    assert [name for name in new if again[name] != new[name]] == []


def test_nothing_stays_of_what_is_left_out(tmp_path):
    from jfsf.apps.cli._collection_runner import forget, known_before

    kinds = (
        *("templates/other/maps/{}.npz", "templates/other/registered/{}.ply"),
        *("templates/{}/registered/other.npz", "templates/other/placed/{}.npz"),
        *("maps/{}.npz", "maps/report/{}.html", "placed/{}.npz"),
        *("registered/{}.npz", "registered/{}.ply", "others/{}.npz"),
        *("landmarks/{}.mrk.json", "landmarks/{}.fcsv", "labels/{}.csv"),
        "values/{}.npy",
    )
    for kind in kinds:
        for name in ("scan", "scan.1"):  # a name may have a dot
            path = tmp_path / kind.format(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(name)
    assert known_before(tmp_path) == {"scan", "scan.1"}
    forget(tmp_path, ["scan", "never there"])
    assert known_before(tmp_path) == {"scan.1"}
    assert set(content(tmp_path)) == {kind.format("scan.1") for kind in kinds}


def begun(scans, out, cache):
    """The command as a process of its own, in a group that can be killed."""
    command = [sys.executable, "-m", "jfsf", "collection", scans, "--out", out]
    command += ["--workers", "2", "--report"]
    return subprocess.Popen(
        list(map(str, command)),
        # Compiled sooner: each program runs a few times.
        env=os.environ
        | {"JFSF_CACHE": str(cache), "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


@pytest.mark.slow  # matches in earnest, in processes that are killed
def test_a_run_that_was_killed_ends_with_the_same_bytes(tmp_path):
    scans, cache = tmp_path / "scans", tmp_path / "cache"
    scans.mkdir()
    for i, name in enumerate(BODIES):
        write(scans / f"{name}.ply", small(name, 1200 + 100 * i)[0])
    assert begun(scans, tmp_path / "first", cache).wait() == 0
    started = time.perf_counter()
    whole = tmp_path / "whole"
    assert begun(scans, whole, cache).wait() == 0
    took = time.perf_counter() - started
    rng, killed = np.random.default_rng(0), tmp_path / "killed"
    for share in rng.uniform(0.1, 0.5, 10):
        run = begun(scans, killed, cache)
        time.sleep(share * took)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.wait()
    assert begun(scans, killed, cache).wait() == 0
    true, found = content(whole), content(killed)
    assert {"index.html", "model.html", "model.npz"} <= set(true) == set(found)
    assert [name for name in true if found[name] != true[name]] == []


def with_short_arm(faces, sides, share=0.4):
    """The same body in T pose, somewhat wider, with a short arm at positive x."""
    mesh = small("man_t", faces)[0]
    vertices = mesh.vertices * sides
    x, root = vertices[:, 0], 0.15 * np.ptp(vertices[:, 1])
    vertices[:, 0] = np.where(x > root, root + share * (x - root), x)
    return mesh._replace(vertices=vertices)


@pytest.mark.slow  # matches in earnest
def test_foreign_and_mirrored_shapes_are_named_and_mirrored_back(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    builds = {"a": [1, 1, 1], "b": [1, 1.05, 1.1], "c": [1.05, 1, 0.95]}
    for i, (name, sides) in enumerate(builds.items()):
        write(scans / f"{name}.ply", with_short_arm(1900 + 100 * i, sides))
    odd = mirror_image(with_short_arm(2200, [1, 1, 1.05]))
    write(scans / "odd.ply", odd)
    write(scans / "blob.ply", testing.blob(0, subdivisions=3))
    found = run(scans, "--out", tmp_path / "named", "--workers", "1")
    said = " ".join(found.output.split())
    assert found.exit_code == 1
    assert "odd.ply: it is a mirror image of the others" in said
    assert "blob.ply: no trusted map leads to it, nor to its mirror image" in said
    auto = "--workers", "1", "--mirror", "auto"
    found = run(scans, "--out", tmp_path / "auto", *auto)
    said = " ".join(found.output.split())
    assert found.exit_code == 1  # for the foreign one
    assert "mirrored back:" in said and "odd.ply: it is" not in said
    on_odd = read(tmp_path / "auto" / "registered" / "odd.ply")
    odd = read(tmp_path / "auto" / "mirrored" / "odd.ply")
    away = KDTree(odd.vertices).query(on_odd.vertices)[0]
    assert away.mean() < 0.02
    # The short arm is where that of the others is.
    assert on_odd.vertices[:, 0].max() < -0.75 * on_odd.vertices[:, 0].min()


def box_in(folder, name):
    box = trimesh.creation.box()
    folder.mkdir(exist_ok=True)
    write(folder / name, Mesh(box.vertices, box.faces))


def test_a_folder_that_is_no_collection_is_an_error(tmp_path):
    out = ("--out", tmp_path / "out")
    found = run(tmp_path / "none", *out)
    assert found.exit_code == 1 and "is no folder" in found.output
    scans = tmp_path / "scans"
    box_in(scans, "a.ply")
    box_in(scans, "a.off")
    found = run(scans, *out)
    assert found.exit_code == 1 and "rename one" in found.output
    (scans / "a.off").unlink()
    found = run(scans, *out, "--landmarks", scans / "a.ply")
    assert found.exit_code == 1 and "name it: --template" in found.output
    found = run(scans, *out, "--values", scans / "a.ply")
    assert found.exit_code == 1 and "--values are those of the template" in found.output
    found = run(scans, *out, "--template", tmp_path / "t.ply")
    assert found.exit_code == 1 and "is no file" in found.output
    assert not (tmp_path / "out").exists()
    found = run(scans, "--out", scans / ".." / "scans")
    assert found.exit_code == 1 and "would be read as shapes" in found.output
    assert [path.name for path in scans.iterdir()] == ["a.ply"]


def test_which_files_are_shapes_and_which_is_the_template(tmp_path):
    scans = tmp_path / "scans"
    box_in(scans, "a.ply")
    box_in(scans, "b.ply")
    (scans / "._a.ply").write_bytes(b"of macOS")
    paths = _meshes_in(scans)
    assert list(paths) == ["a", "b"]
    (tmp_path / "link").symlink_to(scans)
    same, found = _with_template(tmp_path / "link" / "b.ply", paths)
    assert (same, found) == (paths["b"], paths)
    box_in(tmp_path / "other", "b.ply")
    with pytest.raises(ValueError, match="has the name of"):
        _with_template(tmp_path / "other" / "b.ply", paths)


def test_landmarks_by_vertices_are_those_of_the_file(tmp_path):
    ball = testing.blob(0)
    strays = Mesh(np.concatenate([np.full((3, 3), 9.0), ball.vertices]), ball.faces + 3)
    rows = [f"v {x} {y} {z}" for x, y, z in [*strays.vertices, (np.nan, 0, 0)]]
    rows += [f"f {a} {b} {c}" for a, b, c in strays.faces + 1]
    (tmp_path / "t.obj").write_text("\n".join(rows))
    (tmp_path / "marks.csv").write_text("name,vertex\nnose,10\n")
    found = points_of(tmp_path / "marks.csv", tmp_path / "t.obj")
    assert found.vertices is None and found.names == ("nose",)
    np.testing.assert_allclose(found.points, strays.vertices[[10]], atol=1e-9)
    (tmp_path / "marks.csv").write_text(f"name,vertex\nnose,{len(strays.vertices)}\n")
    with pytest.raises(ValueError, match="has no finite place"):
        points_of(tmp_path / "marks.csv", tmp_path / "t.obj")


def test_ways_that_are_cut_short_are_written_again(tmp_path):
    path = tmp_path / "a.npz"
    arrays = {"T_xy": np.arange(500), "turned": np.array(False)}
    _write_way(path, **arrays)
    whole = path.stat().st_mtime_ns
    _write_way(path, **arrays)
    assert path.stat().st_mtime_ns == whole
    assert is_done(Job((), path))
    path.write_bytes(path.read_bytes()[:300])
    assert not is_done(Job((), path))
    _write_way(path, **arrays)
    with np.load(path) as file:
        np.testing.assert_array_equal(file["T_xy"], arrays["T_xy"])
