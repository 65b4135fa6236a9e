"""What people's files hold: other formats, compression, values that are too many."""

import bz2
import gzip
import io
import lzma

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.mesh import MeshError, read, read_noted, vertex_colours
from jfsf.mesh._geometry import face_areas, face_normals
from jfsf.mesh._polygons import triangulate
from jfsf.mesh._read import format_of, stem_of
from jfsf.storage._text import plain_numbers

BLOB = testing.blob(0, subdivisions=1)
N, M = len(BLOB.vertices), len(BLOB.faces)
PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}


def same(mesh, vertices, faces):
    assert mesh.vertices.dtype == np.float64 and mesh.faces.dtype == np.int32
    assert np.array_equal(mesh.vertices, np.reshape(vertices, (-1, 3)))
    assert np.array_equal(mesh.faces, np.reshape(faces, (-1, 3)))


def contents(suffix) -> bytes:
    """The blob in a format with faces."""
    ball = trimesh.Trimesh(*BLOB, process=False)
    held = ball.export(file_type=suffix[1:])
    if isinstance(held, dict):
        held = held["model.gltf"]
    return held if isinstance(held, bytes) else held.encode()


@pytest.mark.parametrize("suffix", [".off", ".obj", ".ply", ".stl", ".glb"])
def test_every_format_is_read_compressed(tmp_path, suffix):
    (plain := tmp_path / f"a{suffix}").write_bytes(contents(suffix))
    found = read(plain)
    for packing, pack in PACKERS.items():
        path = tmp_path / f"a{suffix}{packing.upper()}"
        path.write_bytes(pack(contents(suffix)))
        same(read(path), found.vertices, found.faces)
        assert format_of(path) == suffix and stem_of(path) == "a"


def test_a_gltf_with_other_files_is_read_compressed(tmp_path):
    files = trimesh.Trimesh(*BLOB, process=False).export(file_type="gltf")
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    packed = tmp_path / "model.gltf.gz"
    packed.write_bytes(gzip.compress(files["model.gltf"]))
    same(read(packed), *read(tmp_path / "model.gltf"))


