"""Exported meshes, read by other packages: same vertices, faces and colours."""

import io
import itertools
import os
import sys

import meshio
import numpy as np
import pygltflib
import pytest
import trimesh
from PIL import Image

from jfsf.apps.export import export_map, export_mesh
from jfsf.apps.plot import coordinate_colours
from jfsf.apps.plot._colours import body_colours, texture_coordinates
from jfsf.data import load
from jfsf.mesh import MeshError, read
from jfsf.mesh._geometry import face_normals
from jfsf.types import Mesh

X, Y = load("man_walk").mesh, load("man_up").mesh
# With copies of two vertices that no face uses, which other writers drop.
X = Mesh(np.vstack([X.vertices[:2], X.vertices]), X.faces + np.int32(2))
N_X, N_Y = len(X.vertices), len(Y.vertices)
T_XY = np.random.default_rng(0).integers(0, N_Y, N_X)
COLOURS = body_colours(Y.vertices)[T_XY]
UV = 8 * texture_coordinates(Y.vertices)[T_XY]
BYTE = 0.51 / 255
CASES = [(".ply", False), (".obj", False), (".obj", True), (".glb", False)]
CASES += [(".glb", True)]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The path of each case, in a folder of its own."""
    paths = {}
    for suffix, checker in CASES:
        path = tmp_path_factory.mktemp("export") / f"x y{suffix}"
        export_map(path, X, Y, T_XY, checker=checker)
        paths[suffix, checker] = path
    return paths


def test_what_is_not_matched_is_grey(tmp_path):
    matched = np.arange(N_X) % 3 > 0
    export_map(tmp_path / "part.ply", X, Y, T_XY, matched_x=matched)
    mesh = trimesh.load(tmp_path / "part.ply", process=False)
    found = mesh.visual.vertex_colors[:, :3] / 255  # type: ignore
    assert np.abs(found[matched] - COLOURS[matched]).max() < BYTE
    assert np.ptp(found[~matched], axis=0).max() == 0


def srgb(linear):
    """The inverse of glTF's transfer function."""
    return np.where(
        linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear
    )


def by_trimesh(path):
    """Vertices, faces, sRGB colours and texture coordinates, as trimesh has them.

    Of OBJ it drops vertices without a face, and the colours if there is a texture.
    """
    found = trimesh.load(path, process=False)
    if isinstance(found, trimesh.Scene):
        (found,) = found.geometry.values()
    visual = found.visual
    if path.suffix == ".glb":
        colours = srgb(visual.vertex_attributes["color"][:, :3])
    elif visual.kind == "vertex":
        colours = visual.vertex_colors[:, :3] / 255
    else:
        colours = None
    uv = visual.uv if visual.kind == "texture" else None
    if path.suffix != ".obj":
        return found.vertices, found.faces, colours, uv
    vertices = np.vstack([X.vertices[:2], found.vertices])
    add = lambda rows, first: rows if rows is None else np.vstack([first[:2], rows])
    return vertices, found.faces + 2, add(colours, COLOURS), add(uv, UV)


def by_another(path):
    """The same by pygltflib and by meshio, which drops colours behind a v of OBJ."""
    if path.suffix == ".glb":
        return by_pygltflib(path)
    found = meshio.read(path)
    data = found.point_data
    if path.suffix == ".ply":
        channels = np.stack([data[name] for name in ("red", "green", "blue")], 1)
        colours = channels.astype(np.uint8) / 255  # meshio has int8
    else:
        colours = colours_of_obj(path)
    return (
        found.points[:, :3],
        found.cells_dict["triangle"],
        colours,
        data.get("obj:vt"),
    )


def colours_of_obj(path):
    lines = [line.split() for line in path.read_text().splitlines()]
    return np.array([line[4:] for line in lines if line[0] == "v"], float)


def gltf_of(path):
    gltf = pygltflib.GLTF2().load(path)
    assert gltf is not None and (blob := gltf.binary_blob()) is not None
    return gltf, blob


