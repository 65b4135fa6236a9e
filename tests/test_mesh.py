"""Reading meshes in every format, refusing bad ones, examining and mending them."""

import base64
import json
import os
import re
import struct
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import shortest_path

from jfsf.mesh import (
    MeshError,
    check,
    largest_component,
    orient,
    read,
    surface_area,
    validate,
    weld,
)
from jfsf.mesh._geometry import (
    boundary_edges,
    components,
    edge_graph,
    edges,
    face_areas,
    face_normals,
    farthest_vertices,
    vertex_areas,
    vertex_components,
    vertex_normals,
)
from jfsf.mesh._polygons import triangulate
from jfsf.types import Mesh

DATA = Path(os.environ.get("JFSF_DATA", "data"))


def sphere(subdivisions=2, centre=(0.0, 0.0, 0.0), radius=1.0):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh(np.asarray(ball.vertices) + centre, np.asarray(ball.faces, np.int32))


def together(*meshes):
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(faces).astype(np.int32),
    )


def cloud(vertices):
    return Mesh(np.asarray(vertices, float), np.zeros((0, 3), np.int32))


def moebius(n=12):
    angle = 2 * np.pi * np.arange(n) / n
    turn = [np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle)]
    side = np.stack([*turn, np.sin(angle / 2)], axis=1) / 3
    middle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    ring = np.arange(n)
    # After one turn top and bottom change places.
    top, bottom = np.append(ring, n), np.append(ring + n, 0)
    faces = [(top[i], bottom[i], top[i + 1]) for i in range(n)]
    faces += [(top[i + 1], bottom[i], bottom[i + 1]) for i in range(n)]
    points = np.concatenate([middle + side, middle - side])
    return Mesh(points, np.array(faces, np.int32))


def same(mesh, vertices, faces):
    assert mesh.vertices.dtype == np.float64 and mesh.faces.dtype == np.int32
    assert np.array_equal(mesh.vertices, np.reshape(vertices, (-1, 3)))
    assert np.array_equal(mesh.faces, np.reshape(faces, (-1, 3)))


def split(vertices, polygons):
    corners = [v for polygon in polygons for v in polygon]
    return triangulate([len(p) for p in polygons], corners, vertices)


# Writers of the ugliest legal files: every extra that a reader could trip over.


def rows(table, pattern):
    return [pattern.format(*row) for row in np.asarray(table).tolist()]


def polygon_rows(polygons, end=""):
    return [" ".join(map(str, (len(p), *p))) + end for p in polygons]


def write_off(vertices, polygons):
    head = [
        "# made by hand",
        "OFF  # of course",
        "",
        f"{len(vertices)} {len(polygons)} 0",
    ]
    body = rows(vertices, "  {!r} {!r} {!r}") + polygon_rows(polygons)
    return "\n".join(head + body).encode()


def write_coff(vertices, polygons):
    head = [f"COFF {len(vertices)} {len(polygons)} 0"]
    body = rows(vertices, "{!r} {!r} {!r} 255 0 7 255")
    return "\r\n".join(head + body + ["", *polygon_rows(polygons, " 9 9 9")]).encode()


def write_modelnet(vertices, polygons):
    body = rows(vertices, "{!r}\t{!r} {!r}") + polygon_rows(polygons)
    return "\n".join([f"OFF{len(vertices)} {len(polygons)} 0", *body, "", ""]).encode()


def write_obj(vertices, polygons):
    lines = ["mtllib none.mtl", "o caf\xe9", "vn 0 0 1", "vn 0 1 0"]
    lines += ["vt 0 0", "vt 1 1", *rows(vertices, "v {!r} {!r} {!r} 0.1 0.2 0.3")]
    for i, polygon in enumerate(polygons):
        corners = [
            (
                f"{v + 1}",
                f"{v + 1}/{1 + i % 2}",
                f"{v + 1}//{1 + i % 2}",
                f"{v + 1}/1/2",
            )[(i + j) % 4 if i % 3 else i % 4]
            for j, v in enumerate(polygon)
        ]
        lines += [
            f"usemtl m{i % 2}",
            f"g part{i % 3}",
            "s off",
            "f " + " ".join(corners),
        ]
    return "\n".join(lines).encode("latin-1")


def write_obj_negative(vertices, polygons):
    lines = rows(vertices, "v {!r} {!r} {!r}")
    for polygon in polygons:
        lines.append("f " + " \\\n".join(str(v - len(vertices)) for v in polygon))
    return "\r\n".join(lines).encode() + b"\n"


def ply_header(kind, vertices, polygons, scalar="double"):
    return (
        f"ply\nformat {kind} 1.0\ncomment TextureFile skin.png\n"
        f"element vertex {len(vertices)}\nproperty uchar red\nproperty {scalar} x\n"
        f"property {scalar} y\nproperty {scalar} z\nproperty float s\n"
        "property float t\nelement strange 1\nproperty list uchar short many\n"
        f"element face {len(polygons)}\nproperty list uchar int vertex_indices\n"
        "property list uchar float texcoord\nproperty int flags\nend_header\n"
    ).encode()


