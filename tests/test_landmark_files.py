"""Landmark files as other programs write them, round trips, landmarks on meshes."""

import json
import re
import unicodedata

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.cli._files import matchable
from jfsf.apps.cli._stored import kept_match
from jfsf.apps.export import export_mesh
from jfsf.apps.landmarks import (
    Landmarks,
    pair_landmarks,
    read_landmarks,
    to_vertices,
    write_landmarks,
)
from jfsf.apps.landmarks._files import read_vertex_pairs
from jfsf.apps.landmarks._place import on_surface
from jfsf.apps.mapfiles import read_match
from jfsf.apps.report._words import warnings_of
from jfsf.mesh import without_strays
from jfsf.types import Certificate, Match, Mesh

X = testing.blob(0)
Y = Mesh(testing.blob(1).vertices, X.faces)
N = len(X.vertices)
SUFFIXES = (".mrk.json", ".json", ".fcsv", ".pp", ".csv", ".tsv", ".txt")

MARKUPS = """{
    "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#",
    "markups": [{
        "type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm",
        "locked": false, "labelFormat": "%N-%d", "lastUsedControlPointNumber": 3,
        "controlPoints": [
            {"id": "1", "label": "Nasion", "description": "",
             "associatedNodeID": "vtkMRMLScalarVolumeNode1",
             "position": [-53.388409961685827, -73.33572796934868, 0.0],
             "orientation": [-1.0, -0.0, -0.0, -0.0, -1.0, -0.0, 0.0, 0.0, 1.0],
             "selected": true, "locked": false, "positionStatus": "defined"},
            {"id": "2", "label": "Gonion R", "description": "", "position": "",
             "selected": true, "locked": false, "positionStatus": "undefined"},
            {"id": "3", "label": "\\u9f3b\\u5c16", "description": "",
             "position": [49.8682950191571, -88.58955938697324, 1e-3],
             "selected": true, "locked": false, "positionStatus": "defined"}
        ],
        "measurements": [],
        "display": {"visibility": true, "opacity": 1.0, "glyphType": "Sphere3D"}
    }]
}
"""  # noqa: E501
COLUMNS = "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
FCSV_4 = f'''# Markups fiducial file version = 4.10
# CoordinateSystem = 0
{COLUMNS}
vtkMRMLMarkupsFiducialNode_0,51.4869,-9.87066,62,0.000,0.000,0.000,1.000,1,1,0,Target,,vtkMRMLScalarVolumeNode1
vtkMRMLMarkupsFiducialNode_1,-7.3939,-76.9499,17.5525,0.000,0.000,0.000,1.000,1,1,0,"left, ""upper""",a note,
'''  # noqa: E501
FCSV_5 = f"""# Markups fiducial file version = 5.6
# CoordinateSystem = LPS
{COLUMNS}
1,-19.906699999999987,13.9347,29.442970822281154,0,0,0,1,1,1,0,F-1,,,2,0
2,0,0,0,0,0,0,1,1,1,0,F-2,,,0,0
3,81.73333450520303,-42.9415,9.625586614976527,0,0,0,1,1,1,0,F-3,,vtkMRMLModelNode4,2,0
"""
FCSV_3 = """# Fiducial List file /home/a/L.fcsv
# name = L
# numPoints = 2
# symbolScale = 5
# visibility = 1
# columns = label,x,y,z,sel,vis
L-P,1.5,2,-3,1,1
L-P2,4,5e0,.5,1,1
"""
PICKED = """<!DOCTYPE PickedPoints>
<PickedPoints>
 <DocumentData>
  <DateTime date="2024-03-11" time="16:59:22"/>
  <User name="someone"/>
  <DataFileName name="femur left.ply"/>
  <templateName name=".pickPointsTemplate.pptpl"/>
 </DocumentData>
 <point z="-0.060032" x="0.044259" y="0.467733" active="1" name="head &amp; neck"/>
 <point y="0" x="0" name="trochanter" z="0" active="0"/>
 <point x="1.25" y="-2.5e-05" z="3" active="1" name="condyle &quot;m&quot;"/>
</PickedPoints>
"""


