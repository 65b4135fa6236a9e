"""Landmarks of a collection: how sure they are, and beside those that people placed."""

import csv
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from jfsf import testing
from jfsf.apps.cli._collection_carried import points_of
from jfsf.apps.cli._collection_check import checked_rows, write_check
from jfsf.apps.cli._collection_landmarks import (
    OnShapes,
    doubtful,
    landmarks_on,
    write_doubtful,
    write_landmarks_of,
)
from jfsf.apps.cli._collection_people import (
    ByPeople,
    file_of_template,
    mirrored_with,
    placed_by_people,
)
from jfsf.apps.landmarks import Landmarks, read_landmarks, write_landmarks
from jfsf.apps.morphometrics._procrustes import centroid_size
from jfsf.mesh import surface_area
from jfsf.types import Mesh

BLOB = testing.blob(0)
N = len(BLOB.vertices)
AT = np.array([3, 40, 77, 110])
MARKS = Landmarks(("a", "b", "c", "d"), None, AT)


def moved(scale=1.0, by=0.0):
    return Mesh(scale * (BLOB.vertices * [1, 1.1, 0.9] + by), BLOB.faces)


def put(out, name, vertices, bridged=(), *, parts=("registered", "placed"), radius=0.1):
    """The files of a shape that the template is on."""
    gone = np.isin(np.arange(N), bridged)
    for part in (*parts, "maps"):
        (out / part).mkdir(parents=True, exist_ok=True)
    for part in parts:
        np.savez(out / part / f"{name}.npz", vertices=vertices, bridged=gone)
    np.savez(out / "maps" / f"{name}.npz", radius_x=np.full(N, radius))


def of(out, meshes, trusted=None, others=(), given=None):
    """`landmarks_on`: the first mesh is the template."""
    shapes = {name: SimpleNamespace(mesh=mesh) for name, mesh in meshes.items()}
    graph = SimpleNamespace(
        paths=SimpleNamespace(template=0),
        trusted_maps=lambda i: (trusted or {}).get(i, []),
    )
    return landmarks_on(out, MARKS, shapes, graph, [*meshes], others, given or {})


@pytest.fixture
def three(tmp_path):
    """A template and two shapes, one in other units; by another way "b" lies off."""
    meshes = {"t": BLOB, "b": moved(), "large": moved(20.0)}
    for name, mesh in meshes.items():
        put(tmp_path, name, mesh.vertices)
    off = np.roll(np.arange(N), 1)
    return tmp_path, meshes, {1: [(0, off)], 2: [(0, off)]}


def test_a_radius_is_of_the_map_and_of_all_ways(three):
    out, meshes, trusted = three
    found = of(out, meshes, trusted)
    assert found.specimens == ["b", "large", "t"] and (found.radius[2] == 0).all()
    for i, name in enumerate(("b", "large")):
        vertices = meshes[name].vertices
        np.testing.assert_array_equal(found.points[i], vertices[AT])
        away = np.linalg.norm(vertices[AT - 1] - vertices[AT], axis=1)
        of_map = 0.1 * np.sqrt(surface_area(meshes[name]))
        # One of two ways is so far away.
        length = np.hypot(of_map, away / np.sqrt(2))
        np.testing.assert_allclose(found.radius[i], length)
    np.testing.assert_allclose(found.radius[1], 20 * found.radius[0])
    np.testing.assert_allclose(of(out, meshes).radius[0], of_map / 20)


def test_other_templates_vote_and_people_have_the_last_word(three):
    out, meshes, _ = three
    # By way of both others the first landmark is at the place of the second.
    for name in ("b", "large"):
        for other in ("b", "large"):
            vertices = meshes[other].vertices.copy()
            vertices[AT[0]] = vertices[AT[1]]
            put(out / "templates" / name, other, vertices, parts=["registered"])
    one, three = of(out, meshes), of(out, meshes, others=["b", "large"])
    np.testing.assert_allclose(three.points[:, 1:], one.points[:, 1:], atol=1e-12)
    # Two of three places agree: they are the median.
    np.testing.assert_allclose(three.points[0, 0], one.points[0, 1], atol=1e-12)
    assert three.radius[0, 0] > one.radius[0, 0]
    np.testing.assert_allclose(three.radius[0, 1:], one.radius[0, 1:])
    given = {"b": ByPeople(Path("b.csv"), np.array([2]), np.ones((1, 3)), [])}
    held = of(out, meshes, others=["large"], given=given)
    assert (held.points[0, 2] == 1).all() and held.radius[0, 2] == 0
    assert (held.radius[0, [0, 1, 3]] > 0).all()