@pytest.mark.parametrize("packing", PACKERS)
def test_damaged_packings_are_refused(tmp_path, packing):
    path = tmp_path / f"a.off{packing}"
    whole = PACKERS[packing](contents(".off"))
    for data, words in (
        (whole[: len(whole) // 2], "cannot be decompressed"),
        (b"OFF\n1 0 0\n0 0 0\n", "cannot be decompressed"),
        (PACKERS[packing](b" \n"), "packed in it is empty"),
        (PACKERS[packing](b"OFF\n1 0 0\n"), "header announces"),
    ):
        path.write_bytes(data)
        with pytest.raises(MeshError, match=words) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")


def test_names_tell_the_format():
    assert format_of("a/b.PLY") == ".ply" and stem_of("a/b.PLY") == "b"
    assert format_of("b.txt.gz") == format_of("b.gz") == format_of("b") == ""
    assert stem_of("b.txt.gz") == "b.txt"


CLOUDS = {
    "blanks": b"0 1 2\n3 4 5\n",
    "normals and colours": b"0 1 2 9 9 9 255 0 7\n3 4 5 8 8 8 255 0 7\n",
    "commas": b"0,1,2\r\n3, 4, 5\r\n",
    "semicolons": b"0;1;2\n3; 4; 5\n",
    "comments": b"# of a scanner\n//X Y Z\n0 1 2\n\n3 4 5\n",
    "titles": b"X,Y,Z,R,G,B\n0,1,2,9,9,9\n3,4,5,9,9,9\n",
    "quoted titles": b'"x";"y";"z"\n0;1;2\n3;4;5\n',
    "count": b"2\n0 1 2\n3 4 5\n",
    "other numbers": b"\xef\xbb\xbf0\t1e0\t+2\n3\t4.\t0.5e1",
}


@pytest.mark.parametrize("name", CLOUDS)
def test_points_in_text_are_a_cloud(tmp_path, name):
    (path := tmp_path / "a.xyz").write_bytes(CLOUDS[name])
    same(read(path), np.arange(6), [])


BAD_CLOUDS = {
    "atoms": (b"2\nwater\nO 0 0 0\nH 0 0 1\n", "line 1 is '2', not x y z"),
    "words": (b"a b c\n0 1 2\n", "could not convert string to float"),
    "two a line": (b"0 1\n2 3\n", "line 1 is '0 1', not x y z"),
    "one is short": (b"0 1 2\n3 4\n", "line 2 is '3 4', not x y z"),
    "one is long": (
        b"# a\n0 1 2\n3 4 5 6\n",
        "line 3 has 4 numbers, and the first point 3",
    ),
    "decimal commas": (b"0,5 1,5 2,5\n", "line 1 is .* commas inside of numbers"),
    "decimal commas in a table": (b"0,5;1,5;2,5\n", "commas inside of numbers"),
    "underscore": (b"0 1_0 2\n", "'1_0' for a number"),
    "titles alone": (b"x y z\n", "0 vertices"),
    "nan": (
        b"0 1 nan\n",
        "leave them out with jfsf.mesh.repair",
    ),
}


@pytest.mark.parametrize("name", BAD_CLOUDS)
def test_other_text_is_no_cloud(tmp_path, name):
    content, words = BAD_CLOUDS[name]
    (path := tmp_path / "a.xyz").write_bytes(content)
    with pytest.raises(MeshError, match=words) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")


def saved(array, **options):
    np.save(held := io.BytesIO(), array, **options)
    return held.getvalue()


def test_arrays_are_clouds(tmp_path):
    points = np.arange(12).reshape(4, 3)
    path = tmp_path / "a.npy"
    for kind in ("f8", ">f4", "f2", "i4", "u1"):
        for array in (points.astype(kind), np.asfortranarray(points.astype(kind))):
            path.write_bytes(saved(array))
            same(read(path), points, [])
    for data, words in (
        (saved(points.T), r"holds int64 \(3, 4\); save real numbers \(n, 3\)"),
        (saved(points[0]), r"\(3,\)"),
        (saved(points * 1j), "complex128"),
        (saved(np.array([[{}] * 3])), "object"),
        (saved(points)[:-1], "announces 96 bytes, but 95 follow"),
        (saved(points) + b"\0", "but 97 follow"),
        (saved(points).replace(b"(4, 3)", b"(9999999999999999, 3)"), "NPY|announces"),
        (b"PK\3\4", "not a readable NPY file"),
        (saved(points[:0]), "0 vertices"),
    ):
        path.write_bytes(data)
        with pytest.raises(MeshError, match=words):
            read(path)


# MeshLab's: what its header names, and then the quality of a vertex or face, or the
# texture of a face.
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nproperty list uchar int empty\nelement face 2\nproperty list "
    "uchar int vertex_indices\nproperty uchar red\nend_header\n"
)
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def ply(vertex_end="", face_end="", sizes=(3, 4)):
    lines = [f"{x} {y} {z} 0{vertex_end}" for x, y, z in POINTS]
    faces = [[0, 1, 2], [0, 1, 2, 3]]
    for i, size in enumerate(sizes):
        corners = faces[size - 3]
        lines.append(" ".join(map(str, (size, *corners, 7))) + f"{face_end}{' 1' * i}")
    return lines


@pytest.mark.parametrize(
    ("vertex_end", "face_end", "notes"),
    [
        ("", "", 0),
        (" 255", "", 1),
        ("", " 6 0 0 1 0 1 1", 1),
        (" 1 2 3", " 0.5", 2),
    ],
)
def test_values_that_the_header_does_not_name_are_passed_over(
    tmp_path, vertex_end, face_end, notes
):
    lines = ply(vertex_end, face_end)
    lines[-1] = lines[-1].removesuffix(" 1")
    (path := tmp_path / "a.ply").write_text(PLY + "\n".join(lines), encoding="utf-8")
    found = read_noted(path)
    same(found.mesh, POINTS, [[0, 1, 2], [0, 1, 2], [0, 2, 3]])
    assert len(found.notes) == notes
    if not notes:
        read(path)
        return
    assert "that its header does not name; passed over" in found.notes[0]
    with pytest.warns(UserWarning, match=f"{path}: its lines of element"):
        read(path)


def test_lines_of_different_lengths_are_refused(tmp_path):
    path = tmp_path / "a.ply"
    # One value more or less in one line may be a value that is lost elsewhere.
    for lines in (
        ply(" 1")[:3] + ply()[3:],
        ply()[:3] + ply(" 1")[3:],
        ply("", " 9"),
        ply(" 1")[:1] + ["0 0"] + ply(" 1")[2:],
    ):
        path.write_text(PLY + "\n".join(lines), encoding="utf-8")
        with pytest.raises(MeshError, match="export"):
            read(path)


def ring(radii):
    """A polygon around the origin, one corner at each distance."""
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    return np.stack([radii * np.cos(angle), radii * np.sin(angle), 0 * angle], axis=1)


def turned(points, rng):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return points @ turn.T + rng.normal(size=3)


def split(points):
    return triangulate([len(points)], np.arange(len(points)), points)


def area(points):
    """Of a polygon in a plane."""
    total = np.cross(points, np.roll(points, -1, axis=0)).sum(0)
    return np.linalg.norm(total) / 2


@given(testing.seeds, st.integers(4, 30))
def test_concave_polygons_do_not_fold_over(seed, n):
    rng = np.random.default_rng(seed)
    points = ring(rng.uniform(0.2, 1, n))
    moved = turned(points, rng)
    triangles = split(moved)
    assert triangles.shape == (n - 2, 3)
    assert np.isclose(face_areas(moved, triangles).sum(), area(points))
    # All on one side, as the polygon is wound.
    normals = face_normals(points, split(points))[:, 2]
    assert (normals > -1e-12).all()
    assert set(triangles.ravel()) == set(range(n))
    # Every side of the polygon is a side of a triangle, in its direction.
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
    sides = set(map(tuple, ends.reshape(-1, 2).tolist()))
    assert {(i, (i + 1) % n) for i in range(n)} <= sides


@given(testing.seeds, st.integers(4, 12))
def test_convex_polygons_are_fans(seed, n):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, n))
    points = np.stack([np.cos(angle), 2 * np.sin(angle), 0 * angle], axis=1)
    fan = [[0, i, i + 1] for i in range(1, n - 1)]
    assert np.array_equal(split(turned(points, rng)), fan)


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_a_dart_has_its_own_area(start, scale):
    dart = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [3, 1, 0]])
    points = np.roll(dart, start, axis=0) * scale
    triangles = split(points)
    assert np.isclose(face_areas(points / scale, triangles).sum(), 4)


