"""The embedded shapes: sound meshes, a usable ground truth, small, zip-safe."""

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

import jfsf.data
from jfsf.data import load, names

FOLDER = Path(jfsf.data.__file__).parent


def test_names():
    assert names() == tuple(sorted(names()))
    assert {"man_walk", "man_up", "woman_up", "heavy_squat", "child_kick"} <= {*names()}


@pytest.mark.parametrize("name", names())
def test_shape_is_sound(name):
    sample = load(name)
    vertices, faces = sample.mesh
    assert vertices.dtype == np.float64 and vertices.shape[1:] == (3,)
    assert faces.dtype == np.int32 and faces.shape[1:] == (3,)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume > 0  # wound outward
    assert mesh.body_count == 1 and mesh.euler_number == 2
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))
    assert 4500 < len(vertices) < 5500 and mesh.area_faces.min() > 0
    assert 0.8 < np.ptp(vertices[:, 1]) < 2  # metres, y up


@pytest.mark.parametrize("name", names())
def test_template_is_in_range_and_covers(name):
    mesh, template = load(name)
    assert template.dtype == np.int32 and template.shape == (13380,)
    assert 0 <= template.min() and template.max() < len(mesh.vertices)
    # The template is denser in the face and hands, sparser elsewhere.
    assert len(np.unique(template)) > 0.65 * len(mesh.vertices)


def test_ground_truth_keeps_lengths_between_poses():
    # Neighbours on one shape are neighbours on the other: two poses of one body.
    a, b = load("man_walk"), load("man_up")
    first, last = np.random.default_rng(0).integers(0, 13380, (2, 200_000))
    length = [
        np.linalg.norm(
            np.subtract(*s.mesh.vertices[s.template_to_vertex[[first, last]]]), axis=1
        )
        for s in (a, b)
    ]
    near = length[0] < 0.05
    assert near.sum() > 100 and np.quantile(length[1][near], 0.9) < 0.08


def test_every_load_is_fresh():
    load("man_up").mesh.vertices[:] = 0
    assert load("man_up").mesh.vertices.any()


@pytest.mark.parametrize("name", ["nobody", "../data/man_up", ""])
def test_unknown_name_lists_the_known(name):
    with pytest.raises(ValueError, match="there are child_kick, .*woman_walk"):
        load(name)


def test_folder_is_small_and_licensed():
    files = [p for p in FOLDER.iterdir() if p.is_file()]
    assert sum(p.stat().st_size for p in files) <= 1_500_000
    assert "CC0 1.0" in (FOLDER / "LICENSE.CC0.md").read_text()
    table = (FOLDER / "PROVENANCE.md").read_text()
    for name in names():
        vertices, faces = load(name).mesh
        assert f"| {name} | {len(vertices)} | {len(faces)} |" in table


def test_loads_from_a_zip(tmp_path):
    package = FOLDER.parent
    with zipfile.ZipFile(tmp_path / "jfsf.zip", "w") as archive:
        archive.writestr("jfsf/__init__.py", "")
        for path in (package / "types.py", *FOLDER.glob("*.py"), FOLDER / "man_up.npz"):
            archive.write(path, Path("jfsf") / path.relative_to(package))
    code = "import jfsf.data as d; print(d.__file__, len(d.load('man_up').mesh.faces))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(tmp_path / "jfsf.zip")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    path, faces = done.stdout.split()
    assert "jfsf.zip" in path and int(faces) == len(load("man_up").mesh.faces)