def test_what_most_templates_have_no_surface_for_is_missing(three):
    out, meshes, _ = three
    near = np.unique(BLOB.faces[(BLOB.faces == AT[0]).any(1)])
    put(out, "large", meshes["large"].vertices, [*near, AT[1]])
    for name, holes in (("t2", near), ("t3", [])):
        meshes[name] = BLOB
        put(out, name, BLOB.vertices)
        for one in meshes:
            gone = holes if one == "large" else []
            on = meshes[one].vertices
            put(out / "templates" / name, one, on, gone, parts=["registered"])
    found = of(out, meshes, others=["t2", "t3"])
    missing = np.isnan(found.points[found.specimens.index("large")]).all(1)
    assert missing.tolist() == [True, False, False, False]
    unknown = np.isnan(found.radius[found.specimens.index("large")])
    assert unknown.tolist() == [True, False, False, False]


@pytest.mark.parametrize("end", [".mrk.json", ".tps"])
def test_landmarks_are_written_of_each_and_of_all(tmp_path, end):
    shift = BLOB.vertices + [1.0, 2.0, 3.0]
    meshes = {"t": BLOB, "scan": Mesh(shift, BLOB.faces), "torn": moved()}
    put(tmp_path, "t", BLOB.vertices)
    put(tmp_path, "scan", shift)
    put(tmp_path, "torn", meshes["torn"].vertices, [AT[1]])
    found = of(tmp_path, meshes)
    write_landmarks_of(tmp_path, found, MARKS, Path(f"template{end}"))
    each = {path.name for path in (tmp_path / "landmarks").iterdir()}
    ends = {end, ".mrk.json", ".fcsv"}
    assert each == {name + end for name in meshes for end in ends}
    for one in sorted(ends):
        own = read_landmarks(tmp_path / "landmarks" / f"scan{one}")
        np.testing.assert_allclose(own.points, shift[AT], atol=1e-5)
        torn = read_landmarks(tmp_path / "landmarks" / f"torn{one}")
        assert len(torn.names) == 3
    # As R reads it, a row a specimen; what is missing is NA, never 0.
    with (tmp_path / "landmarks.csv").open() as file:
        title, scan, _, torn = csv.reader(file)
    assert title[1:] == [f"{name}_{axis}" for name in "abcd" for axis in "xyz"]
    np.testing.assert_allclose(np.array(scan[1:], float), shift[AT].ravel())
    assert scan[0] == "scan" and torn[0] == "torn" and torn[4:7] == ["NA"] * 3
    with (tmp_path / "landmarks_radius.csv").open() as file:
        title, *rows = csv.reader(file)
    assert title == ["specimen", *"abcd"] and rows[2][2] == "NA"
    np.testing.assert_allclose(np.array(rows[0][1:], float), found.radius[0])
    lines = (tmp_path / "landmarks.tps").read_text().splitlines()
    assert lines[0] == "LM3=4" and lines[5] == "ID=scan" and lines[14] == "NA NA NA"


def test_the_least_sure_tenth_is_to_be_checked(tmp_path):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(10, 4, 3)) * np.geomspace(1, 1e6, 10)[:, None, None]
    # A landmark that is unsure on all shapes is none of them, and size plays no part.
    radius = centroid_size(points)[:, None] * [0.01, 0.01, 0.01, 0.5]
    radius[3, 1] *= 3
    radius[7, 3] *= 2
    radius[5] = points[5] = np.nan
    radius[6, 0] = 0  # placed by people
    found = OnShapes(
        [f"s{i}" for i in range(10)], list("abcd"), points, radius, points[0]
    )
    rows = doubtful(found)
    assert len(rows) == 4  # of 35
    assert [(row["specimen"], row["landmark"]) for row in rows[:2]] == [
        ("s3", "b"),
        ("s7", "d"),
    ]
    assert rows[0]["times_median"] == pytest.approx(3)
    assert rows[0]["of_size"] == pytest.approx(0.03)
    said = write_doubtful(tmp_path, found)
    assert "s3, b: within" in said[1] and len(said) == 5
    with (tmp_path / "to_check.csv").open() as file:
        assert [row["specimen"] for row in csv.DictReader(file)][:2] == ["s3", "s7"]
    # In one shape alone there is no median: the largest come first.
    alone = found._replace(specimens=["s1"], points=points[1:2], radius=radius[1:2])
    assert doubtful(alone)[0]["landmark"] == "d"
    unknown = found._replace(radius=np.full_like(radius, np.nan))
    assert "not known" in write_doubtful(tmp_path, unknown)[0]