def test_polygons_without_an_inside_are_fans():
    fan = [[0, 1, 2], [0, 2, 3]]
    crossed = np.array([[0.0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]])
    for points in (crossed, np.zeros((4, 3)), POINTS[[0, 1, 0, 1]]):
        assert split(points).tolist() == fan
    # And those whose values are refused afterwards.
    assert triangulate([4], [0, 1, 2, 9], POINTS).tolist() == [[0, 1, 2], [0, 2, 9]]
    assert split(POINTS * [np.nan, 1, 1]).tolist() == fan
    assert triangulate([4], [0, 1, 2, 3]).tolist() == fan


def test_concave_polygons_of_files_keep_their_place(tmp_path):
    dart = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [3, 1, 0], [9, 9, 9]])
    polygons = [[0, 1, 4], [0, 1, 2, 3], [1, 2, 4]]
    rows = [f"{len(p)} {' '.join(map(str, p))}" for p in polygons]
    points = [" ".join(map(str, row)) for row in dart.tolist()]
    texts = {
        ".off": ["OFF", "5 3 0", *points, *rows],
        ".obj": [f"v {row}" for row in points]
        + ["f " + " ".join(str(v + 1) for v in p) for p in polygons],
        ".ply": [
            *("ply", "format ascii 1.0", "element vertex 5", "property int x"),
            *("property int y", "property int z", "element face 3"),
            *("property list uchar int vertex_indices", "end_header", *points, *rows),
        ],
    }
    for suffix, lines in texts.items():
        (path := tmp_path / f"a{suffix}").write_text("\n".join(lines), encoding="utf-8")
        same(read(path), dart, [[0, 1, 4], [3, 0, 1], [3, 1, 2], [1, 2, 4]])


def test_what_is_not_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("jfsf.mesh._others.find_spec", lambda name: None)
    for suffix, extra in ((".vtk", "vtk"), (".vtp", "vtk"), (".gii", "gifti")):
        (path := tmp_path / f"a{suffix}").write_bytes(b"content")
        with pytest.raises(MeshError, match="pip install") as caught:
            read(path)
        assert f"'jfsf[{extra}]'" in str(caught.value)
        assert str(caught.value).startswith(f"{path}: ")