def write_ply(vertices, polygons):
    lines = rows(vertices, "255 {!r} {!r} {!r} 0.5 0.25") + ["2 8 9"]
    lines += [row + " 2 0.5 0.25 7" for row in polygon_rows(polygons)]
    return ply_header("ascii", vertices, polygons) + "\n".join(lines).encode()


def write_ply_binary(vertices, polygons, order="<"):
    name = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = b"".join(struct.pack(order + "B3d2f", 9, *v, 0.5, 0.5) for v in vertices)
    body += struct.pack(order + "B2h", 2, 8, 9)
    for p in polygons:
        body += struct.pack(f"{order}B{len(p)}iB2fi", len(p), *p, 2, 0.1, 0.2, 7)
    return ply_header(name, vertices, polygons) + body


WRITERS = {
    "off": (".off", write_off),
    "coff": (".off", write_coff),
    "modelnet": (".OFF", write_modelnet),
    "obj": (".obj", write_obj),
    "negative obj": (".obj", write_obj_negative),
    "ply": (".ply", write_ply),
    "binary ply": (".ply", write_ply_binary),
    "big-endian ply": (".ply", lambda v, p: write_ply_binary(v, p, ">")),
}


@st.composite
def shapes(draw, most=5):
    """Points with copies and strays among them, and polygons of 3 to `most` corners."""
    n = draw(st.integers(6, 12))
    number = st.floats(-1e3, 1e3, allow_nan=False)
    vertices = draw(st.lists(st.tuples(number, number, number), min_size=n, max_size=n))
    vertices[draw(st.integers(1, n - 1))] = vertices[0]
    corner = st.lists(st.integers(0, n - 1), min_size=3, max_size=most, unique=True)
    return np.array(vertices), draw(st.lists(corner, max_size=6))


@pytest.mark.parametrize("name", WRITERS)
@given(shape=shapes(), seed=st.integers(0, 99))
def test_every_vertex_keeps_its_number(tmp_path_factory, name, shape, seed):
    vertices, polygons = shape
    new = np.random.default_rng(seed).permutation(len(vertices))
    path = tmp_path_factory.mktemp("mesh") / f"a{WRITERS[name][0]}"
    moved = np.empty_like(vertices)
    moved[new] = vertices
    polygons = [[int(new[v]) for v in polygon] for polygon in polygons]
    path.write_bytes(WRITERS[name][1](moved, polygons))
    same(read(path), moved, split(moved, polygons))


@pytest.mark.parametrize("name", WRITERS)
@given(shape=shapes(most=3))
def test_triangles_alone_are_read_too(tmp_path_factory, name, shape):
    path = tmp_path_factory.mktemp("mesh") / f"a{WRITERS[name][0]}"
    path.write_bytes(WRITERS[name][1](*shape))
    same(read(str(path)), shape[0], shape[1])


def test_obj_counts_back_from_the_last_vertex_so_far(tmp_path):
    path = tmp_path / "a.obj"
    path.write_bytes(OBJ + b"f -3 -2 -1\nv 0 0 1\nf -1 -2 -4 # last\n")
    same(read(path), [*np.zeros((1, 3)), *np.eye(3)], [[0, 1, 2], [3, 2, 0]])


@pytest.mark.parametrize("binary", [False, True])
def test_stl_welds_equal_points_in_order(tmp_path, binary):
    box = trimesh.creation.box()
    kind = "stl" if binary else "stl_ascii"
    path = tmp_path / "box.stl"
    box.export(path, file_type=kind)
    mesh = read(path)
    corners = np.asarray(box.triangles).reshape(-1, 3)
    assert len(mesh.vertices) == 8
    assert np.array_equal(mesh.vertices[mesh.faces.ravel()], corners)
    # Numbered in the order in which the faces name them.
    _, first = np.unique(mesh.faces, return_index=True)
    assert (np.diff(first) > 0).all()
    assert check(mesh).outward


def test_ascii_stl_with_hostile_names(tmp_path):
    path = tmp_path / "a.stl"
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    one = facet.format("vertex 0 0 0\nVERTEX 1 0 0\n vertex 0 1 0\n")
    two = facet.format("vertex 0 1 0\nvertex -0 0 0\nvertex 0 0 1\n")
    path.write_text(
        f"solid my vertex normal\n{one}endsolid\nsolid b\n{two}endsolid b\n"
    )
    same(
        read(path), [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [2, 0, 3]]
    )


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_gltf_scene_keeps_order_and_moves_parts(tmp_path, suffix):
    parts = [sphere(0), sphere(1), sphere(0)]
    scene = trimesh.Scene()
    moves = []
    for i, part in enumerate(parts):
        # Unreferenced and repeated vertices must survive; the last part is mirrored.
        vertices = np.concatenate([[[9, 9, 9]], part.vertices, part.vertices[:1]])
        parts[i] = Mesh(vertices.astype(np.float32).astype(float), part.faces + 1)
        moves.append(np.diag([1.0, 1, -1 if i == 2 else 1, 1]))
        moves[-1][:3, 3] = [4 * i, 0, 0.5]
        scene.add_geometry(
            trimesh.Trimesh(*parts[i], process=False),
            # Names out of order: the order of the file counts, not theirs.
            geom_name=f"part {2 - i}",
            transform=moves[-1],
        )
    files = scene.export(file_type=suffix[1:])
    path = tmp_path / f"model{suffix}"
    for name, content in (files if isinstance(files, dict) else {path: files}).items():
        (tmp_path / name).write_bytes(content)
    mesh = read(path)
    moved = [
        p.vertices @ m[:3, :3].T + m[:3, 3] for p, m in zip(parts, moves, strict=True)
    ]
    expect = together(*map(Mesh, moved, [part.faces for part in parts]))
    assert np.allclose(mesh.vertices, expect.vertices, rtol=0, atol=1e-12)
    assert np.array_equal(np.sort(mesh.faces), np.sort(expect.faces))
    assert check(mesh).outward
    assert np.array_equal(read(path).vertices, mesh.vertices)


