"""Colours of the vertices of mesh files, and exports in the colours of Y's file."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.export import export_map, export_mesh
from jfsf.mesh import read
from jfsf.mesh import vertex_colours as found_colours
from jfsf.types import Certificate, Match, Mesh

MESH = testing.blob(0, subdivisions=1)
N = len(MESH.vertices)
# Of one byte a channel, as most formats hold them.
COLOURS = np.random.default_rng(0).integers(0, 256, (N, 3)) / 255
BYTE = 0.51 / 255


def vertex_colours(path) -> Any:
    return found_colours(path)


def lines(*columns):
    """Rows of text, of the columns side by side; faces behind."""
    rows = zip(*(np.atleast_2d(c).tolist() for c in columns), strict=True)
    return "".join(
        " ".join(str(v) for part in row for v in part) + "\n" for row in rows
    )


def off(keyword, *columns):
    faces = lines(np.full((len(MESH.faces), 1), 3), MESH.faces)
    return f"{keyword}\n{N} {len(MESH.faces)} 0\n{lines(*columns)}{faces}"


BYTES = (255 * COLOURS).round().astype(int)
NORMALS = np.zeros((N, 3)) + [0.0, 0, 1]
OFFS = {
    "bytes": off("COFF", MESH.vertices, BYTES, np.full((N, 1), 255)),
    "floats": off("COFF", MESH.vertices, COLOURS),
    "normals": off("CNOFF", MESH.vertices, NORMALS, BYTES),
}


@pytest.mark.parametrize("kind", OFFS)
def test_off(tmp_path, kind):
    (path := tmp_path / "a.off").write_text(OFFS[kind])
    assert np.abs(vertex_colours(path) - COLOURS).max() < 1e-9
    # Some write the counts behind the keyword.
    keyword, _, rest = OFFS[kind].partition("\n")
    path.write_text(f"{keyword}{rest}")
    assert np.abs(vertex_colours(path) - COLOURS).max() < 1e-9


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_what_is_exported_is_read(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    export_mesh(path, MESH, colours=COLOURS)
    # Dark colours are few in the bytes of glTF, which are linear.
    most = 0.06 if suffix == ".glb" else BYTE
    assert np.abs(vertex_colours(path) - COLOURS).max() < most
    uv = np.random.default_rng(1).random((N, 2))
    if suffix == ".obj":  # beside a texture, and vertices without a face
        export_mesh(path, Mesh(MESH.vertices, MESH.faces[4:]), colours=COLOURS, uv=uv)
        assert np.abs(vertex_colours(path) - COLOURS).max() < BYTE
    export_mesh(path, MESH)
    assert vertex_colours(path) is None
    export_mesh(path, MESH, colours=np.full((N, 3), 0.5))  # as good as none
    assert vertex_colours(path) is None


def test_files_of_other_writers(tmp_path):
    colours = np.c_[BYTES, np.full(N, 200)].astype(np.uint8)
    for name in ("a.ply", "a.obj"):
        mesh = trimesh.Trimesh(*MESH, process=False, vertex_colors=colours)
        mesh.export(tmp_path / name)
        assert np.abs(vertex_colours(tmp_path / name) - COLOURS).max() < BYTE
    trimesh.PointCloud(MESH.vertices, colours).export(tmp_path / "cloud.ply")
    assert np.abs(vertex_colours(tmp_path / "cloud.ply") - COLOURS).max() < BYTE
    (tmp_path / "b.obj").write_text(
        "# v 1 2 3 4 5 6\n"
        + "".join(f"v {i} 0 {i * i} {i * 25} 0 255\n" for i in range(9))
    )
    found = vertex_colours(tmp_path / "b.obj")
    assert np.allclose(found[:, 0], np.arange(9) * 25 / 255)
    (tmp_path / "c.obj").write_text("v 0 0 0 a b c\nv 1 0 0 a b c\nv 0 1 0 a b c\n")
    assert vertex_colours(tmp_path / "c.obj") is None
    trimesh.Trimesh(*MESH).export(tmp_path / "a.stl")
    assert vertex_colours(tmp_path / "a.stl") is None


def test_parts_of_a_scene_keep_their_order(tmp_path):
    scene = trimesh.Scene()
    for i in range(3):
        mesh = trimesh.Trimesh(MESH.vertices + 3 * i, MESH.faces, process=False)
        if i != 1:
            mesh.visual.vertex_colors = np.full((N, 4), 255 * (i > 0), np.uint8)
        scene.add_geometry(mesh, geom_name=f"{9 - i}")
    scene.export(tmp_path / "a.glb")
    found, points = (
        vertex_colours(tmp_path / "a.glb"),
        read(tmp_path / "a.glb").vertices,
    )
    for i, value in enumerate((0.0, 0.7, 1.0)):
        near = np.linalg.norm(points - 3 * i, axis=1) < 2
        assert near.any() and np.allclose(found[near], value)


def test_x_is_exported_in_given_colours(tmp_path):
    T = np.random.default_rng(2).integers(0, N, N)
    export_map(tmp_path / "a.ply", MESH, MESH, T, colours_y=COLOURS)
    assert np.abs(vertex_colours(tmp_path / "a.ply") - COLOURS[T]).max() < BYTE
    with pytest.raises(ValueError, match="colours_y has shape"):
        export_map(tmp_path / "b.ply", MESH, MESH, T, colours_y=COLOURS[:3])


def test_the_command_takes_the_colours_of_y(tmp_path, monkeypatch):
    x, y = testing.blob(0), testing.blob(1)
    n = len(y.vertices)
    T = np.random.default_rng(3).permutation(n)
    values = {"empty": 0, "finite": True, "landmarks": np.zeros(0)}
    good = Certificate(*(jnp.asarray(values.get(k, 0.9)) for k in Certificate._fields))
    found = Match(T, np.argsort(T), jnp.eye(3), good)
    monkeypatch.setattr("jfsf.matching.match", lambda *_, **__: found)
    colours = np.random.default_rng(4).integers(0, 256, (n + 1, 3)) / 255
    export_mesh(tmp_path / "x.ply", x)
    # A vertex without a face comes first.
    stray = Mesh(np.concatenate([y.vertices[:1] * 2, y.vertices]), y.faces + 1)
    export_mesh(tmp_path / "y.ply", stray, colours=colours)
    args = ["match", "x.ply", "y.ply", "--out", "m.npz", "--export", "c.ply"]
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, args)
    assert result.exit_code == 0, result.output
    assert "exported in the vertex colours of y.ply" in result.stdout
    assert np.abs(vertex_colours("c.ply") - colours[1:][T]).max() < BYTE
    result = CliRunner().invoke(app, [*args, "--by-place"])
    assert result.exit_code == 0 and "vertex colours" not in result.stdout
    assert np.abs(vertex_colours("c.ply") - colours[1:][T]).max() > 0.1


@pytest.mark.parametrize("texture", ["property float s\nproperty float t\n", ""])
def test_colours_of_ply_beside_texture_and_bad_vertices(tmp_path, texture):
    more = " 0.5 0.5" if texture else ""
    head = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\n"
        f"property uchar green\nproperty uchar blue\n{texture}"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = ["0 0 0 255 0 0", "1 0 0 0 255 0", "0 1 0 0 0 255", "nan 0 0 51 0 0"]
    body = "".join(f"{row}{more}\n" for row in rows) + "3 0 1 2\n"
    (tmp_path / "a.ply").write_text(head + body)
    expected = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.2, 0, 0]]
    np.testing.assert_allclose(found_colours(tmp_path / "a.ply"), expected)


@pytest.mark.parametrize(
    "keyword, behind",
    [
        ("CNOFF", "0 0 1 {}"),
        ("NCOFF", "{} 0 0 1"),  # as MeshLab
        ("NCSTOFF", "{} 0 0 1 0.5 0.5"),
        ("CSTOFF", "{} 0.5 0.5"),
    ],
)
def test_keywords_of_off_in_any_order(tmp_path, keyword, behind):
    colours = "255 0 0", "0 255 0", "0 0 255"
    points = "0 0 0", "1 0 0", "0 1 0"
    rows = [f"{p} {behind.format(c)}" for p, c in zip(points, colours, strict=True)]
    text = "\n".join([keyword, "3 1 0", *rows, "3 0 1 2"])
    (tmp_path / "a.off").write_text(text)
    assert len(read(tmp_path / "a.off").faces) == 1
    np.testing.assert_allclose(found_colours(tmp_path / "a.off"), np.eye(3))