def written(folder, suffix, text):
    path = folder / f"a{suffix}"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "suffix, text, names, points, system, said",
    [
        (
            ".mrk.json",
            MARKUPS,
            ("Nasion", "鼻尖"),
            [
                [-53.388409961685827, -73.33572796934868, 0],
                [49.8682950191571, -88.58955938697324, 1e-3],
            ],  # noqa: E501
            "LPS",
            "'Gonion R'",
        ),
        (
            ".fcsv",
            FCSV_4,
            ("Target", 'left, "upper"'),
            [[51.4869, -9.87066, 62], [-7.3939, -76.9499, 17.5525]],
            "RAS",
            "",
        ),
        (
            ".fcsv",
            FCSV_5,
            ("F-1", "F-3"),
            [
                [-19.906699999999987, 13.9347, 29.442970822281154],
                [81.73333450520303, -42.9415, 9.625586614976527],
            ],
            "LPS",
            "'F-2'",
        ),
        (".fcsv", FCSV_3, ("L-P", "L-P2"), [[1.5, 2, -3], [4, 5, 0.5]], "RAS", ""),
        (
            ".pp",
            PICKED,
            ("head & neck", 'condyle "m"'),
            [[0.044259, 0.467733, -0.060032], [1.25, -2.5e-5, 3]],
            None,
            "'trochanter'",
        ),
    ],
)
def test_files_of_other_programs_are_read(
    tmp_path, suffix, text, names, points, system, said
):
    # With the line ends of Windows too, and a mark of the encoding.
    for form in (text, text.replace("\n", "\r\n"), "\ufeff" + text):
        found = read_landmarks(written(tmp_path, suffix, form))
        assert found.names == names and found.vertices is None
        assert np.array_equal(found.points, points)
        assert found.points.dtype == np.float64
        assert found.system == system
        assert len(found.said) == bool(said) and said in "".join(found.said)


@pytest.mark.parametrize("word, system", [("1", "LPS"), (0, "RAS"), ("RAS", "RAS")])
def test_old_markups_number_their_systems(tmp_path, word, system):
    tree = json.loads(MARKUPS)
    tree["markups"][0]["coordinateSystem"] = word
    assert read_landmarks(written(tmp_path, ".json", json.dumps(tree))).system == system
    del tree["markups"][0]["coordinateSystem"]
    assert read_landmarks(written(tmp_path, ".json", json.dumps(tree))).system == "LPS"


ONE = [[1.5, -2.0, 3.0]]


@pytest.mark.parametrize(
    "text, names, points",
    [
        ("name,x,y,z\nnose,1.5,-2,3\n", ("nose",), ONE),
        ("x,y,z\n1.5,-2,3e0\n", ("",), ONE),
        ("1.5,-2,3", ("",), ONE),
        ("nose,1.5,-2,3\n", ("nose",), ONE),
        ("nose;1.5;-2;3\n", ("nose",), ONE),
        ("nose\t1.5\t-2\t3\t\n", ("nose",), ONE),
        ("nose   1.5  -2 3\n", ("nose",), ONE),
        ("tip of the nose 1.5 -2 3\n", ("tip of the nose",), ONE),
        ("# picked\n\nnose, 1.5, -2, 3\n", ("nose",), ONE),
        ("# x y z\n1.5 -2 3\n", ("",), ONE),
        ('"","x","y","z"\n"nose, left",1.5,-2,3\n', ("nose, left",), ONE),
        ("id;z (mm);y (mm);X [mm];label\n1;3;-2;1.5;nose\n", ("nose",), ONE),
        ("#1,1.5,-2,3\n", ("#1",), ONE),
        ("12,1.5,-2,3\n", ("12",), ONE),
        ("name,x,y,z\nnose,1.5,-2,3\near,NA,NA,NA\neye,,,\n", ("nose",), ONE),
        ("vertex\n7\n12\n", ("", ""), [7, 12]),
        ("7\n12\n", ("", ""), [7, 12]),
        ("name,vertex\nnose,7\near,12\n", ("nose", "ear"), [7, 12]),
        ("index;label\n7;nose\n12;ear\n", ("nose", "ear"), [7, 12]),
        ("nose 7\near 12\n", ("nose", "ear"), [7, 12]),
        ("sep=;\r\nindex;label\r\n7;nose\r\n12;ear\r\n", ("nose", "ear"), [7, 12]),
        ("nose;1.5;-2;3\near;-1.#IND;1.#QNAN;NA\n", ("nose",), ONE),
        ("nöse;1.5;-2;3\n".encode("utf-16"), ("nöse",), ONE),
        ("<html><body>", None, "it is a web page, not the file itself; download"),
        ("sep=;\n", None, "holds no landmark"),
        ("v 7\near,12", None, "line 2 is 'ear,12'"),
        ("nose,1,2\n", None, "line 1 is 'nose,1,2'; a line holds"),
        ("nose,1,2,3,4\n", None, "line 1"),
        ("name,x,y,z\nnose,1,2\n", None, "line 2"),
        ("name,x,y\nnose,1,2\n", None, "line 1"),
        ("1,2,3\n1,2,nan\n", None, "line 2"),
        ("1,2,3\n1,2,1e999\n", None, "line 2"),
        ("nose,1.5\n", None, "line 1"),
        ("-3\n", None, "line 1"),
        ("1_0,2,3\n", None, "line 1"),
        ("nose;1,5;-2;3\n", None, "line 1"),
        ("Nöse,1.5,-2,3\n".encode("cp1252"), None, "is not UTF-8"),
        ("", None, "holds no landmark"),
        ("x,y,z\n", None, "no landmark with a position"),
    ],
)
def test_tables_are_read(tmp_path, text, names, points):
    for suffix in (".csv", ".txt"):
        path = written(tmp_path, suffix, text)
        if names is None:
            with pytest.raises(ValueError) as caught:
                read_landmarks(path)
            assert str(caught.value).startswith(f"{path}: ")
            assert points in str(caught.value)
            continue
        found = read_landmarks(path)
        assert found.names == names and found.system is None
        held = found.points if found.vertices is None else found.vertices
        assert np.array_equal(held, points)
        assert len(found.said) == ("NA" in str(text))