def by_pygltflib(path):
    gltf, blob = gltf_of(path)
    (part,) = gltf.meshes[0].primitives

    def array(number):
        accessor = gltf.accessors[number]
        view = gltf.bufferViews[accessor.bufferView]
        kind = {5126: "<f4", 5125: "<u4"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor.type]
        count = accessor.count * width
        values = np.frombuffer(blob, kind, count, view.byteOffset)
        return values.reshape(-1, width)

    at = part.attributes
    uv = None if at.TEXCOORD_0 is None else array(at.TEXCOORD_0) * [1, -1] + [0, 1]
    position = array(at.POSITION)
    limits = gltf.accessors[at.POSITION]
    np.testing.assert_array_equal(limits.min, position.min(0))
    np.testing.assert_array_equal(limits.max, position.max(0))
    np.testing.assert_allclose(np.linalg.norm(array(at.NORMAL), axis=1), 1, atol=1e-6)
    colours = array(at.COLOR_0)
    assert (colours[:, 3] == 1).all()
    faces = array(part.indices).reshape(-1, 3)
    return position, faces, srgb(colours[:, :3]), uv


@pytest.mark.parametrize("reader", [by_trimesh, by_another])
@pytest.mark.parametrize("case", CASES)
def test_other_readers_find_the_shape_its_colours_and_texture(exported, case, reader):
    suffix, checker = case
    vertices, faces, colours, uv = reader(exported[case])
    if suffix == ".glb":
        np.testing.assert_allclose(vertices, X.vertices, rtol=1e-7)
    else:
        np.testing.assert_array_equal(vertices, X.vertices)
    np.testing.assert_array_equal(faces, X.faces)
    if reader is not by_trimesh or case != (".obj", True):
        np.testing.assert_allclose(colours, COLOURS, atol=BYTE)
    assert (uv is not None) == checker
    if checker:
        np.testing.assert_allclose(uv, UV, atol=1e-5)


@pytest.mark.parametrize("case", CASES)
def test_our_reader_finds_the_mesh(exported, case):
    found = read(exported[case])
    np.testing.assert_array_equal(found.faces, X.faces)
    rtol = 1e-7 if case[0] == ".glb" else 0
    np.testing.assert_allclose(found.vertices, X.vertices, rtol=rtol)


def test_the_texture_is_a_checker_inside_or_beside_the_file(exported):
    path = exported[".obj", True]
    names = {p.name for p in path.parent.iterdir()}
    assert names == {"x y.obj", "x_y_checker.mtl", "x_y_checker.png"}
    image = trimesh.load(path, process=False).visual.material.image
    (inside,) = trimesh.load(exported[".glb", True]).geometry.values()
    gltf, blob = gltf_of(exported[".glb", True])
    view = gltf.bufferViews[gltf.images[0].bufferView]
    blob = blob[view.byteOffset or 0 :][: view.byteLength]
    assert (path.parent / "x_y_checker.png").read_bytes() == blob
    inside = inside.visual.material.baseColorTexture
    for found in (image, inside, Image.open(io.BytesIO(blob))):
        grey = np.asarray(found.convert("L")).astype(int)
        half = len(grey) // 2
        assert grey.shape == (2 * half, 2 * half)
        squares = grey.reshape(2, half, 2, half).swapaxes(1, 2).reshape(4, -1)
        assert (np.ptp(squares, axis=1) == 0).all()
        a, b, c, d = squares[:, 0]
        assert a == d and b == c and abs(a - b) > 100


def test_normals_are_those_of_the_faces(exported):
    found = trimesh.load(exported[".glb", False], process=False)
    (found,) = found.geometry.values()
    normals = face_normals(X.vertices, X.faces)
    assert ((found.vertex_normals[X.faces[:, 0]] * normals).sum(1) > 0).mean() > 0.98


def test_values_are_attributes_of_the_vertices(tmp_path):
    values = dict(zip(("confidence", "membership"), np.eye(2, N_X) + 0.5, strict=True))
    for suffix in (".ply", ".glb", ".obj"):
        path = tmp_path / f"x{suffix}"
        export_map(path, X, Y, T_XY, values=values)
        np.testing.assert_array_equal(read(path).faces, X.faces)
    found = meshio.read(tmp_path / "x.ply").point_data
    gltf, blob = gltf_of(tmp_path / "x.glb")
    for name, wanted in values.items():
        np.testing.assert_array_equal(found[name], wanted)
        attributes = gltf.meshes[0].primitives[0].attributes
        accessor = gltf.accessors[getattr(attributes, f"_{name.upper()}")]
        start = gltf.bufferViews[accessor.bufferView].byteOffset
        assert accessor.type == "SCALAR" and accessor.count == N_X
        np.testing.assert_array_equal(np.frombuffer(blob, "<f4", N_X, start), wanted)
    for bad in (np.ones(N_X - 1), np.full(N_X, np.nan)):
        with pytest.raises(ValueError, match="export_mesh: confidence"):
            export_mesh(tmp_path / "bad.ply", X, values={"confidence": bad})


