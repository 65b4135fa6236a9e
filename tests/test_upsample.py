"""Upsampled meshes stay closed, keep their surface, and their old vertices."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.accuracy import datasets
from experiments.bench import upsample
from jfsf import data, testing
from jfsf.mesh import check, read
from jfsf.mesh._geometry import face_areas


@pytest.mark.parametrize("n", [162, 163, 300, 641, 642, 1500])
def test_it_is_the_same_surface(n):
    mesh = testing.blob(0)
    finer = upsample.upsample(mesh, n)
    assert len(finer.vertices) == n
    assert np.array_equal(finer.vertices[:162], mesh.vertices)
    report = check(finer)
    # A closed surface of genus 0 has this many faces.
    assert len(finer.faces) == 2 * n - 4
    assert str(report).splitlines()[1] == str(check(mesh)).splitlines()[1]
    areas = [face_areas(m.vertices, m.faces) for m in (mesh, finer)]
    np.testing.assert_allclose(areas[1].sum(), areas[0].sum())
    assert areas[1].min() > areas[0].min() / 70


def test_fewer_vertices_than_there_are_is_an_error():
    with pytest.raises(ValueError, match="n is 100, the mesh has 162"):
        upsample.upsample(testing.blob(0), 100)


def test_the_file_reads_as_it_was(tmp_path):
    mesh = upsample.upsample(testing.blob(0), 200)
    upsample.write_off(tmp_path / "a.off", mesh)
    back = read(tmp_path / "a.off")
    np.testing.assert_allclose(back.vertices, mesh.vertices, rtol=1e-8)
    assert np.array_equal(back.faces, mesh.faces)
    assert [p.name for p in tmp_path.iterdir()] == ["a.off"]


def test_what_it_writes_is_a_folder_of_shapes_with_their_truth(tmp_path, monkeypatch):
    asked = ["man_up", "--vertices", "6000", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["upsample.py", *asked])
    upsample.main()
    args = SimpleNamespace(embedded=False, data=[tmp_path], pairs=None, within=None)
    shape = datasets.load(args, "man_up")
    assert len(shape.mesh.vertices) == 6000
    assert np.array_equal(shape.truth, data.load("man_up").template_to_vertex)
