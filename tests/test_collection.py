"""jfsf collection, from files to files."""

import csv

import numpy as np
import pytest
import trimesh
from shapes import small
from typer.testing import CliRunner

from jfsf.cli import app
from jfsf.mapfiles import read_match
from jfsf.mesh import read
from jfsf.model import read_model
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
    assert set(rows) == {*BODIES, "broken"} and "line 3" in rows["broken"]["reason"]
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