def test_gltf_morph_targets_without_weight_are_left_out(tmp_path):
    path = tmp_path / "a.gltf"
    targets = {"targets": [{"POSITION": 2}]}
    path.write_bytes(gltf(other={"bufferView": 0}, part=targets, node={"weights": [0]}))
    np.testing.assert_array_equal(read(path).vertices, np.eye(3))


def test_gltf_points_are_a_cloud(tmp_path):
    points = np.arange(12.0).reshape(4, 3)
    path = tmp_path / "a.glb"
    path.write_bytes(trimesh.Scene(trimesh.PointCloud(points)).export(file_type="glb"))
    same(read(path), points, [])


OFF = b"OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 2\nproperty list uchar int vertex_indices\n"
    b"end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"
)
PLYB = write_ply_binary(np.eye(3), [[0, 1, 2]])
# Conversion to float64 makes numpy warn of this one.
SIGNALLING, ONE = struct.pack("<I", 0x7FA00000), struct.pack("<f", 1)
PLYB_FLOAT = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
    b"property float y\nproperty float z\nend_header\n"
) + np.eye(3, dtype="<f4").tobytes()
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
STL = bytes(trimesh.creation.box().export(file_type="stl"))  # type: ignore
STLA = b"solid\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
GLB = bytes(trimesh.Scene(trimesh.creation.box()).export(file_type="glb"))  # type: ignore
HALF = struct.pack("<f", 0.5)
GLB_NAN = GLB.replace(HALF, SIGNALLING)


def gltf(position=None, indices=None, other=None, part=None, node=None):
    """A triangle, with changes to its accessors, its part of the mesh and its node."""
    data = np.eye(3, dtype="<f4").tobytes() + np.arange(3, dtype="<u2").tobytes()
    vector = {"componentType": 5126, "type": "VEC3", "count": 3}
    number = {"componentType": 5123, "type": "SCALAR", "count": 3}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    scene = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **(node or {})}],
        "meshes": [{"primitives": [primitive | (part or {})]}],
        "accessors": [
            {**vector, "bufferView": 0} if position is None else vector | position,
            {**number, "bufferView": 1} if indices is None else number | indices,
            {**vector, **(other or {})},  # a morph's, without data
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "buffers": [
            {
                "byteLength": 42,
                "uri": "data:application/octet-stream;base64,"
                + base64.b64encode(data).decode(),
            }
        ],
    }
    return json.dumps(scene).encode()


SPARSE = {"sparse": {"count": 1}, "bufferView": 0}