VTK = (
    "# vtk DataFile Version 3.0\nby hand\nASCII\nDATASET POLYDATA\nPOINTS 5 float\n"
    "0 0 0 4 0 0 4 4 0 3 1 0\n9 9 9\n"
)
POLYGONS = "POLYGONS 2 9\n3 0 1 4\n4 0 1 2 3\n"
XML = (
    '<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData><Piece '
    'NumberOfPoints="3" NumberOfPolys="1"><Points><DataArray type="Float32" '
    'NumberOfComponents="3" format="ascii">0 0 0 1 0 0 0 1 0</DataArray></Points>'
    '<Polys><DataArray type="Int32" Name="connectivity" format="ascii">0 1 2'
    '</DataArray><DataArray type="Int32" Name="offsets" format="ascii">3</DataArray>'
    "</Polys></Piece></PolyData></VTKFile>"
)
GRID = VTK.replace("POLYDATA", "UNSTRUCTURED_GRID")
DART = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [3, 1, 0], [9, 9, 9]]
VTK_FILES = {
    "polygons": (VTK + POLYGONS, [[0, 1, 4], [3, 0, 1], [3, 1, 2]]),
    "strips": (
        VTK + "TRIANGLE_STRIPS 1 6\n5 0 1 2 3 4\n",
        [[0, 1, 2], [3, 2, 1], [2, 3, 4]],
    ),
    "both": (
        VTK + "POLYGONS 1 4\n3 4 1 0\nTRIANGLE_STRIPS 1 5\n4 0 1 2 3\n",
        [[4, 1, 0], [0, 1, 2], [3, 2, 1]],
    ),
    "points": (VTK + "VERTICES 1 2\n1 0\n", []),
    "grid": (
        GRID + "CELLS 4 14\n2 0 1\n3 0 1 4\n4 0 1 3 2\n1 2\nCELL_TYPES 4\n3\n5\n8\n1\n",
        [[0, 1, 4], [3, 0, 1], [3, 1, 2]],
    ),
}


@pytest.fixture(scope="module")
def vtk():
    return pytest.importorskip("vtkmodules", reason="pip install 'jfsf[vtk]'")


@pytest.mark.parametrize("name", VTK_FILES)
def test_vtk_surfaces_are_read(tmp_path, vtk, name):
    text, faces = VTK_FILES[name]
    (path := tmp_path / "a.vtk").write_text(text, encoding="utf-8")
    same(read(path), DART, faces)


def test_vtk_files_in_all_encodings_are_read(tmp_path, vtk):
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    data, points, cells = vtkPolyData(), vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(BLOB.vertices), deep=True))
    for face in BLOB.faces.tolist():
        cells.InsertNextCell(3, face)
    data.SetPoints(points)
    data.SetPolys(cells)
    legacy, xml = vtkPolyDataWriter(), vtkXMLPolyDataWriter()
    legacy.SetFileTypeToBinary()
    xml.SetDataModeToAppended()
    for writer, suffix in ((legacy, ".vtk"), (xml, ".vtp")):
        writer.SetInputData(data)
        writer.SetFileName(str(path := tmp_path / f"a{suffix}"))
        writer.Write()
        same(read(path), *BLOB)
        packed = tmp_path / f"a{suffix}.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
        same(read(packed), *BLOB)
    (path := tmp_path / "b.vtp").write_text(XML, encoding="utf-8")
    same(read(path), [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [0, 1, 2])


def test_other_vtk_files_are_refused(tmp_path, vtk, capfd):
    tetrahedron = "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n"
    image = (
        "# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\n"
        "DIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n"
    )
    for text, words in (
        (GRID + tetrahedron, "types 10.*Extract Surface"),
        (image, "holds a .*; export a surface"),
        ("nonsense\n", "VTK cannot read it"),
        (VTK + POLYGONS[:20], r"VTK cannot read it \(Error reading ascii cell data\)"),
        (VTK + POLYGONS.replace("1 4", "1 40"), "vertex 40, but the 5"),
        (VTK.replace("DATASET POLYDATA", "DATASET NONE"), "VTK"),
    ):
        (path := tmp_path / "a.vtk").write_text(text, encoding="utf-8")
        with pytest.raises(MeshError, match=words) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")
    assert capfd.readouterr() == ("", "")


def test_gifti_surfaces_are_read(tmp_path):
    gifti = pytest.importorskip("nibabel.gifti", reason="pip install 'jfsf[gifti]'")

    def write(path, *arrays):
        parts = [
            gifti.GiftiDataArray(array, intent=f"NIFTI_INTENT_{intent}")
            for intent, array in arrays
        ]
        path.write_bytes(gifti.GiftiImage(darrays=parts).to_bytes())

    points = BLOB.vertices.astype(np.float32)
    path = tmp_path / "lh.surf.gii"
    write(path, ("POINTSET", points), ("TRIANGLE", BLOB.faces))
    same(read(path), points, BLOB.faces)
    (packed := tmp_path / "lh.gii.gz").write_bytes(gzip.compress(path.read_bytes()))
    same(read(packed), points, BLOB.faces)
    write(path, ("POINTSET", points))
    same(read(path), points, [])
    write(path, ("SHAPE", points[:, 0]))
    with pytest.raises(MeshError, match="has 0 arrays of points .*; give the file"):
        read(path)
    write(path, ("POINTSET", points), ("TRIANGLE", BLOB.faces + N))
    with pytest.raises(MeshError, match=f"vertex {N}"):
        read(path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(MeshError, match="not a readable GII file"):
        read(path)


TEXTS = {
    ".off": b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n3 0 1 2\n3 0 2 3\n",
    ".obj": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n",
    ".ply": b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
    b"property float y\nproperty float z\nelement face 2\n"
    b"property list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n3 0 1 2\n3 0 2 3\n",
    ".stl": b"solid a\n"
    + b"".join(
        b"facet normal 0 0 1\nouter loop\n" + corners + b"endloop\nendfacet\n"
        for corners in (
            b"vertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\n",
            b"vertex 0 0 0\nvertex 1 1 0\nvertex 0 1 0.5\n",
        )
    )
    + b"endsolid a\n",
    ".xyz": b"0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n",
}
SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]]
each_text = pytest.mark.parametrize("suffix", TEXTS)