def turned(points):
    """By a similarity: 3 times as large, a quarter turn, moved."""
    return 3 * points[:, [1, 0, 2]] * [-1, 1, 1] + [5.0, 0.0, -2.0]


def test_errors_are_those_of_known_shifts(tmp_path):
    goal = turned(BLOB.vertices)
    meshes = {"t": BLOB, "s": Mesh(goal, BLOB.faces), "other": moved()}
    for name, mesh in meshes.items():
        put(tmp_path, name, mesh.vertices)
    put(tmp_path, "s", goal + 0.01)  # the map's own pose
    found = of(tmp_path, meshes)
    found.points[found.specimens.index("s")] = goal[AT] + [[0.3], [0.0], [0.0], [0.0]]
    own = ByPeople(Path("s.csv"), np.arange(4), goal[AT], [])
    two = ByPeople(
        Path("o.csv"), np.array([2, 0]), meshes["other"].vertices[AT[[2, 0]]], []
    )
    people = {"s": own, "other": two, "t": own}
    shapes = {name: SimpleNamespace(mesh=mesh) for name, mesh in meshes.items()}
    rows = checked_rows(tmp_path, found, people, shapes, "t", ())
    assert [row["specimen"] + row["landmark"] for row in rows] == [
        *("otherc", "othera"),
        *("sa", "sb", "sc", "sd"),
    ]
    error = np.array([row["error"] for row in rows])
    np.testing.assert_allclose(error, [0, 0, 0.3 * np.sqrt(3), 0, 0, 0], atol=1e-12)
    assert rows[2]["of_size"] == pytest.approx(error[2] / centroid_size(goal[AT]))
    within = [row["within"] for row in rows]
    assert within == [1.0] * 6  # 0.1 of sqrt(area)
    # Of the same form the two simple methods leave nothing.
    for simple in ("similarity", "icp"):
        np.testing.assert_allclose([row[simple] for row in rows[2:]], 0, atol=1e-3)
    assert np.isnan(rows[0]["similarity"]) and rows[0]["icp"] > 0
    tables, said = write_check(tmp_path, found, people, shapes, "t", ())
    assert len(tables) == 2 and "6 landmarks that people placed on 2 shapes" in said[0]
    assert "100% of the errors are within the radius" in said[0]
    assert any("no better than the best similarity" in line for line in said)
    # On the screen of 80 columns no title and no name of a shape is cut.
    shown, longest = Console(width=80, record=True), "Lontra_canadensis_4711"
    tables[0].add_row(longest, *["100.00%"] * 7)
    shown.print(tables[0])
    text = shown.export_text()
    assert "…" not in text and "similarity" in text and "unit of the files" in text
    assert max(map(len, text.splitlines())) <= 80
    with (tmp_path / "check.csv").open() as file:
        assert [row["similarity"] for row in csv.DictReader(file)][:2] == ["NA", "NA"]
    rows = checked_rows(tmp_path, found, people, shapes, "t", {"s": own})
    assert {row["specimen"] for row in rows} == {"other"}
    assert write_check(tmp_path, found, {}, shapes, "t", ()) == ([], [])
    assert not (tmp_path / "check.csv").exists()


def test_a_similarity_leaves_what_it_must_and_a_better_map_is_said_to_be(tmp_path):
    meshes = {"t": BLOB, "other": moved()}
    for name, mesh in meshes.items():
        put(tmp_path, name, mesh.vertices)
    shapes = {name: SimpleNamespace(mesh=mesh) for name, mesh in meshes.items()}
    true = ByPeople(Path("o.csv"), np.arange(4), meshes["other"].vertices[AT], [])
    found = of(tmp_path, meshes)
    rows = checked_rows(tmp_path, found, {"other": true}, shapes, "t", ())
    least = sum(row["similarity"] ** 2 for row in rows)
    for pose in (BLOB.vertices, 0.98 * BLOB.vertices, BLOB.vertices + 0.01):
        assert 0 < least < ((pose[AT] - true.points) ** 2).sum()
    assert all(row["icp"] > 0 for row in rows)
    said = write_check(tmp_path, found, {"other": true}, shapes, "t", ())[1]
    assert said[-1] == "the map is better than both on each shape and for each landmark"