BROKEN = {
    "empty": ("a.off", b"", "empty"),
    "blank": ("a.obj", b" \n\n", "empty"),
    "unknown suffix": ("a.abc", OFF, "'.abc'; convert"),
    "no suffix": ("a", OFF, "''; convert"),
    "garbage off": ("a.off", bytes(range(256)), "not OFF"),
    "only comments": ("a.off", b"# hello\n", "not OFF"),
    "garbage obj": ("a.obj", bytes(range(256)), "0 vertices"),
    "garbage ply": ("a.ply", bytes(range(256)), "PLY header"),
    "garbage stl": ("a.stl", bytes(range(256)), "triangles in"),
    "garbage glb": ("a.glb", bytes(range(256)), "readable GLB"),
    "garbage gltf": ("a.gltf", b"{", "readable GLTF"),
    "off without counts": ("a.off", b"OFF\n", "counts"),
    "off with bad counts": (
        "a.off",
        OFF.replace(b"4 2", b"-4 2"),
        "counts are '-4 2 0'",
    ),
    "off in 4D": ("a.off", b"4" + OFF, "is 4OFF"),
    "binary off": ("a.off", OFF.replace(b"OFF", b"OFF BINARY"), "OFF BINARY"),
    "off lacks a face": ("a.off", OFF[:-8], "4 vertices and 2 faces, but 5 lines"),
    "off lacks a vertex": ("a.off", OFF.replace(b"0 0 1\n", b""), "but 5 lines"),
    "off has more": ("a.off", OFF + b"3 1 2 3\n", "but 7 lines"),
    "off cut in a face": ("a.off", OFF[:-3], "face 1 is cut short to '3 0 1'"),
    "off cut in a vertex": ("a.off", OFF.replace(b"1 0 0", b"1 0"), "vertex 1 has 2"),
    "off with words": ("a.off", OFF.replace(b"1 0 0", b"1 x 0"), "'x'"),
    "ply header cut": ("a.ply", PLY[:60], "header"),
    "ply of no format": ("a.ply", PLY.replace(b"ascii", b"morse"), "no known format"),
    "ply of no type": ("a.ply", PLY.replace(b"uchar", b"quark"), "'quark'"),
    "ply lacks a face": ("a.ply", PLY[:-8], "6 lines, but 5"),
    "ply lacks a vertex": ("a.ply", PLY.replace(b"0 0 1\n", b""), "6 lines, but 5"),
    "ply has more": ("a.ply", PLY + b"3 1 2 3", "6 lines, but 7"),
    "ply cut in a face": ("a.ply", PLY[:-3], "2 of element 'face'"),
    "ply lacks z": ("a.ply", PLY.replace(b"float z", b"float q"), "lack x, y or z"),
    "ply lacks faces": (
        "a.ply",
        PLY.replace(b"_indices", b"_colour"),
        "lack vertex_ind",
    ),
    "ply of strips": ("a.ply", PLY.replace(b"face", b"tristrips"), "strips"),
    "ply with half indices": ("a.ply", PLY.replace(b"3 0 1 2", b"3 0 1.5 2"), "1.5"),
    "binary ply has more": ("a.ply", PLYB + b"\0", "but the last 1 bytes"),
    "binary ply of fewer faces": (
        "a.ply",
        write_ply_binary(np.eye(3), [[0, 1, 2]] * 320).replace(
            b"element face 320", b"element face 1"
        ),
        "but the last 8294 bytes",
    ),
    "binary ply without its faces' line": (
        "a.ply",
        re.sub(b"element face .*\n", b"", PLYB),
        "element 'strange' has corners",
    ),
    "binary ply of vertices with corners": (
        "a.ply",
        re.sub(b"element (strange|face) .*\n", b"", PLYB),
        "element 'vertex' has corners",
    ),
    "ply of fewer faces": (
        "a.ply",
        PLY.replace(b"face 2", b"face 1").replace(b"3 0 1 2\n3", b"3 0 1 2 3"),
        "but the last 32 bytes",
    ),
    "ply of another element": (
        "a.ply",
        PLY.replace(b"element face 2", b"element 1// 2"),
        "element '1//' has corners",
    ),
    "ply of a negative count": (
        "a.ply",
        PLY.replace(b"face 2", b"face -2"),
        "line 'element face -2'",
    ),
    "ply of a damaged line": (
        "a.ply",
        PLY.replace(b"property float y", b"propert! float y"),
        "line 'propert! float y'",
    ),
    "ply of two x": ("a.ply", PLY.replace(b"float y", b"float x"), "property 'x'"),
    "ply of two faces": (
        "a.ply",
        PLY.replace(b"element vertex", b"element face"),
        "two of element 'face'",
    ),
    "ply of property first": (
        "a.ply",
        PLY.replace(b"element vertex 4\n", b""),
        "line 'property float x'",
    ),
    "binary ply cut": ("a.ply", PLYB[:-1], "1 of element 'face'"),
    "binary ply cut early": ("a.ply", PLYB[:-60], "3 of element 'vertex'"),
    "binary stl cut": ("a.stl", STL[:-1], "12 triangles in 684 bytes, but it has 683"),
    "ascii stl cut": ("a.stl", STLA, "endsolid"),
    "ascii stl of two": (
        "a.stl",
        STLA.replace(b"vertex 0 0 0\n", b"") + b"endsolid",
        "2 c",
    ),
    "glb cut": ("a.glb", GLB[:-10], "readable GLB"),
    "gltf without vertices": ("a.gltf", gltf({}), "compressed or sparse; export it un"),
    "gltf without faces": ("a.gltf", gltf(indices={}), "compressed or sparse"),
    "gltf of sparse vertices": ("a.gltf", gltf(SPARSE), "compressed or sparse"),
    "gltf of draco": (
        "a.gltf",
        gltf({}, part={"extensions": {"KHR_draco_mesh_compression": {}}}),
        "compressed or sparse",
    ),
    "gltf of normalised positions": (
        "a.gltf",
        gltf({"bufferView": 0, "componentType": 5123, "normalized": True}),
        r"normalised integers .*dequantize",
    ),
    "gltf with a skin": ("a.gltf", gltf(node={"skin": 0}), "a skin, .* Armature mod"),
    "gltf with a morph": (
        "a.gltf",
        gltf(part={"targets": [{"POSITION": 2}]}, node={"weights": [0, 0.5]}),
        "morph targets, .* apply all shape keys",
    ),
    "gltf of more zeros than memory": (
        "a.gltf",
        gltf(other={"count": 10**12}),
        "accessor 2 announces 1000000000000 items without data",
    ),
    "underscore, off": ("a.off", OFF.replace(b"3 0 1 3", b"3 0 1 0_3"), "'0_3' for a"),
    "underscore, obj": ("a.obj", OBJ + b"v 1_0 0 0", "'1_0' for a number"),
    "underscore, obj face": ("a.obj", OBJ + b"f 1 2 0_3", "'0_3' for a number"),
    "underscore, ply": ("a.ply", PLY.replace(b"1 0 0", b"1_0 0 0"), "'1_0' for a"),
    "underscore, stl": (
        "a.stl",
        STLA.replace(b"1 0 0", b"1_0 0 0") + b"endsolid a_b",
        "'1_0' for a number",
    ),
    "face of two": (
        "a.off",
        OFF.replace(b"3 0 1 2", b"2 0 1"),
        "face 0 has 2 vertices",
    ),
    "face of two, ply": ("a.ply", PLY.replace(b"3 0 1 2", b"2 0 1"), "face 0 has 2"),
    "face of two, obj": ("a.obj", OBJ + b"f 1 2 3\nf 1 2", "face 1 has 2 vertices"),
    "face of minus one": (
        "a.off",
        OFF.replace(b"3 0 1 2", b"-1 0 1"),
        "has -1 vertices",
    ),
    "index out": ("a.off", OFF.replace(b"3 0 1 2", b"3 0 1 4"), "vertex 4, but the 4"),
    "index huge": (
        "a.off",
        OFF.replace(b"3 0 1 2", b"3 0 1 9" + b"9" * 30),
        "readable",
    ),
    "index negative": ("a.off", OFF.replace(b"3 0 1 2", b"3 0 1 -1"), "vertex -1, but"),
    "index out, ply": ("a.ply", PLY.replace(b"3 0 1 2", b"3 0 1 4"), "vertex 4"),
    "index out, obj": ("a.obj", OBJ + b"f 1 2 4", "vertex 3, but the 3"),
    "index 0, obj": ("a.obj", OBJ + b"f 0 1 2", "'f 0 1 2' after 3 vertices"),
    "index -4, obj": ("a.obj", OBJ + b"f -4 -1 -2", "'f -4 -1 -2' after 3 vertices"),
    "nan": ("a.off", OFF.replace(b"1 0 0", b"nan 0 0"), r"vertex 1 is \[nan, 0.0"),
    "nan corner, ply": (
        "a.ply",
        PLY.replace(b"3 0 1 2", b"3 nan 1 2"),
        "a face names vertex nan",
    ),
    "infinite corner, ply": ("a.ply", PLY.replace(b"3 0 1 2", b"3 1e99 1 2"), "1e.99"),
    "signalling nan, ply": (
        "a.ply",
        PLYB_FLOAT.replace(ONE, SIGNALLING, 1),
        r"vertex 0 is \[nan, 0",
    ),
    "signalling nan, stl": (
        "a.stl",
        STL[:96] + SIGNALLING + STL[100:],
        r"is \[nan, .* 1 of 9 are not finite",
    ),
    "nan, glb": ("a.glb", GLB_NAN, r"is \[nan, .* not finite"),
    "infinite": ("a.obj", OBJ + b"v 0 -inf 0\n", r"-inf, 0.0\], 1 of 4"),
    "overflow": ("a.obj", OBJ + b"v 0 1e999 0\n", "inf"),
    "nan, stl": ("a.stl", STLA.replace(b"1 0", b"nan 0") + b"endsolid", "not finite"),
    "no vertices": ("a.off", b"OFF 0 0 0", "0 vertices"),
    "no vertices, ply": ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "0 vertices"),
    "no triangles, stl": ("a.stl", bytes(84), "empty|0 triangles"),
    "nothing, gltf": ("a.gltf", b'{"asset": {"version": "2.0"}}', "GLTF|0 vertices"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_refused(tmp_path, name):
    file, content, message = BROKEN[name]
    path = tmp_path / file
    path.write_bytes(content)
    with pytest.raises(MeshError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "; " in str(caught.value)


def test_gltf_by_hand_is_read(tmp_path):
    (tmp_path / "a.gltf").write_bytes(gltf())
    same(read(tmp_path / "a.gltf"), np.eye(3), [0, 1, 2])


def test_a_binary_ply_may_end_in_line_ends(tmp_path):
    (tmp_path / "a.ply").write_bytes(PLYB + b"\r\n")
    same(read(tmp_path / "a.ply"), np.eye(3), [0, 1, 2])


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(MeshError, match="does not exist"):
        read(tmp_path / "none.off")
    (tmp_path / "folder.off").mkdir()
    with pytest.raises(MeshError, match="is a folder"):
        read(tmp_path / "folder.off")


@given(st.sampled_from([OFF, PLY, PLYB, OBJ + b"f 1 2 3", STL, GLB]), st.data())
def test_a_cut_file_is_refused_or_shorter_but_sound(tmp_path_factory, content, data):
    cut = content[: data.draw(st.integers(0, len(content) - 1))]
    suffix = {OFF: "off", PLY: "ply", PLYB: "ply", STL: "stl", GLB: "glb"}
    path = tmp_path_factory.mktemp("cut") / f"a.{suffix.get(content, 'obj')}"
    path.write_bytes(cut)
    try:
        mesh = read(path)
    except MeshError:
        return
    # OBJ announces nothing, and a text may lose its last line end or a last digit.
    assert content.startswith((OBJ, b"OFF", b"ply\nformat ascii"))
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.max(initial=0) < len(mesh.vertices)


def stray(mesh):
    return Mesh(np.append(mesh.vertices, [[5.0, 5, 5]], axis=0), mesh.faces)


BALL = sphere(1)
REFUSED = {
    "flat array": (Mesh(np.zeros(3), BALL.faces), {}, "pass .n, 3."),
    "scalar": (Mesh(3.0, BALL.faces), {}, "pass .n, 3."),
    "complex": (Mesh(BALL.vertices * 1j, BALL.faces), {}, "complex128"),
    "quads": (
        Mesh(BALL.vertices, np.zeros((2, 4), int)),
        {},
        r"faces are int64 \(2, 4\)",
    ),
    "real faces": (Mesh(BALL.vertices, BALL.faces * 1.0), {}, "faces are float64"),
    "nan": (Mesh(BALL.vertices * np.nan, BALL.faces), {}, "not finite"),
    "out of range": (Mesh(BALL.vertices[:5], BALL.faces), {}, "0 to 4"),
    "negative": (Mesh(BALL.vertices, BALL.faces - 1), {}, "vertex -1"),
    "no vertices": (cloud(np.zeros((0, 3))), {}, "0 vertices"),
    "too few": (BALL, {"k": 43}, "42 vertices, fewer than the 43 eigenpairs"),
    "too few points": (cloud(BALL.vertices), {"k": 43}, "42 vertices, fewer"),
    "one point": (cloud(np.ones((9, 3))), {}, "coincide"),
    "no area": (Mesh(BALL.vertices * [1, 0, 0], BALL.faces), {}, "area of its 80"),
    "line": (Mesh(BALL.vertices[:, [0, 0, 0]] + 0.1, BALL.faces), {}, "area of its"),
    "stray vertex": (stray(BALL), {}, "vertex 42 belongs to no face; remove it"),
    "stray, pieces fine": (stray(BALL), {"components": False}, "vertex 42"),
    "two pieces": (together(BALL, BALL), {}, "2 connected components"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_meaningless_meshes_are_refused(name):
    mesh, options, message = REFUSED[name]
    with pytest.raises(MeshError, match=message) as caught:
        validate(mesh, name="mesh_x", **options)
    assert str(caught.value).startswith("mesh_x: ")


@pytest.mark.parametrize("scale", [1e-150, 1e-9, 1.0, 1e200])
def test_sound_meshes_pass_at_any_scale(scale):
    mesh = Mesh((BALL.vertices + 2) * scale, BALL.faces)
    validate(mesh, k=42)
    validate(together(mesh, mesh), components=False)
    validate(cloud(mesh.vertices), k=42)


@given(st.data())
def test_components_equal_the_slow_oracle(data):
    n = data.draw(st.integers(1, 9))
    node = st.integers(0, n - 1)
    joined = data.draw(st.lists(st.tuples(node, node), max_size=9))
    label = np.arange(n)
    for _ in range(n):
        for a, b in joined:
            label[[a, b]] = min(label[a], label[b])
    left, right = np.array(joined, int).reshape(-1, 2).T
    found = components(n, left, right)
    assert np.array_equal(found, np.unique(label, return_inverse=True)[1])


def slow_report(mesh):
    """The combinatorial fields of check, in dictionaries and loops."""
    faces = mesh.faces.tolist()
    group = {v: {v} for face in faces for v in face}
    for face in faces:
        merged = set().union(*(group[v] for v in face))
        group.update({v: merged for v in merged})
    solid = [f for f in faces if len(set(f)) == 3]
    edges, directed = defaultdict(list), defaultdict(int)
    for i, f in enumerate(solid):
        for j in range(3):
            edges[frozenset((f[j], f[j - 2]))].append(i)
            directed[f[j], f[j - 2]] += 1
    pinched = 0
    for v in {v for f in solid for v in f}:
        fans = {i: {i} for i, f in enumerate(solid) if v in f}
        for edge, owners in edges.items():
            if v in edge:
                merged = set().union(*(fans[i] for i in owners))
                fans.update({i: merged for i in merged})
        pinched += len({frozenset(fan) for fan in fans.values()}) > 1
    counts = [len(owners) for owners in edges.values()]
    return {
        "components": len({frozenset(piece) for piece in group.values()}),
        "boundary_edges": counts.count(1),
        "nonmanifold_edges": sum(count > 2 for count in counts),
        "nonmanifold_vertices": pinched,
        "unreferenced_vertices": len(mesh.vertices) - len(group),
        "degenerate_faces": len(faces) - len(solid),
        "duplicate_faces": len(faces) - len({tuple(sorted(f)) for f in faces}),
        "closed": bool(solid) and all(count == 2 for count in counts),
        "consistent": all(count == 1 for count in directed.values()),
    }


@st.composite
def soups(draw):
    """Random faces on few vertices in general position: every defect turns up."""
    n = draw(st.integers(3, 9))
    corner = st.integers(0, n - 1)
    faces = draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=14))
    points = np.random.default_rng(n).normal(size=(n, 3))
    return Mesh(points, np.array(faces, np.int32))


@given(soups())
def test_check_equals_the_slow_oracle(mesh):
    report = check(mesh)
    slow = slow_report(mesh)
    assert {name: getattr(report, name) for name in slow} == slow


@given(st.integers(0, 99))
def test_check_ignores_the_numbering(seed):
    rng = np.random.default_rng(seed)
    mesh = together(sphere(1), moebius())
    new = rng.permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[new] = mesh.vertices
    faces = new[mesh.faces][rng.permutation(len(mesh.faces))]
    report, plain = check(Mesh(vertices, faces)), check(mesh)
    assert report.area == pytest.approx(plain.area)
    assert report._replace(area=plain.area) == plain


@given(soups())
def test_edges_and_components_equal_the_slow_oracle(mesh):
    count = defaultdict(int)
    for face in mesh.faces.tolist():
        for i in range(3):
            if face[i] != face[i - 1]:
                count[tuple(sorted((face[i], face[i - 1])))] += 1
    ends, counts = edges(mesh.faces)
    assert list(map(tuple, ends.tolist())) == sorted(count)
    assert counts.tolist() == [count[edge] for edge in sorted(count)]
    n = len(mesh.vertices)
    assert np.array_equal(vertex_components(mesh.faces, n), components(n, *ends.T))


def test_areas_and_normals_agree_with_trimesh():
    mesh = together(sphere(1, radius=2.0), moebius())
    other = trimesh.Trimesh(*mesh, process=False)
    areas, normals = face_areas(*mesh), face_normals(*mesh)
    assert np.allclose(areas, other.area_faces, rtol=1e-12)
    assert np.allclose(normals, 2 * areas[:, None] * other.face_normals, atol=1e-12)
    assert surface_area(mesh) == pytest.approx(other.area)
    points = cloud(mesh.vertices)
    assert surface_area(points) == 0
    assert edges(points.faces).ends.shape == (0, 2)
    assert np.array_equal(vertex_components(points.faces, 3), [0, 1, 2])


def test_vertices_have_the_areas_and_normals_of_their_faces():
    mesh = together(sphere(1, radius=2.0), moebius())
    stray = Mesh(np.append(mesh.vertices, [[9, 9, 9]], axis=0), mesh.faces)
    areas, normals = face_areas(*stray), face_normals(*stray)
    own = [(stray.faces == i).any(1) for i in range(len(stray.vertices))]
    assert np.allclose(vertex_areas(*stray), [areas[at].sum() / 3 for at in own])
    total = np.array([normals[at].sum(0) for at in own])
    assert np.allclose(
        vertex_normals(*stray) * np.linalg.norm(total, axis=1)[:, None],
        total,
        atol=1e-12,
    )
    assert not vertex_normals(*stray)[-1].any()
    none = cloud(mesh.vertices)
    assert not vertex_areas(*none).any() and not vertex_normals(*none).any()


@given(mesh=soups())
def test_boundary_edges_run_as_in_their_only_face(mesh):
    runs = np.stack([mesh.faces, np.roll(mesh.faces, -1, 1)], 2).reshape(-1, 2)
    runs = [tuple(run) for run in runs.tolist() if run[0] != run[1]]
    alone = [(a, b) for a, b in runs if runs.count((a, b)) + runs.count((b, a)) == 1]
    assert sorted(map(tuple, boundary_edges(mesh.faces).tolist())) == sorted(alone)


def test_each_vertex_is_the_farthest_from_those_before():
    mesh = sphere(1)
    graph = edge_graph(mesh)
    between = shortest_path(graph, directed=False)
    chosen = farthest_vertices(mesh, 10, start=3)
    assert chosen[0] == 3 and len(set(chosen)) == 10
    for i in range(1, 10):
        far = between[chosen[:i]].min(0)
        assert far[chosen[i]] == pytest.approx(far.max())


def test_check_agrees_with_trimesh():
    mesh = together(sphere(2, radius=2.0), sphere(1, (9.0, 0, 0)))
    report, other = check(mesh), trimesh.Trimesh(*mesh, process=False)
    assert (report.closed, report.consistent) == (True, other.is_winding_consistent)
    assert report.area == pytest.approx(other.area)
    assert report.volume == pytest.approx(other.volume)
    assert report.components == other.body_count == 2
    assert report.outward


def test_check_sees_each_side_of_winding():
    ball = sphere(1)
    inside_out = Mesh(ball.vertices, ball.faces[:, ::-1])
    assert check(ball).outward is True
    assert check(inside_out).outward is False
    assert check(together(ball, inside_out)).outward is False
    one_wrong = ball.faces.copy()
    one_wrong[3] = one_wrong[3, ::-1]
    report = check(Mesh(ball.vertices, one_wrong))
    assert (report.consistent, report.outward, report.volume) == (False, None, None)
    holed = check(Mesh(ball.vertices, ball.faces[1:]))
    assert (holed.closed, holed.outward, holed.boundary_edges) == (False, None, 3)
    # Two faces back to back close a surface around nothing.
    pillow = Mesh(np.eye(3), np.array([[0, 1, 2], [2, 1, 0]], np.int32))
    assert (check(pillow).closed, check(pillow).outward) == (True, None)


def test_check_counts_needles_and_clouds():
    line = np.array([[0, 0, 0], [0.1, 0.1, 0.1], [0.3, 0.3, 0.3], [1, 0, 0]])
    mesh = Mesh(line, np.array([[0, 1, 2], [0, 1, 3], [3, 3, 1]], np.int32))
    assert check(mesh).degenerate_faces == 2
    assert check(Mesh(line, mesh.faces[2:])).closed is False
    report = check(cloud(line))
    assert report[:2] == (4, 0) and set(report[2:]) == {None}


def test_report_reads_well():
    assert str(check(cloud(np.eye(3)))) == "point cloud of 3 vertices"
    text = str(check(stray(together(sphere(1), moebius()))))
    assert "55" not in text.splitlines()[1]
    assert text.startswith("67 vertices, 104 faces, 2 components\nopen, wound incons")
    assert text.endswith("24 boundary edges, 1 unreferenced vertices")
    assert "closed, wound consistently, outward" in str(check(sphere(1)))


@given(st.integers(0, 99), st.floats(0, 1), st.booleans())
def test_orient_undoes_any_flips(seed, share, hole):
    rng = np.random.default_rng(seed)
    mesh = together(sphere(1), sphere(2, (7.0, 1, 0), 0.5), sphere(1, (0, 5.0, 0)))
    if hole:
        mesh = Mesh(mesh.vertices, mesh.faces[rng.random(len(mesh.faces)) < 0.95])
    order = rng.permutation(len(mesh.faces))
    mesh = Mesh(mesh.vertices, mesh.faces[order])
    flip = rng.random(len(mesh.faces)) < share
    mixed = np.where(flip[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
    kept = mixed.copy()
    wound = orient(Mesh(mesh.vertices, mixed))
    same(wound, mesh.vertices, mesh.faces)
    assert np.array_equal(mixed, kept)
    if not hole:
        assert check(wound).outward


@given(soups())
def test_orient_changes_nothing_else_and_settles(mesh):
    wound = orient(mesh)
    assert wound.vertices is mesh.vertices and wound.faces.dtype == mesh.faces.dtype
    assert np.array_equal(np.sort(wound.faces), np.sort(mesh.faces))
    assert np.array_equal(orient(wound).faces, wound.faces)


def test_orient_leaves_what_has_one_side():
    strip = moebius()
    assert check(strip).boundary_edges == 24
    wound = orient(
        together(strip, Mesh(*sphere(1))._replace(faces=sphere(1).faces[:, ::-1]))
    )
    assert np.array_equal(wound.faces[:24], strip.faces)
    assert check(wound).consistent is False
    ball = Mesh(wound.vertices[24:], wound.faces[24:] - 24)
    assert check(ball).outward


def test_orient_winds_pieces_around_an_edge_with_three_faces():
    corners = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]])
    book = Mesh(corners, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32))
    assert check(book).nonmanifold_edges == 1
    # The third page continues the first and the second; these do not each other.
    turned = np.array([[0, 1, 2], [0, 1, 3], [0, 4, 1]])
    assert np.array_equal(orient(book).faces, turned)
    assert check(orient(book)).consistent is False
    even = corners.copy()
    angle = 2 * np.pi * np.arange(3) / 3
    even[2:] = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert np.array_equal(orient(Mesh(even, book.faces)).faces, book.faces)
    assert len(orient(cloud(corners)).faces) == 0