def test_up_is_that_of_the_colours(tmp_path):
    standing = coordinate_colours(Y.vertices)[T_XY]
    lying = Y._replace(vertices=Y.vertices[:, [0, 2, 1]] * [1, -1, 1])
    export_map(tmp_path / "x.ply", X, lying, T_XY, up="z")
    np.testing.assert_allclose(by_trimesh(tmp_path / "x.ply")[2], standing, atol=BYTE)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_plain_meshes_and_point_clouds(suffix, tmp_path):
    cloud = X._replace(faces=X.faces[:0])
    for mesh, colours in itertools.product((X, cloud), (None, COLOURS)):
        path = tmp_path / f"a{suffix}"
        export_mesh(path, mesh, colours=colours)
        found = read(path)
        np.testing.assert_allclose(found.vertices, X.vertices, rtol=1e-7)
        np.testing.assert_array_equal(found.faces, mesh.faces)
        assert not os.path.exists(tmp_path / "a_checker.png")
        if suffix != ".obj":  # trimesh reads no points of OBJ
            loaded = trimesh.load(path, process=False)
            if isinstance(loaded, trimesh.Scene):
                (loaded,) = loaded.geometry.values()
            assert len(loaded.vertices) == N_X


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_failed_writes_leave_the_old_file(suffix, tmp_path, monkeypatch):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="disk full"):
        export_mesh(path, X, colours=COLOURS)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"]


@pytest.mark.parametrize(
    ("path", "change", "message"),
    [
        ("a.off", {}, "a.off: a mesh is exported as .ply, .obj, .glb, not '.off'"),
        ("a.ply", {"checker": True}, "a.ply: PLY has no texture here"),
        ("a.ply", {"T_xy": np.zeros(N_Y, int)}, f"X has {N_X} vertices, T_xy"),
        ("a.ply", {"T_xy": T_XY + 1}, f"from 1 to {N_Y}"),
        ("a.ply", {"T_xy": T_XY * 1.0}, "float64"),
        ("a.ply", {"up": "w"}, "-z; got 'w'"),
        ("a.obj", {"mesh_x": X._replace(faces=X.faces[:0])}, "cloud has no texture"),
        ("a.obj", {"mesh_x": X._replace(faces=X.faces + 2)}, f"names vertex {N_X}"),
    ],
)
def test_wrong_input_is_named_and_nothing_is_written(path, change, message, tmp_path):
    given = {"mesh_x": X, "mesh_y": Y, "T_xy": T_XY, "checker": path == "a.obj"}
    with pytest.raises(ValueError, match=message):
        export_map(tmp_path / path, **given | change)
    assert not list(tmp_path.iterdir())


def test_wrong_colours_are_named(tmp_path):
    for colours, message in (
        (COLOURS[1:], rf"colours has shape \({N_X - 1}, 3\)"),
        (COLOURS * 255, r"colours run from .*; pass sRGB in \[0, 1\]"),
        (COLOURS * np.nan, "at vertex 0: .*pass finite numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            export_mesh(tmp_path / "a.ply", X, colours=colours)
    with pytest.raises(ValueError, match=rf"uv has shape \({N_X}, 3\)"):
        export_mesh(tmp_path / "a.glb", X, uv=X.vertices)
    with pytest.raises(MeshError, match="0 vertices"):
        export_mesh(tmp_path / "a.ply", Mesh(X.vertices[:0], X.faces[:0]))
    with pytest.raises(OSError):
        export_mesh(tmp_path / "no" / "a.ply", X)


def test_exports_need_neither_matplotlib_nor_pillow(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "PIL", None)
    export_map(tmp_path / "a.glb", X, Y, T_XY, checker=True)
    assert (tmp_path / "a.glb").stat().st_size < 500_000