@each_text
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_text_of_windows_is_read(tmp_path, suffix, encoding, ending):
    text = TEXTS[suffix].decode().replace("\n", ending)
    mark = "\ufeff" if encoding.endswith("be") else ""
    (path := tmp_path / f"a{suffix}").write_bytes((mark + text).encode(encoding))
    faces = [] if suffix == ".xyz" else [[0, 1, 2], [0, 2, 3]]
    same(read(path), SQUARE, faces)
    (packed := tmp_path / f"a{suffix}.gz").write_bytes(gzip.compress(path.read_bytes()))
    same(read(packed), SQUARE, faces)


def test_colours_of_utf16_are_read(tmp_path):
    text = "\n".join(f"v {x} {y} {z} {x} 0 0" for x, y, z in SQUARE) + "\nf 1 2 3\n"
    (path := tmp_path / "a.obj").write_bytes(text.encode("utf-16"))
    assert vertex_colours(path)[:, 0].tolist() == [0, 1, 1, 0]


@pytest.mark.parametrize("suffix", [*TEXTS, ".glb", ".npy", ".off.gz"])
@pytest.mark.parametrize(
    "data, message",
    [
        (
            b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n",
            "it is a pointer of Git LFS, not the file itself; run git lfs pull",
        ),
        (
            b"\n<!DOCTYPE HTML>\n<html lang=en>",
            "it is a web page, not the file itself; download the file itself",
        ),
        (b"\xef\xbb\xbf<html><body>", "it is a web page"),
    ],
)
def test_what_stands_in_place_of_a_file_is_named(tmp_path, suffix, data, message):
    (path := tmp_path / f"a{suffix}").write_bytes(data)
    with pytest.raises(MeshError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize("more", [b"", bytes(50)])
def test_a_binary_stl_without_triangles_is_named(tmp_path, more):
    (path := tmp_path / "a.stl").write_bytes(b" " * 80 + bytes(4) + more)
    with pytest.raises(MeshError, match="binary STL whose header announces 0 tri") as e:
        read(path)
    assert ("but 50 bytes follow" in str(e.value)) == bool(more)


def test_off_without_its_keyword_is_read(tmp_path):
    path = tmp_path / "a.off"
    for head in (b"# a\n4 2 0", b"4 2"):
        path.write_bytes(head + TEXTS[".off"].removeprefix(b"OFF\n4 2 0"))
        same(read(path), SQUARE, [[0, 1, 2], [0, 2, 3]])
    path.write_bytes(b"4 1 0\n0 0 0\n")
    with pytest.raises(MeshError, match="announces 4 vertices and 1 faces"):
        read(path)


NOT_FINITE = "-1.#IND 1.#QNAN -1.#QNAN0 1.#SNAN 1.#INF -1.#INF000 1.#J -nan(ind)"


@each_text
@pytest.mark.parametrize("word", NOT_FINITE.split())
def test_numbers_of_windows_that_are_not_finite(tmp_path, suffix, word):
    # Cut at the #, as comments are, these were finite.
    data = TEXTS[suffix].replace(b"1 0 0\n", b"1 0 " + word.encode() + b"\n")
    (path := tmp_path / f"a{suffix}").write_bytes(data)
    with pytest.raises(MeshError, match="not finite; leave them out with jfsf.mesh.re"):
        read(path)
    found = read(path, finite=False).vertices
    assert np.isfinite(found).all(1).tolist().count(False) == 1
    lost = found[~np.isfinite(found)]
    assert np.array_equal(lost, [float(plain_numbers(word))], equal_nan=True)
    assert np.isinf(lost).all() == ("INF" in word or "J" in word)