def test_largest_component_maps_back():
    small, big = sphere(2, radius=0.1), sphere(1, (3.0, 0, 0))
    mesh = stray(together(small, big, small))
    part, index = largest_component(mesh)
    same(part, big.vertices, big.faces)
    assert index.dtype == np.int32
    assert np.array_equal(mesh.vertices[index], part.vertices)
    validate(part)
    whole = largest_component(cloud(mesh.vertices))
    assert np.array_equal(whole.index, np.arange(len(mesh.vertices)))
    # No area at all: still a piece with faces, never the lone vertex before it.
    flat = Mesh(np.zeros((4, 3)), np.array([[1, 2, 3]], np.int32))
    assert np.array_equal(largest_component(flat).index, [1, 2, 3])


@given(st.integers(0, 99))
def test_weld_undoes_a_cut_into_triangles(seed):
    ball = sphere(1)
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(ball.faces))
    loose = ball.vertices[ball.faces[order]].reshape(-1, 3)
    mesh, index = weld(
        Mesh(loose, np.arange(len(loose), dtype=np.int32).reshape(-1, 3))
    )
    assert len(mesh.vertices) == 42 and check(mesh).outward
    assert np.array_equal(mesh.vertices[mesh.faces].reshape(-1, 3), loose)
    assert np.array_equal(loose[index], mesh.vertices) and (np.diff(index) > 0).all()
    assert index.dtype == mesh.faces.dtype == np.int32
    again = weld(mesh)
    assert np.array_equal(again.index, np.arange(42))
    same(again.mesh, *mesh)


@pytest.mark.skipif(not DATA.is_dir(), reason="set JFSF_DATA to data not shipped")
def test_real_meshes_pass():
    folder = DATA / "makehuman_cc0/remeshed"
    for name in ("man_walk", "child_kick"):
        mesh = read(folder / f"off/{name}.off")
        stored = np.load(folder / f"npz/{name}.npz")
        exact = stored["vq"] * stored["scale"] + stored["lo"]
        assert np.allclose(mesh.vertices, exact, rtol=0, atol=1e-4)
        assert np.array_equal(mesh.faces, stored["f"])
        validate(mesh, k=200)
        assert check(mesh).outward
        assert np.array_equal(orient(mesh).faces, mesh.faces)
