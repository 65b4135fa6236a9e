"""trimesh's and meshio's meshes: every vertex and face stays, in its place."""

import subprocess
import sys

import meshio
import numpy as np
import pytest
import trimesh

from jfsf import testing
from jfsf.apps.interop import from_meshio, from_trimesh, to_meshio, to_trimesh
from jfsf.mesh import MeshError
from jfsf.types import Mesh

PLAIN = testing.blob(0)
# What trimesh drops by default: copies, vertices without a face, a face of no area and
# one that comes twice.
MESSY = Mesh(
    np.vstack([PLAIN.vertices[:3], PLAIN.vertices, PLAIN.vertices[-2:]]),
    np.vstack([PLAIN.faces + 3, [[5, 5, 6]], PLAIN.faces[:1] + 3]).astype(np.int32),
)
CLOUD = Mesh(PLAIN.vertices[:9], np.zeros((0, 3), np.int32))
PAIRS = [(to_trimesh, from_trimesh), (to_meshio, from_meshio)]


@pytest.mark.parametrize("there, back", PAIRS)
@pytest.mark.parametrize("mesh", [PLAIN, MESSY, CLOUD])
def test_there_and_back(there, back, mesh):
    found = back(there(mesh))
    for ours, theirs in zip(mesh, found, strict=True):
        np.testing.assert_array_equal(theirs, ours)
        assert theirs.dtype == ours.dtype
    found.vertices[:] = 0
    assert mesh.vertices.any()


def test_the_objects_are_those_of_the_packages():
    found = to_trimesh(PLAIN)
    assert isinstance(found, trimesh.Trimesh) and found.is_watertight
    assert isinstance(to_trimesh(CLOUD), trimesh.PointCloud)
    assert to_meshio(PLAIN).cells_dict.keys() == {"triangle"}
    # By default it is not so.
    assert len(trimesh.Trimesh(*MESSY).vertices) < len(MESSY.vertices)


def test_from_trimesh_takes_what_trimesh_makes():
    box = trimesh.creation.box()
    assert [a.shape for a in from_trimesh(box)] == [(8, 3), (12, 3)]
    assert from_trimesh(trimesh.PointCloud(box.vertices)).faces.shape == (0, 3)
    scene = trimesh.Scene({"a": box, "b": box})
    with pytest.raises(
        ValueError, match="got Scene, .*; pass one of its geometry: a, b"
    ):
        from_trimesh(scene)
    with pytest.raises(ValueError, match="got ndarray, expected a Trimesh"):
        from_trimesh(np.zeros((3, 3)))


def test_meshio_reads_and_writes_them(tmp_path):
    for suffix in ("off", "ply", "vtk", "obj"):
        to_meshio(PLAIN).write(path := tmp_path / f"a.{suffix}")
        found = from_meshio(meshio.read(path))
        np.testing.assert_allclose(found.vertices, PLAIN.vertices, atol=1e-12)
        np.testing.assert_array_equal(found.faces, PLAIN.faces)


def test_polygons_become_fans_in_their_place():
    angle = np.arange(9) * 2 * np.pi / 9  # so all polygons are convex
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    cells = [
        ("triangle", [[0, 1, 2]]),
        ("line", [[0, 8]]),
        ("quad", [[2, 3, 4, 5], [5, 6, 7, 8]]),
        ("vertex", [[8]]),
        ("polygon", [[0, 1, 2, 3, 4]]),
        ("triangle", [[6, 7, 8]]),
    ]
    found = from_meshio(meshio.Mesh(points.astype(np.float32), cells))
    wanted = [[0, 1, 2], [2, 3, 4], [2, 4, 5], [5, 6, 7], [5, 7, 8]]
    wanted += [[0, 1, 2], [0, 2, 3], [0, 3, 4], [6, 7, 8]]
    np.testing.assert_array_equal(found.faces, wanted)
    assert found.vertices.dtype == np.float64 and found.faces.dtype == np.int32


def test_other_cells_are_refused():
    points = np.zeros((10, 3))
    for kind, size in (("tetra", 4), ("triangle6", 6), ("quad8", 8)):
        with pytest.raises(MeshError, match=f"cells of type '{kind}'"):
            from_meshio(meshio.Mesh(points, [(kind, [np.arange(size)])]))
    with pytest.raises(MeshError, match="names vertex 10"):
        from_meshio(meshio.Mesh(points, [("triangle", [[0, 1, 10]])]))
    with pytest.raises(MeshError, match=r"pass \(n, 3\) real"):
        from_meshio(meshio.Mesh(points[:, :2], [("triangle", [[0, 1, 2]])]))


@pytest.mark.parametrize("there", [to_trimesh, to_meshio])
def test_what_is_no_mesh_is_refused(there):
    with pytest.raises(MeshError, match=f"{there.__name__}: a face names vertex 162"):
        there(Mesh(PLAIN.vertices, PLAIN.faces + 1))
    with pytest.raises(MeshError, match="not finite"):
        there(Mesh(PLAIN.vertices * np.nan, PLAIN.faces))


def test_missing_meshio_says_how_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(
        ImportError, match=r"needs meshio.*pip install 'jfsf\[interop\]'"
    ):
        to_meshio(PLAIN)


def test_the_partners_are_not_imported_before_they_are_needed():
    code = (
        "import sys, jfsf.apps.interop, jfsf.apps.export\n"
        "partners = {'torch', 'meshio', 'trimesh', 'pyFM', 'ott', 'matplotlib'}\n"
        "assert not partners & set(sys.modules), partners & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