SCRIPTS = (
    "鼻尖",
    "النقطة",
    "क्षेत्र",
    "Точка",
    "e\u0301le\u0300ve",
    "😀 2",
    "",
    "Ångström",
)


TPS = "LM3=3\n1 2 3\nNA NA NA\n-4.5 0 1e1\nIMAGE=a.jpg\nID=a 1\nSCALE=0.5\n"
PTS = "Version 1.0\n3\nS0000 1 2 3\nS0001 9999 9999 9999\nnose -4.5 0 1e1\n"


def test_files_of_morphometrics_are_read_without_what_is_missing(tmp_path):
    (tps := tmp_path / "a.tps").write_text(TPS)
    (pts := tmp_path / "a.pts").write_text(PTS)
    points = np.array([[1, 2, 3], [-4.5, 0, 10]])
    found = read_landmarks(tps)
    np.testing.assert_array_equal(found.points, points / 2)
    assert "1 landmark has no position" in found.said[0]
    found = read_landmarks(pts)
    np.testing.assert_array_equal(found.points, points)
    assert found.names == ("S0000", "nose") and "'S0001'" in found.said[0]
    for path in (tps, pts):
        write_landmarks(path, Landmarks(("left eye", ""), points))
        np.testing.assert_array_equal(read_landmarks(path).points, points)
    assert read_landmarks(pts).names == ("left_eye", "S0001")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (TPS + TPS, "has 2 specimens"),
        ("ID=1\n", "has no specimen"),
        ("LM=1\n1 2\n", "in a plane"),
        ("LM3=2\n1 2 3\n", "ends before"),
        ("LM3=1\n1 2\n", "line 2 is '1 2'"),
        ("LM3=1\n1 2 3\nSCALE=big\n", "SCALE is 'big'"),
    ],
)
def test_other_tps_is_refused(tmp_path, text, why):
    (path := tmp_path / "a.tps").write_text(text)
    with pytest.raises(ValueError, match=re.escape(why)):
        read_landmarks(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("system", ["LPS", "RAS"])
def test_names_in_all_scripts_and_missing_ones_go_round(tmp_path, suffix, system):
    points = np.random.default_rng(0).normal(size=(len(SCRIPTS), 3))
    path = tmp_path / f"a{suffix}"
    write_landmarks(path, Landmarks(SCRIPTS, points, None, system))
    path.read_bytes().decode("utf-8")
    found = read_landmarks(path)
    assert found.names == SCRIPTS and np.array_equal(found.points, points)
    assert found.system == (None if suffix == ".pp" else system)
    # Names of two formats are paired, in either way to write an accent, in any order.
    other = tuple(unicodedata.normalize("NFC", name) for name in SCRIPTS[::-1])
    write_landmarks(tmp_path / "b.csv", Landmarks(other, points[::-1]))
    pairing = pair_landmarks(found, read_landmarks(tmp_path / "b.csv"))
    last = len(SCRIPTS) - 1
    named = [i for i, name in enumerate(SCRIPTS) if name]
    assert pairing.rows.tolist() == [[i, last - i] for i in named]
    assert any("one without a name" in line for line in pairing.said)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_without_names_are_paired_by_order(tmp_path, suffix):
    points = np.arange(9.0).reshape(3, 3)
    write_landmarks(tmp_path / f"a{suffix}", Landmarks(("",) * 3, points))
    write_landmarks(tmp_path / "b.particles", Landmarks(("x", "y", "z"), points + 1))
    both = [read_landmarks(tmp_path / name) for name in (f"a{suffix}", "b.particles")]
    assert all(found.names == ("",) * 3 for found in both)
    assert np.array_equal(both[1].points, points + 1)
    assert pair_landmarks(*both).rows.tolist() == [[0, 0], [1, 1], [2, 2]]


def test_labels_that_are_missing_in_the_file(tmp_path):
    tree = json.loads(MARKUPS)
    first, *others = tree["markups"][0]["controlPoints"]
    first["label"] = None
    for control in others:
        del control["label"]
    sources = {
        ".json": json.dumps(tree),
        ".fcsv": FCSV_4.replace("Target", "").replace('"left, ""upper"""', ""),
        ".pp": re.sub(' name="[^"]*"', "", PICKED),
        ".csv": "name,x,y,z\n,1,2,3\n,4,5,6\n",
    }
    for suffix, text in sources.items():
        found = read_landmarks(written(tmp_path, suffix, text))
        assert found.names == ("", "") and found.points.shape == (2, 3)


def test_the_table_of_slicer_is_read(tmp_path):
    text = (
        "label,l,p,s,defined,selected,visible,locked,description\n"
        "F-1,-19.9067,13.9347,29.443,1,1,1,0,\nF-2,0,0,0,0,1,1,0,\n"
    )
    found = read_landmarks(written(tmp_path, ".csv", text))
    assert found.names == ("F-1",) and found.system == "LPS"
    assert "'F-2'" in found.said[0]


@pytest.mark.parametrize(
    "suffix, text, why",
    [
        (".stl", "solid", "unknown format of landmarks"),
        (".json", "[" * 100_000, "is not JSON"),
        (".json", "[]", "no list of markups"),
        # As Scalismo writes them.
        (".json", '[{"id": "a", "coordinates": [0, 1, 2]}]', "as a table (.csv)"),
        (".json", '{"markups": []}', "no landmark with a position"),
        (".json", MARKUPS.replace("-73.33572796934868", "NaN"), "'Nasion' is"),
        (".json", MARKUPS.replace("-73.33572796934868", "1" + "0" * 400), "'Nasion'"),
        (".json", MARKUPS.replace('"LPS"', '"IJK"'), "coordinate system is 'IJK'"),
        (".fcsv", FCSV_4.replace("= 0", "= 2"), "coordinate system is '2'"),
        (".fcsv", FCSV_4.replace("62", "up"), "line 4"),
        (".fcsv", "# columns = id,label\n1,a\n", "without x, y and z"),
        (".fcsv", "", "no landmark with a position"),
        (".pp", PICKED.replace("PickedPoints>", "Points>"), "holds Points"),
        (".pp", PICKED.replace('x="0.044259" ', ""), "'head & neck'"),
        (".pp", "<PickedPoints>", "is not XML"),
        (".pp", '<!DOCTYPE a [<!ENTITY b "c">]><PickedPoints/>', "entities"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, suffix, text, why):
    path = written(tmp_path, suffix, text)
    with pytest.raises(ValueError) as caught:
        read_landmarks(path)
    assert str(caught.value).startswith(f"{path}: ") and why in str(caught.value)


letters = st.characters(
    exclude_categories=["Cc", "Cs"], exclude_characters="\ufffe\uffff"
)
plain = st.text(letters | st.sampled_from(",;\"# '&<1"), max_size=8).map(str.strip)
coordinates = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.tuples(plain, *[coordinates] * 3), min_size=1, max_size=5),
    st.sampled_from([None, "LPS", "RAS"]),
)
def test_round_trips(tmp_path_factory, rows, system):
    folder = tmp_path_factory.mktemp("trips")
    names, points = tuple(row[0] for row in rows), np.array([row[1:] for row in rows])
    for suffix in SUFFIXES:
        write_landmarks(folder / f"a{suffix}", Landmarks(names, points, None, system))
        found = read_landmarks(folder / f"a{suffix}")
        assert found.names == names and np.array_equal(found.points, points)
        kept = "json" in suffix or suffix == ".fcsv"
        assert found.system == (system or "LPS" if kept else system) or suffix == ".pp"
        assert not found.said


@given(st.lists(st.tuples(plain, st.integers(0, 10**9)), min_size=1, max_size=5))
def test_vertices_go_round_in_tables(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("trips") / "a.csv"
    names, vertices = zip(*rows, strict=True)
    write_landmarks(path, Landmarks(names, None, np.array(vertices)))
    found = read_landmarks(path)
    assert found.names == names and found.vertices.tolist() == list(vertices)


def test_what_cannot_be_written_is_refused(tmp_path):
    points = Landmarks(("a",), np.zeros((1, 3)))
    for path, wrong, why in (
        ("a.stl", points, "unknown format"),
        (
            "a.pp",
            Landmarks(("a",), None, np.array([1])),
            "these landmarks are vertices",
        ),
        ("a.csv", Landmarks((), np.zeros((0, 3))), "no landmark to write"),
        ("a.csv", points._replace(names=("a\nb",)), "rename"),
        ("a.csv", points._replace(names=("a", "b")), "for 2 names"),
        ("a.csv", points._replace(points=np.full((1, 3), np.nan)), "'a' is at"),
        ("a.csv", points._replace(system="IJK"), "'IJK'"),
        ("a.csv", Landmarks(("a",)), "points or vertices"),
        ("a.csv", Landmarks(("a",), None, np.array([1.5])), "whole numbers"),
        ("a.fcsv", points._replace(names=(1,)), "a name is 1"),
        ("a.fcsv", points._replace(names=(None,)), "a name is None"),
    ):
        with pytest.raises(ValueError, match=why):
            write_landmarks(tmp_path / path, wrong)
    assert not list(tmp_path.iterdir())


SOUND = {
    ".json": MARKUPS,
    ".fcsv": FCSV_5,
    ".pp": PICKED,
    ".csv": "name,x,y,z\nnose,1.5,-2,3\n",
}


@given(
    st.sampled_from(list(SOUND)),
    st.binary(max_size=40),
    st.integers(0, 2000),
    st.integers(0, 30),
    st.booleans(),
)
def test_any_bytes_are_landmarks_or_refused(
    tmp_path_factory, suffix, data, at, gone, whole
):
    sound = SOUND[suffix].encode()
    at %= len(sound)
    data = data if whole else sound[:at] + data + sound[at + gone :]
    path = written(tmp_path_factory.mktemp("fuzz"), suffix, data)
    try:
        found = read_landmarks(path)
    except ValueError as error:
        assert str(error).startswith(f"{path}: ")
        return
    assert found.names
    if found.points is not None:
        assert found.points.shape == (len(found.names), 3)
        assert np.isfinite(found.points).all()


@pytest.mark.parametrize(
    "text",
    [
        "3 8\n4 9",
        "3,8\n4 ,9\n",
        "3;8\n# b\n4;9 # c",
        "x,y\n3\t8\n\n4\t9",
        '"3","8"\n"4","9"',
    ],
)
def test_pairs_of_vertices_are_read(tmp_path, text):
    found = read_vertex_pairs(written(tmp_path, ".txt", text))
    assert found.tolist() == [[3, 8], [4, 9]]


def test_pairs_say_which_line_is_wrong(tmp_path):
    for text, why in (
        ("1 2\n3\n", "line 2 is '3'"),
        ("a b\n", "no pair"),
        ("1 2\na b\n", "line 2"),
        ("1,-2\n", "line 1"),
        ("1 2 3\n", "line 1"),
    ):
        path = written(tmp_path, ".txt", text)
        with pytest.raises(ValueError, match=f"{why}.*counted from 0"):
            read_vertex_pairs(path)
    path = written(tmp_path, ".fcsv", FCSV_4)
    with pytest.raises(ValueError, match="--landmarks-x"):
        read_vertex_pairs(path)


def test_points_go_to_vertices():
    at = np.array([3, 50, 99])
    names, points = ("a", "b", "c"), X.vertices[at]
    found = to_vertices(Landmarks(names, points), X)
    assert found.vertices.tolist() == at.tolist() and found.said == []
    assert np.allclose(found.distances, 0)
    # Off the surface, along no axis; and from a cloud.
    moved = points * 1.02
    for mesh in (X, Mesh(X.vertices, np.zeros((0, 3), np.int32))):
        found = to_vertices(Landmarks(names, moved), mesh)
        assert found.vertices.tolist() == at.tolist()
        assert np.allclose(found.distances, np.linalg.norm(points - moved, axis=1))
    found = to_vertices(Landmarks(names, None, at), X)
    assert found.vertices.tolist() == at.tolist() and not found.distances.any()
    assert len(to_vertices(Landmarks((), np.zeros((0, 3))), X).vertices) == 0


def test_two_landmarks_at_one_vertex_are_said():
    points = X.vertices[[3, 3]]
    (said,) = to_vertices(Landmarks(("a", ""), points), X).said
    assert said.startswith("landmark 'a' and landmark 2 are both at vertex 3")


def test_a_point_of_a_thin_part_stays_on_its_side():
    # The lower of two sheets has a vertex nearer to the point than any of the upper.
    square = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    upper = np.column_stack([square, np.full(4, 0.1)])
    lower = np.column_stack([square + 1.9, np.zeros(4)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(np.concatenate([upper, lower]), np.concatenate([faces, faces + 4]))
    found = to_vertices(Landmarks(("a",), np.array([[1.9, 1.8, 0.1]])), mesh)
    assert found.vertices[0] < 4


def test_points_of_the_surface_are_the_nearest():
    rng = np.random.default_rng(0)
    points = X.vertices[rng.integers(N, size=40)] + rng.normal(scale=0.05, size=(40, 3))
    found = on_surface(Landmarks(("",) * 40, points), X)
    triangles = X.vertices[X.faces]
    for i, point in enumerate(points):
        every = trimesh.triangles.closest_point(
            triangles, np.tile(point, (len(triangles), 1))
        )
        least = np.linalg.norm(every - point, axis=1).min()
        assert np.isclose(found.distances[i], least)
    assert np.allclose(found.weights.sum(1), 1) and (found.weights >= 0).all()
    held = (found.weights[:, :, None] * X.vertices[found.corners]).sum(1)
    assert np.allclose(held, found.points)


def test_far_landmarks_are_refused():
    points = X.vertices[[3, 50]] + [[0, 0, 0], [0, 0, 1]]
    with pytest.raises(ValueError, match="'b' is .* from the mesh.*same units"):
        to_vertices(Landmarks(("a", "b"), points), X)
    cloud = Mesh(X.vertices, np.zeros((0, 3), np.int32))
    for scale in (1000, 1e200, 1e307):
        far = Landmarks(("", ""), X.vertices[[3, 50]] * [[1.0], [scale]], None, "RAS")
        for mesh in (X, cloud):
            with pytest.raises(ValueError, match="landmark 2 is .*The file is in RAS"):
                on_surface(far, mesh)
    with pytest.raises(ValueError, match=f"'a' is vertex {N}"):
        to_vertices(Landmarks(("a",), None, np.array([N])), X)


def test_landmarks_in_metres_inside_a_mesh_in_millimetres_are_refused():
    points = X.vertices[[3, 50, 90]] * 1e-3
    inside = X.vertices[7] * (1 - 1e-2)  # near the surface, as the origin may be
    with pytest.raises(ValueError, match="lie within .* same units"):
        on_surface(Landmarks(("", "", ""), inside + points), X)
    # Two clicks on one place are no error.
    on_surface(Landmarks(("", ""), np.stack([inside, inside])), X)


@pytest.mark.parametrize(
    "x, y, rows, said",
    [
        ("nose ear", "ear nose", [[0, 1], [1, 0]], ["2 paired by name: nose, ear"]),
        (
            "nose ear",
            "ear chin",
            [[1, 0]],
            ["1 paired", "without a partner, of X: 'nose'", "of Y: 'chin'"],
        ),
        ("A-1 A-2", "B-1 B-2", [[0, 0], [1, 1]], ["2 paired by their order"]),
        ("- -", "- -", [[0, 0], [1, 1]], ["2 paired by their order"]),
        ("0 1", "1 2", [[0, 0], [1, 1]], ["2 paired by their order"]),
        ("0 1 2", "0 2", [[0, 0], [2, 1]], ["2 paired by name", "of X: '1'"]),
        ("F-1 F-3", "F-1 F-2", [[0, 0]], ["1 paired by name", "'F-3'", "'F-2'"]),
        ("e\u0301", "é", [[0, 0]], ["1 paired by name"]),
        ("nose ear", "Nase Ohr", None, ["X has 'nose', 'ear', Y has 'Nase', 'Ohr'"]),
        ("nose ear", "- -", [[0, 0], [1, 1]], ["2 paired by their order"]),
        ("nose ear", "- - -", None, ["Y has one without a name"]),
        ("nose ear", "Nase -", None, ["Y has 'Nase', one without a name"]),
        ("- -", "- - -", None, ["no landmark has the same name"]),
        ("nose nose", "nose ear", None, ["landmarks of X have the same name: 'nose'"]),
        ("nose ear", "ear ear", None, ["landmarks of Y have the same name: 'ear'"]),
    ],
)
def test_landmarks_are_paired(x, y, rows, said):
    both = [
        Landmarks(tuple("" if name == "-" else name for name in names.split()))
        for names in (x, y)
    ]
    if rows is None:
        with pytest.raises(ValueError, match=said[0]):
            pair_landmarks(*both)
        return
    found = pair_landmarks(*both)
    assert found.rows.tolist() == rows
    assert found.names == tuple(both[0].names[row] for row in found.rows[:, 0])
    assert len(found.said) == len(said)
    assert all(part in line for part, line in zip(said, found.said, strict=True))


# The command line.

VALUES = {"empty": 0, "bijectivity_x": 0, "bijectivity_y": 0, "finite": True}
VALUES |= {"rivals": 0, "mirrored": 0.0}
GOOD = Certificate(*(jnp.asarray(VALUES.get(n, 0.9)) for n in Certificate._fields))


def run(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


@pytest.fixture
def folder(tmp_path):
    export_mesh(tmp_path / "x.ply", X)
    export_mesh(tmp_path / "y.ply", Y)
    return tmp_path


@pytest.fixture
def seen(monkeypatch):
    """The options of the last match, whose map takes vertex i to i + 5."""
    options = {}

    def match(x, y, **given):
        options.update(given, sizes=(len(x.vertices), len(y.vertices)))
        there = (np.arange(N) + 5) % N
        likely = jnp.linspace(0, 1, N)
        given_any = given["landmarks"] is not None
        far = jnp.asarray([0.0, 0.9] if given_any else [])
        certificate = GOOD._replace(landmarks=far)
        match = Match(there, np.argsort(there), jnp.eye(3), certificate)
        return match._replace(confidence_x=likely, confidence_y=likely[::-1])

    monkeypatch.setattr("jfsf.matching.match", match)
    return options


def test_match_takes_a_file_of_each_shape(folder, seen):
    write_landmarks(
        folder / "x.mrk.json",
        Landmarks(("a", "b", "c"), X.vertices[[3, 50, 99]], None, "RAS"),
    )
    write_landmarks(folder / "y.pp", Landmarks(("c", "b"), Y.vertices[[7, 8]] * 1.001))
    args = ["match", folder / "x.ply", folder / "y.ply", "--out", folder / "m.npz"]
    of_x = ["--landmarks-x", folder / "x.mrk.json"]
    of_y = ["--landmarks-y", folder / "y.pp"]
    result = run(*args, *of_x, *of_y)
    assert result.exit_code == 0, result.output
    assert seen["landmarks"].tolist() == [[50, 8], [99, 7]]
    for line in (
        "landmarks: 2 paired by name: b, c",
        "landmarks: without a partner, of X: 'a'",
        "y.pp: its landmarks are within 0.00",
        "of their vertices, the farthest is ",
        "landmark 2 (c) ends far from its partner",
    ):
        assert line in result.stdout

    for options, why in (
        (of_x, "give both"),
        ([*of_x, *of_y, "--landmarks", folder / "a.txt"], "one or the other"),
        (["--landmarks", folder / "y.pp"], "--landmarks-x and --landmarks-y"),
        ([*of_x, "--landmarks-y", folder / "no.pp"], "no.pp: No such file"),
    ):
        result = run(*args, *options)
        assert result.exit_code == 1 and why in result.stderr, result.output
    write_landmarks(folder / "y.pp", Landmarks(("c", "b"), Y.vertices[[7, 8]] * 1000))
    result = run(*args, *of_x, *of_y)
    assert result.exit_code == 1 and "y.pp: landmark 'c' is" in " ".join(
        result.stderr.split()
    )
    write_landmarks(folder / "y.pp", Landmarks(("d", "e"), Y.vertices[[7, 8]]))
    result = run(*args, *of_x, *of_y)
    assert result.exit_code == 1 and "Y has 'd', 'e'" in result.stderr


def test_a_warning_names_the_landmark():
    bad = GOOD._replace(landmarks=jnp.asarray([0.1, 0.9]))
    (said,) = warnings_of(bad, "preserve", landmarks=("a", "b"))
    assert said.startswith("landmark 2 (b) ends far")
    (said,) = warnings_of(bad, "preserve", landmarks=("", ""))
    assert said.startswith("landmark 2 ends far")


def with_strays(mesh):
    """A vertex without a face before all, one within and one behind."""
    v, at = mesh.vertices, N // 2
    vertices = np.concatenate([v[:1] * 1.1, v[:at], v[5:6] * 1.1, v[at:], v[-1:] * 1.1])
    faces = mesh.faces + 1 + (mesh.faces >= at)
    return Mesh(vertices, faces.astype(np.int32))


def test_vertices_without_a_face_go_where_the_nearest_goes(folder, seen):
    stray = folder / "stray.ply"
    export_mesh(stray, with_strays(X))
    kept = np.delete(np.arange(N + 3), [0, N // 2 + 1, N + 2])
    pairs, out = folder / "pairs.txt", folder / "m.npz"
    pairs.write_text(f"x,y\n{kept[100]},7\n")
    args = ("match", stray, folder / "y.ply", "--out", out, "--landmarks", pairs)
    result = run(*args)
    assert result.exit_code == 0, result.output
    assert f"{stray}: 3 vertices without a face left out" in result.stdout
    assert f"{folder / 'y.ply'}: " not in result.stdout  # of Y nothing is to be said
    assert seen["sizes"] == (N, N) and seen["landmarks"].tolist() == [[100, 7]]
    found, there = read_match(out), (np.arange(N) + 5) % N
    assert found.T_xy.shape == (N + 3,) and found.T_yx.shape == (N,)
    assert np.array_equal(found.T_xy[kept], there)
    assert found.T_xy[[0, N // 2 + 1, N + 2]].tolist() == there[[0, 5, N - 1]].tolist()
    assert np.array_equal(found.T_yx, kept[np.argsort(there)])
    with np.load(out) as file:
        assert not {"index_x", "index_y"} & set(file)

    # A page that is made later shows the kept vertices.
    shapes = (matchable(path, False) for path in (stray, folder / "y.ply"))
    back = kept_match(found, *shapes)
    assert np.array_equal(back.T_xy, there)
    assert np.array_equal(back.T_yx, np.argsort(there))
    assert np.allclose(back.confidence_x, np.linspace(0, 1, N))

    # A file of each shape counts the vertices of the file too.
    for side, rows in (("x", f"a,{kept[100]}\nb,{kept[7]}\n"), ("y", "b,8\na,9\n")):
        (folder / f"{side}.csv").write_text(rows)
    files = "--landmarks-x", folder / "x.csv", "--landmarks-y", folder / "y.csv"
    assert run(*args[:5], *files).exit_code == 0
    assert seen["landmarks"].tolist() == [[100, 9], [7, 8]]

    pairs.write_text("0 7\n")
    result = run(*args)
    assert result.exit_code == 1 and "belongs to no face" in result.stderr


def test_evaluate_measures_without_stray_vertices(folder):
    stray, kept = folder / "stray.ply", np.delete(np.arange(N + 3), [0, N // 2 + 1])[:N]
    export_mesh(stray, with_strays(X))
    figures = []
    for path, T_xy, T_yx, points in (
        (folder / "x.ply", np.arange(N), np.arange(N), np.arange(N)),
        (stray, np.zeros(N + 3, int), kept, kept),
    ):
        T_xy[points] = np.arange(N)
        np.savez(folder / "m.npz", T_xy=T_xy, T_yx=T_yx)
        for name, own in (("x", points), ("y", np.arange(N))):
            # The last point of the second lies on a vertex without a face.
            lost = [N + 3] if len(T_xy) > N and name == "x" else [1]
            np.savetxt(folder / f"{name}.vts", [*(own + 1), *lost], "%d")
        files = [path, folder / "y.ply", folder / "m.npz", "--json", folder / "m.json"]
        truth = ["--gt-x", folder / "x.vts", "--gt-y", folder / "y.vts"]
        result = run("evaluate", *files, *truth)
        assert result.exit_code == 0, result.output
        figures.append(json.loads((folder / "m.json").read_text())["figures"])
    assert figures[0] == pytest.approx(figures[1])
    assert np.isfinite(list(figures[1].values())).all()


def test_info_says_that_stray_vertices_are_left_out(folder):
    stray = folder / "stray.ply"
    export_mesh(stray, with_strays(X))
    result = run("info", stray)
    assert result.exit_code == 0, result.output
    assert "vertices without a face: match leaves out 3" in result.stdout
    assert "can be matched" in result.stdout


def test_nothing_else_is_mended():
    mesh = with_strays(X)
    found = without_strays(mesh)
    assert np.array_equal(found.mesh.vertices, X.vertices)
    assert np.array_equal(found.mesh.faces, X.faces)
    assert np.array_equal(found.partner[found.index], np.arange(N))
    assert (found.partner < 0).sum() == 3 and len(found.done) == 1
    same = without_strays(X)
    assert same.done == () and np.array_equal(same.mesh.faces, X.faces)
    cloud = Mesh(X.vertices, np.zeros((0, 3), np.int32))
    assert without_strays(cloud).done == ()