def test_landmarks_off_the_template_are_named(tmp_path):
    import trimesh

    mesh, file = tmp_path / "t.ply", tmp_path / "t.csv"
    trimesh.Trimesh(*BLOB, process=False).export(mesh)
    points = BLOB.vertices[[0, 9, 30]].astype(float)
    size = np.linalg.norm(np.ptp(BLOB.vertices, axis=0))
    outward = points[1] - BLOB.vertices.mean(0)
    outward /= np.linalg.norm(outward)
    for share, said in ((0.0, ""), (0.03, "landmark 'b' is .*% of the diagonal")):
        points[1] = BLOB.vertices[9] + share * size * outward
        write_landmarks(file, Landmarks(("a", "b", "c"), points))
        lines = points_of(file, mesh).said
        assert len(lines) == bool(said) and re.match(said, "".join(lines))
    write_landmarks(file, Landmarks(("a", "b", "c"), points + 9 * size))
    with pytest.raises(ValueError, match=r"t\.csv: landmark .* is the file of another"):
        points_of(file, mesh)


def test_files_of_people_are_found_by_the_names_of_shapes(tmp_path):
    import trimesh

    folder, mesh = tmp_path / "marks", tmp_path / "s.1.ply"
    trimesh.Trimesh(*BLOB, process=False).export(mesh)
    (tmp_path / "broken.ply").write_text("ply")
    paths = {"s.1": mesh, "broken": tmp_path / "broken.ply"}
    template = Landmarks(("a", "b", "c"), BLOB.vertices[:3])
    read = lambda: placed_by_people(folder, paths, template)
    assert placed_by_people(None, paths, template) == {}
    with pytest.raises(ValueError, match="needed on the template"):
        placed_by_people(folder, paths, None)
    with pytest.raises(ValueError, match="is no folder"):
        read()
    folder.mkdir()
    with pytest.raises(ValueError, match="such as s.1.fcsv; it has none"):
        read()
    write_landmarks(folder / "another.csv", template)
    with pytest.raises(ValueError, match=r"such as s.1.fcsv; it has another.csv"):
        read()
    with pytest.raises(ValueError, match=r"no landmarks of the template, such as t.f"):
        file_of_template(folder, Path("t.ply"))
    assert file_of_template(folder, Path("another.ply")) == folder / "another.csv"
    assert file_of_template(folder / "another.csv", Path("t.ply")).name == "another.csv"
    write_landmarks(folder / "broken.csv", template)  # the run says why it is left out
    own = Landmarks(("c", "new", "a"), BLOB.vertices[[2, 9, 0]])
    write_landmarks(folder / "s.1.mrk.json", own)
    (found,) = read().items()
    assert found[0] == "s.1" and found[1].rows.tolist() == [0, 2]
    np.testing.assert_allclose(found[1].points, BLOB.vertices[[0, 2]], atol=1e-6)
    assert found[1].said == [
        f"{folder / 's.1.mrk.json'}: has no landmark 'b'",
        f"{folder / 's.1.mrk.json'}: the template has no landmark 'new'",
    ]
    slid = placed_by_people(folder, paths, template, [1])["s.1"]
    assert len(slid.said) == 1  # nobody need place those that slide
    mirrored = mirrored_with(read(), {"s.1"})["s.1"].points
    np.testing.assert_allclose(mirrored, found[1].points * [-1, 1, 1])
    write_landmarks(folder / "s.1.csv", own)
    with pytest.raises(ValueError, match="take one away"):
        read()
    (folder / "s.1.mrk.json").unlink()
    far = Landmarks(("a",), np.full((1, 3), 99.0))
    write_landmarks(folder / "s.1.csv", far)
    with pytest.raises(ValueError, match=r"s.1.csv: landmark 'a' is .* from the mesh"):
        read()
    write_landmarks(folder / "s.1.csv", Landmarks(("x",), BLOB.vertices[:1]))
    with pytest.raises(ValueError, match=r"s.1.csv: no landmark has the same name"):
        read()
    (folder / "s.1.csv").write_text("name,vertex\na,7\n")
    np.testing.assert_allclose(read()["s.1"].points, BLOB.vertices[[7]], atol=1e-6)
