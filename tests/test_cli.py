"""The command line on small bodies: its files, its output and its errors."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from io import StringIO
from pathlib import Path
from unittest import mock

import fast_simplification
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from rich.console import Console
from scipy.spatial import KDTree
from shapes import write_off
from typer.testing import CliRunner

from jfsf import __version__
from jfsf._figures import FIGURES
from jfsf.apps.cli._app import app
from jfsf.apps.cli._print import certificate_table, stage_bar
from jfsf.apps.cli._runs import doubtful_first
from jfsf.apps.export import export_mesh
from jfsf.apps.mapfiles import read_map, read_match, write_map
from jfsf.apps.plot._colours import body_colours, texture_coordinates
from jfsf.apps.plot._frames import frame
from jfsf.apps.report._words import warnings_of
from jfsf.data import Sample, load
from jfsf.evaluate import geodesic_error
from jfsf.matching import match
from jfsf.mesh import closest, read
from jfsf.mesh._closest import surface_tree
from jfsf.testing import blob
from jfsf.types import Certificate, Mesh

ROOT = Path(__file__).parents[1]
PAIR = ("man_walk", "man_up")
FACES = {"man_walk": 1400, "man_up": 1340}  # which leave clean manifolds
VALUES = {
    "region_cost": np.nan,
    "empty": 0,
    "bijectivity_x": 0.01,
    "bijectivity_y": 0.01,
    "orientation": 0.97,
    "finite": True,
    "rivals": 0,
    "mirrored": 0.0,
    "spectrum_gap": 0.1,
    "landmarks": np.zeros(0),
}
GOOD = Certificate(*(jnp.asarray(VALUES.get(n, 0.9)) for n in Certificate._fields))


def run(*args):
    # As in a process of its own: float32.
    with jax.enable_x64(False):
        return CliRunner().invoke(app, [str(arg) for arg in args])


def refused(*args):
    """stderr of a command that bad input ends: one line, exit code 1."""
    result = run(*args)
    assert result.exit_code == 1, result.output
    assert re.fullmatch(r"jfsf: [^\n]+\n", result.stderr), result.stderr
    return result.stderr


def small(name):
    sample = load(name)
    vertices, faces = fast_simplification.simplify(
        *sample.mesh, target_count=FACES[name], agg=3
    )[:2]
    vertices, faces = vertices.astype(np.float64), faces.astype(np.int32)
    points = sample.mesh.vertices[sample.template_to_vertex]
    return Sample(Mesh(vertices, faces), np.asarray(KDTree(vertices).query(points)[1]))


@pytest.fixture(scope="module")
def shapes():
    return {name: small(name) for name in PAIR}


@pytest.fixture(scope="module")
def returned():
    """What `jfsf.match` has returned to `jfsf match`, in a list."""
    return []


@pytest.fixture(scope="module")
def folder(tmp_path_factory, shapes, returned, all_run_once):
    """Meshes, ground truth, and the files and output of `jfsf match` for them."""
    folder = tmp_path_factory.mktemp("cli")
    for name, sample in shapes.items():
        write_off(folder / f"{name}.off", sample.mesh)
        write_map(folder / f"{name}.vts", sample.template_to_vertex)
    x, y = (folder / f"{name}.off" for name in PAIR)
    args = ("--out", folder / "map.npz", "--png", folder / "map.png", "--no-cache")
    args += ("--export", folder / "x.ply", "--export", folder / "x.glb")

    def noted(*given, **options):
        returned.append(match(*given, **options))
        return returned[-1]

    with mock.patch("jfsf.matching.match", noted):
        result = run("match", x, y, *args)
    assert result.exit_code == 0, result.output
    (folder / "output.txt").write_text(result.stdout)
    return folder


@pytest.fixture
def x(folder):
    return folder / "man_walk.off"


@pytest.fixture
def y(folder):
    return folder / "man_up.off"


def test_match_writes_the_maps_a_picture_and_a_plain_certificate(folder, x, y):
    found = read_match(folder / "map.npz")
    assert len(found.T_xy) == len(read(x).vertices)
    assert len(found.T_yx) == len(read(y).vertices)
    assert found.T_xy.dtype == np.int32
    assert (folder / "map.png").read_bytes().startswith(b"\x89PNG")
    shown = (folder / "output.txt").read_text()
    assert "keeps left and right" in shown and "warning" not in shown
    for name in FIGURES:
        assert name in shown


def test_match_exports_x_in_the_colours_of_y(folder, x, y):
    T_xy = read_match(folder / "map.npz").T_xy
    colours = body_colours(read(y).vertices)[T_xy]
    for name in ("x.ply", "x.glb"):
        np.testing.assert_allclose(read(folder / name).vertices, read(x).vertices)
        np.testing.assert_array_equal(read(folder / name).faces, read(x).faces)
        assert f"wrote {folder / name}" in (folder / "output.txt").read_text()
    found = trimesh.load(folder / "x.ply", process=False).visual.vertex_colors
    assert np.abs(found[:, :3] / 255 - colours).max() < 0.51 / 255


def test_float32_finds_the_truth_with_the_default_settings(shapes, folder, returned):
    (_, gt_x), (mesh_y, gt_y) = shapes.values()
    (found,) = returned
    assert found.C_yx.dtype == jnp.float32 and found.certificate.finite
    at = slice(None, None, 20)
    assert geodesic_error(found.T_xy, mesh_y, gt_x[at], gt_y[at]).mean() < 0.03
    written = read_match(folder / "map.npz")
    assert np.array_equal(written.T_xy, found.T_xy)
    # The command says in words what the file has in numbers.
    assert written.info.sources == found.info.sources == ["search"]
    assert "One start was attempted (search)." in (folder / "output.txt").read_text()


def test_evaluate_measures_the_match_against_ground_truth(folder, x, y):
    args = ("evaluate", x, y, folder / "map.npz", "--every", 10)
    truth = ("--gt-x", folder / "man_walk.vts", "--gt-y", folder / "man_up.vts")
    result = run(*args, *truth, "--json", folder / "figures.json")
    assert result.exit_code == 0, result.output
    record = json.loads((folder / "figures.json").read_text())
    figures = record["figures"]
    assert record["every"] == 10 and record["geodesics"] == "heat method"
    assert figures["error_mean"] < 0.06
    assert figures["bijectivity_x"] < 0.02 < 0.8 < figures["coverage_xy"]
    assert {"auc_0.25", "smoothness", "orthogonality"} < set(figures)
    for name in figures:
        assert name.replace("_", " ") in result.stdout

    plain = run(*args)
    assert plain.exit_code == 0 and "error" not in plain.stdout
    exact = run(*args[:4], "--every", 200, "--exact", *truth)
    assert exact.exit_code == 0, exact.output


def test_evaluate_takes_a_plain_map_in_either_base(folder, x, y):
    T_xy = read_match(folder / "map.npz").T_xy
    write_map(folder / "one.map", T_xy)
    write_map(folder / "zero.map", T_xy, base=0)
    one = run("evaluate", x, y, folder / "one.map")
    zero = run("evaluate", x, y, folder / "zero.map", "--base", 0)
    assert one.exit_code == zero.exit_code == 0
    assert "bijectivity" not in one.stdout
    assert one.stdout.splitlines()[2:] == zero.stdout.splitlines()[2:]


def test_evaluate_refuses_what_does_not_fit(folder, x, y):
    found = folder / "map.npz"
    assert "the map runs the other way" in refused("evaluate", y, x, found)
    assert "both --gt-x and --gt-y" in refused("evaluate", x, y, found, "--gt-x", x)
    assert "none.npz" in refused("evaluate", x, y, folder / "none.npz")
    assert "written as .json" in refused(
        "evaluate", x, y, found, "--json", folder / "a.txt"
    )
    assert run("evaluate", x, y, found, "--every", 0).exit_code == 2
    with np.load(found) as file:
        arrays = dict(file)
    n = len(arrays["T_xy"])
    for name, wrong in (
        ("index_x", np.arange(n) + 0.5),
        ("index_x", np.arange(n).astype(str)),
        ("index_x", np.zeros(0, int)),
        ("index_x", np.zeros((n, 2), int)),
        ("index_x", np.arange(n - 1)),
        ("C_yx", np.array("a")),
        ("C_yx", np.zeros((0, 5))),
        ("C_yx", arrays["C_yx"] * np.nan),
    ):
        np.savez(folder / "wrong.npz", **arrays | {name: wrong})
        said = refused("evaluate", x, y, folder / "wrong.npz")
        assert str(folder / "wrong.npz") in said and name in said


@pytest.fixture
def in_pieces(folder, shapes):
    """man_up with a triangle in front of its first vertex."""
    vertices, faces = shapes["man_up"].mesh
    flake = np.array([[9.0, 9, 9], [9.1, 9, 9], [9, 9.1, 9]])
    mesh = Mesh(np.r_[flake, vertices], np.r_[[[0, 1, 2]], faces + 3])
    write_off(path := folder / "pieces.off", mesh)
    return path


def test_largest_component_writes_kept_vertices_and_their_numbers(
    folder, x, y, in_pieces
):
    out = folder / "kept.npz"
    args = ("match", x, in_pieces, "--out", out, "--no-cache")
    assert "--largest-component" in refused(*args)
    result = run(*args, "--largest-component")
    assert result.exit_code == 0, result.output
    plain, kept = read_match(folder / "map.npz"), read_match(out)
    assert np.array_equal(kept.T_xy, plain.T_xy)
    n_x, n_y = len(plain.T_xy), len(plain.T_yx)
    with np.load(out) as file:
        assert np.array_equal(file["index_x"], np.arange(n_x))
        assert np.array_equal(file["index_y"], np.arange(n_y) + 3)

    shifted = read_map(folder / "man_up.vts") + np.int32(3)
    write_map(folder / "pieces.vts", shifted)
    figures = []
    for target, found, truth in ((y, "map", "man_up"), (in_pieces, "kept", "pieces")):
        path = folder / f"{found}.json"
        result = run(
            *("evaluate", x, target, folder / f"{found}.npz", "--every", 50),
            *("--gt-x", folder / "man_walk.vts", "--gt-y", folder / f"{truth}.vts"),
            *("--json", path),
        )
        assert result.exit_code == 0, result.output
        figures.append(json.loads(path.read_text())["figures"])
    assert figures[0] == pytest.approx(figures[1])


def test_a_bar_names_each_stage():
    text = StringIO()
    console = Console(file=text, force_terminal=True, width=80)
    with stage_bar(console) as begin:
        for name in ("spectra", "search"):
            begin(name)
    for name in ("spectra", "search"):
        assert name in text.getvalue()


def test_match_passes_its_options_on(folder, x, y, in_pieces, monkeypatch):
    found = read_match(folder / "map.npz")
    seen = {}

    def match(mesh_x, mesh_y, **options):
        seen.update(options)
        return found

    monkeypatch.setattr("jfsf.matching.match", match)
    pairs = folder / "pairs.txt"
    pairs.write_text("# head, foot\n3 8\n\n4 9  # knee\n")
    args = ("match", x, y, "--out", folder / "m.npz", "--landmarks", pairs)
    result = run(*args, "--orientation", "reverse")
    assert result.exit_code == 0, result.output
    assert seen["orientation"] == "reverse" and seen["cache"] and seen["progress"]
    assert seen["landmarks"].tolist() == [[3, 8], [4, 9]]
    assert "warning: orientation" in result.stdout

    exports = ("--export", folder / "c.obj", "--export", folder / "c.glb")
    assert run(*args[:5], *exports, "--checker", "--up", "z").exit_code == 0
    (carried,) = trimesh.load(folder / "c.glb").geometry.values()
    body = read(y).vertices @ frame("z")
    uv = 8 * texture_coordinates(body)[found.T_xy]
    np.testing.assert_allclose(carried.visual.uv, uv, atol=1e-5)
    assert (folder / "c_checker.png").exists()

    args = ("match", x, in_pieces, *args[3:], "--largest-component")
    assert run(*args).exit_code == 0
    assert seen["landmarks"].tolist() == [[3, 5], [4, 6]]
    pairs.write_text("3 2\n")
    assert "vertex 2 of Y is not in the largest piece" in refused(*args)
    for text in ("1 2 3\n", "1\n", "a b\n", "", "1 2\n3\n", "1 -2\n", "1_0 2\n"):
        pairs.write_text(text)
        assert "a vertex of X and one of Y" in refused(*args)
    for data in ("\u0663 1\n".encode(), b"1 " + b"9" * 30):
        pairs.write_bytes(data)
        assert "a vertex of X and one of Y" in refused(*args)
    pairs.write_bytes(b"\xff\xfe\n")
    assert "is not UTF-8" in refused(*args)


@pytest.fixture
def no_search(monkeypatch):
    """Reports without candidates: their search is tested elsewhere."""
    monkeypatch.setattr("jfsf.apps.report._page.candidate_maps", lambda *_, **__: [])


def record_of(page):
    _, _, rest = page.read_text().partition('id="record">')
    return json.loads(rest.partition("</script>")[0])


def test_match_registers_on_request(folder, x, y, monkeypatch):
    found = read_match(folder / "map.npz")
    monkeypatch.setattr("jfsf.matching.match", lambda *_, **__: found)
    warped = folder / "warped.ply"
    args = ("match", x, y, "--out", folder / "m.npz", "--register")
    result = run(*args, warped)
    assert result.exit_code == 0, result.output
    assert f"wrote {warped}" in result.stdout and "flipped faces" in result.stdout
    on_y, own, scan = map(read, (warped, x, y))
    assert (on_y.faces == own.faces).all()
    assert closest(surface_tree(scan), on_y.vertices).distance.mean() < 0.01
    copy = folder / "registered_copy.ply"
    export_mesh(copy, read(y))
    args = "match", x, copy, "--out", folder / "m.npz", "--register"
    assert "is an input" in refused(*args, copy)


def test_match_writes_a_report(folder, x, y, in_pieces, monkeypatch, no_search):
    found = read_match(folder / "map.npz")
    monkeypatch.setattr("jfsf.matching.match", lambda *_, **__: found)
    page = folder / "map.html"
    args = ("match", x, y, "--out", folder / "m.npz", "--report", page)
    truth = ("--gt-x", folder / "man_walk.vts", "--gt-y", folder / "man_up.vts")
    result = run(*args, *truth)
    assert result.exit_code == 0, result.output
    assert f"wrote {page}" in result.stdout
    plain = record_of(page)
    assert plain["title"] == "man_walk to man_up" and plain["seconds"]["matching"] >= 0
    assert plain["scene"]["y"]["numbers"] is None

    # The same, of a part of the mesh, whose vertices the page counts as the file does.
    write_map(folder / "pieces.vts", read_map(folder / "man_up.vts") + np.int32(3))
    args = ("match", x, in_pieces, *args[3:], "--largest-component")
    result = run(*args, *truth[:2], "--gt-y", folder / "pieces.vts")
    assert result.exit_code == 0, result.output
    part = record_of(page)
    assert part["truth"] == plain["truth"] and part["scene"]["y"]["numbers"]

    assert "both --gt-x and --gt-y" in refused(*args, *truth[:2])
    assert "for the report" in refused(*args[:5], *truth)
    assert "written as .html" in refused(*args[:5], "--report", folder / "a.pdf")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "jfsf[viz]" in refused(*args[:5], "--report", page)


def test_batch_writes_pages_and_an_index(folder, x, y, monkeypatch, no_search):
    from jfsf.apps.cli._batch_jobs import is_complete, is_matched, work
    from jfsf.apps.cli._pair import pages_of
    from jfsf.apps.cli._runs import batch_index
    from jfsf.batch._jobs import Job
    from jfsf.batch._pair_list import PairOptions

    found, calls = read_match(folder / "map.npz"), []
    monkeypatch.setattr(
        "jfsf.matching.match", lambda *_, **__: calls.append(1) or found
    )
    (out := folder / "many").mkdir()
    given = PairOptions("preserve", False, False, False)
    job = Job((x, y), out / "a__b.npz", options=given)
    is_reported = lambda job: is_complete(job, {"report": True})
    work(job)
    assert is_matched(job) and not is_reported(job)
    work(job, {"report": True})  # makes the page only
    assert is_reported(job) and len(calls) == 1
    page, picture = pages_of(job.out)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert record_of(page)["x"]["name"] == "man_walk"
    row = {"x": str(x), "y": str(y), "reason": "", "file": "a__b.npz"}
    row |= {"confidence": 0.9, "warnings": ["look"]}
    failed = row | {"reason": "no file", "file": "", "confidence": None}
    listed = record_of(batch_index(out, [row, failed]))["rows"]
    assert listed[0]["lines"] == ["no file"] and listed[0]["page"] is None
    assert listed[1]["page"] == "report/a__b.html" and listed[1]["lines"] == ["look"]
    assert all((out / listed[1][name]).exists() for name in ("page", "picture"))
    page.unlink()
    assert not is_reported(job)


def test_match_refuses_before_it_works(folder, x, y, monkeypatch):
    out = ("--out", folder / "m.npz")
    assert "none.off: does not exist" in refused("match", x, folder / "none.off", *out)
    assert "written as .npz" in refused("match", x, y, "--out", folder / "m.txt")
    assert "no folder" in refused("match", x, y, "--out", folder / "no" / "m.npz")
    assert "written as .png" in refused("match", x, y, *out, "--png", folder / "a.jpg")
    export = (*out, "--export")
    assert "exported as .ply, .obj, .glb, not '.off'" in refused(
        "match", x, y, *export, x
    )
    assert "no folder" in refused("match", x, y, *export, folder / "no" / "a.ply")
    assert "no texture" in refused(
        "match", x, y, *export, folder / "a.ply", "--checker"
    )
    assert "goes with --export" in refused("match", x, y, *out, "--checker")
    copy = folder / "copy.ply"
    export_mesh(copy, read(y))
    assert "copy.ply: is an input" in refused("match", x, copy, *export, copy)
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # as if not installed
    assert "jfsf[viz]" in refused("match", x, y, *out, "--png", folder / "a.png")
    assert run("match", x, y).exit_code == 2
    assert run("match", x, y, *out, "--orientation", "left").exit_code == 2


@pytest.fixture
def read_only(tmp_path, monkeypatch):
    """A folder in which no file can be made."""
    folder = tmp_path / "read only"
    folder.mkdir()
    folder.chmod(0o555)
    if os.access(folder, os.W_OK):
        # Root writes anywhere, so for root a read-only system is played.
        real = Path.open

        def refusing(path, mode="r", *args, **options):
            if path.parent == folder and "x" in mode:
                raise OSError(errno.EROFS, "Read-only file system", str(path))
            return real(path, mode, *args, **options)

        monkeypatch.setattr(Path, "open", refusing)
    yield folder
    folder.chmod(0o755)


def test_what_cannot_be_written_is_said_before_the_work(
    folder, x, y, read_only, tmp_path, monkeypatch
):
    def never(*_, **__):
        raise AssertionError("the work was done")

    for work in (
        "matching.match",
        "apps.cli._demo.measure",
        "apps.cli._evaluate.figures_of",
    ):
        monkeypatch.setattr(f"jfsf.{work}", never)
    monkeypatch.setattr("jfsf.batch._cluster.connect", never)
    (pairs := folder / "one.csv").write_text(f"{x.name},{y.name}\n")
    (tmp_path / "file").touch()
    (tmp_path / "folder.npz").mkdir()
    found, out = folder / "map.npz", tmp_path / "m.npz"
    for place in (read_only, read_only / "new" / "deeper", tmp_path / "file"):
        commands = [("demo", "--out", place), ("batch", pairs, "--out", place)]
        if place.parent == tmp_path:
            commands += [
                ("match", x, y, "--out", place / "m.npz"),
                ("match", x, y, "--out", out, "--png", place / "m.png"),
                ("evaluate", x, y, found, "--json", place / "figures.json"),
            ]
        for command in commands:
            said = refused(*command)
            assert f"{place}" in said and ".tmp" not in said
            assert "cannot be written" in said or "no folder" in said
    said = refused("match", x, y, "--out", tmp_path / "folder.npz")
    assert "folder.npz: cannot be written (Is a directory)" in said
    assert not list(read_only.iterdir()) and not out.exists()


def test_info_says_whether_a_mesh_can_be_matched(folder, x, in_pieces):
    result = run("info", x)
    assert result.exit_code == 0 and "can be matched" in result.stdout
    assert "closed" in result.stdout and "nonmanifold edges" in result.stdout
    result = run("info", in_pieces)
    assert result.exit_code == 1
    assert "cannot be matched" in result.stdout
    assert "match --largest-component" in result.stdout
    few = folder / "few.off"
    write_off(few, Mesh(np.eye(3), np.array([[0, 1, 2]])))
    result = run("info", few)
    assert result.exit_code == 1 and "matching needs 160" in result.stdout
    cloud = folder / "cloud.off"
    filled = np.random.default_rng(0).random((300, 3))
    for points, words in (
        (blob().vertices, "tells left from right"),
        (filled, "no left can be told from right"),
    ):
        write_off(cloud, Mesh(points, np.zeros((0, 3), int)))
        result = run("info", cloud)
        assert result.exit_code == 0 and words in result.stdout
    assert "none.off" in refused("info", folder / "none.off")


def test_info_says_that_a_mesh_is_one_sided(folder):
    turn, across = np.meshgrid(np.arange(100), [-1, 0, 1], indexing="ij")
    angle, side = 2 * np.pi * turn.ravel() / 100, across.ravel() / 4
    radius = 1 + side * np.cos(angle / 2)
    strip = (radius * np.cos(angle), radius * np.sin(angle), side * np.sin(angle / 2))
    faces = []
    for i in range(100):
        for j in range(2):
            a, b = 3 * i + j, 3 * i + j + 1
            c, d = (a + 3, b + 3) if i < 99 else (2 - j, 1 - j)
            faces += [[a, c, b], [b, c, d]]
    write_off(path := folder / "moebius.off", Mesh(np.stack(strip, 1), np.array(faces)))
    result = run("info", path)
    assert (
        result.exit_code == 0
        and "winding of 5% of its area is unclear" in result.stdout
    )


@pytest.mark.parametrize(
    ("change", "orientation", "warning"),
    [
        ({}, "preserve", None),
        ({}, "any", None),
        ({"orientation": -0.97}, "reverse", None),
        ({"orientation": np.nan}, "any", None),
        ({"orientation": 0.3}, "preserve", "swapped"),
        ({"orientation": 0.3}, "any", "swapped"),
        ({}, "reverse", "swapped"),
        ({"confidence": 0.65}, "preserve", "doubtful, confidence 65%"),
        ({"confidence": 0.02}, "preserve", "probably wrong, confidence 2%"),
        ({"confidence": 0.75, "region_cost": -19.0}, "preserve", None),
        ({"confidence": 0.3, "region_cost": -19.0}, "preserve", "the region is prob"),
        ({"finite": False}, "preserve", "not finite"),
        ({"landmarks": [0.1, 0.9]}, "preserve", "landmark 2 ends far"),
        ({"empty": 3}, "preserve", "3 vertices"),
        ({"coverage_yx": 0.2}, "preserve", "20%"),
        ({"bijectivity_x": 0.4}, "preserve", "disagree"),
    ],
)
def test_certificate_is_read_in_plain_words(change, orientation, warning):
    changes = {name: jnp.asarray(value) for name, value in change.items()}
    found = warnings_of(GOOD._replace(**changes), orientation)
    assert len(found) == (warning is not None)
    assert warning is None or warning in found[0]


def test_the_least_confident_pairs_come_first():
    values = ("", 0.9), ("", None), ("no file", None), ("", 0.1)
    rows = [{"reason": why, "confidence": value} for why, value in values]
    assert doubtful_first(rows) == [rows[2], rows[3], rows[0], rows[1]]


@pytest.mark.parametrize(
    ("orientation", "reading"),
    [
        (0.97, "keeps left and right"),
        (-0.9, "swaps left and right"),
        (0.2, "unclear"),
        (np.nan, "point cloud"),
    ],
)
def test_certificate_says_which_way_round(orientation, reading):
    console = Console(width=120)
    with console.capture() as shown:
        turned = GOOD._replace(orientation=jnp.asarray(orientation))
        console.print(certificate_table(turned))
    assert reading in shown.get()


@pytest.mark.slow
def test_demo_shows_sinkhorn_ahead(folder, shapes, monkeypatch):
    from jfsf.initial import Candidates
    from jfsf.spectral import functional_map, truncate

    def search(spec_x, spec_y, *descriptors):
        # The true map at 40: small bodies, and quick.
        truth = KDTree(shapes[PAIR[0]].mesh.vertices)
        points = shapes[PAIR[0]].template_to_vertex, shapes[PAIR[1]].template_to_vertex
        first = np.full(len(truth.data), -1)
        first[points[0]] = points[1]
        known = np.flatnonzero(first >= 0)
        near = known[KDTree(truth.data[known]).query(truth.data)[1]]
        C_yx = functional_map(first[near], truncate(spec_x, 40), truncate(spec_y, 40))
        return Candidates(C_yx[None], jnp.zeros(1), jnp.ones(1), jnp.zeros(()))

    monkeypatch.setattr("jfsf.data.load", shapes.__getitem__)
    monkeypatch.setattr("jfsf.initial.search", search)
    monkeypatch.setattr("jfsf.apps.report._page.candidate_maps", lambda *_, **__: [])
    result = run("demo", "--out", folder / "demo", "--report")
    assert result.exit_code == 0, result.output
    assert record_of(folder / "demo" / "man_walk_man_up.html")["truth"]
    assert (folder / "demo" / "man_walk_man_up.png").exists()
    record = json.loads((folder / "demo" / "man_walk_man_up.json").read_text())
    assert record["settings"]["zoomout"] == list(range(40, 101, 10))
    assert {"device", "date", "versions", "units"} < set(record)
    assert record["versions"]["jfsf"] == __version__
    rows = record["rows"]
    for way in ("plain", "ZoomOut"):
        nearest, sinkhorn = rows[f"{way} (NN)"], rows[f"{way} (Sinkhorn)"]
        assert sinkhorn["bijectivity"] < nearest["bijectivity"]
        assert sinkhorn["coverage"] > nearest["coverage"]
        assert f"{way} (Sinkhorn)" in result.stdout
    assert f"{1000 * rows['jfsf.match']['error']:.2f}" in result.stdout


def test_demo_knows_its_shapes(folder):
    assert "no shape 'cat'" in refused(
        "demo", "--pair", "cat", "dog", "--out", folder / "demo"
    )


@pytest.mark.parametrize("command", ["demo", "match", "evaluate", "info"])
def test_help_has_an_example(command):
    result = run(command, "--help")
    assert result.exit_code == 0 and f"Example: jfsf {command}" in result.stdout


def test_version():
    assert run("--version").stdout == f"jfsf {__version__}\n"


def test_commands_leave_jax_settings_alone(folder, x):
    assert jax.config.values["jax_compilation_cache_dir"] is None


def test_process_says_one_line_and_ends_with_the_code(tmp_path):
    command = [sys.executable, "-m", "jfsf", "info", str(tmp_path / "none.off")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.startswith("jfsf: ") and done.stderr.count("\n") == 1


# Runs jfsf in a process that interrupts itself at an import or a collection of garbage.
INTERRUPTED = """
import gc, runpy, signal, sys
# A process in the background ignores it, and so do all that it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)
when, *sys.argv[1:] = sys.argv[1:]
interrupt = lambda *_: signal.raise_signal(signal.SIGINT)
class Finder:
    def find_spec(self, name, *_):
        if name == "jfsf.apps.cli":
            print("ready", flush=True)
        if name == when:
            interrupt()
def at_collection(*_):
    if when == "collection" and "jfsf.matching" in sys.modules:
        interrupt()
sys.meta_path.insert(0, Finder())
gc.callbacks.append(at_collection)
runpy.run_module("jfsf", run_name="__main__", alter_sys=True)
"""
WITH_SIGNALS = pytest.mark.skipif(os.name == "nt", reason="needs signals of POSIX")


def interrupted_match(tmp_path, x, y, when):
    (tmp_path / "out").mkdir()
    command = [sys.executable, "-c", INTERRUPTED, when, "match", x, y]
    return subprocess.Popen(
        [*command, "--out", tmp_path / "out" / "m.npz"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "JFSF_CACHE": str(tmp_path / "cache")},
    )


def ended(process, tmp_path):
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 130, output + errors
    assert output.strip() in ("", "ready") and "Traceback" not in errors
    assert not os.listdir(tmp_path / "out") and not list(tmp_path.rglob("*.tmp"))


@WITH_SIGNALS
@pytest.mark.parametrize(
    "when",
    ["jfsf.apps.cli", "numpy._core.shape_base", "jax.lax", "jfsf.mesh", "collection"],
)
def test_an_interrupt_is_not_lost(tmp_path, x, y, when):
    ended(interrupted_match(tmp_path, x, y, when), tmp_path)


@WITH_SIGNALS
@pytest.mark.parametrize("seconds", [0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6])
def test_an_interrupt_is_heeded_at_any_time(tmp_path, x, y, seconds):
    process = interrupted_match(tmp_path, x, y, "never")
    assert process.stdout and process.stdout.read(5) == "ready"
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    ended(process, tmp_path)


@WITH_SIGNALS
def test_an_interrupt_leaves_no_part_of_a_file(tmp_path):
    code = (
        "import signal, sys\n"
        "from jfsf import __main__\nfrom jfsf.storage import _atomic\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "end = lambda file: signal.raise_signal(signal.SIGINT)\n"
        "write = lambda: _atomic.write_atomically(sys.argv[1], end)\n"
        "sys.modules['jfsf.apps.cli'] = type(sys)('cli')\n"
        "sys.modules['jfsf.apps.cli'].main = write\n"
        "__main__.main()\n"
    )
    command = [sys.executable, "-c", code, tmp_path / "a.txt"]
    assert subprocess.run(command, cwd=ROOT).returncode == 130
    assert os.listdir(tmp_path) == []


def test_cache_shows_what_is_kept_and_clears_it(tmp_path, monkeypatch):
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("JFSF_CACHE_LIMIT", "2.5")
    shown = run("cache").stdout
    assert "spectra: 0, 0.0 MB" in shown and "limit: 2.5 GB" in shown
    programs = tmp_path / "cache" / "programs"
    programs.mkdir(parents=True)
    (tmp_path / "cache" / ("a" * 64 + ".npz")).write_bytes(bytes(3_000_000))
    (programs / ("b" * 64 + ".program")).write_bytes(bytes(1_500_000))
    (programs / "mine.program").write_text("mine")
    shown = run("cache").stdout
    assert f"folder: {tmp_path / 'cache'}\n" in shown
    assert "spectra: 1, 3.0 MB\nprograms: 1, 1.5 MB" in shown
    assert "removed: 2 files, 4.5 MB freed" in run("cache", "--clear").stdout
    assert [p.name for p in (tmp_path / "cache").rglob("*.*")] == ["mine.program"]
    monkeypatch.setenv("JFSF_CACHE_LIMIT", "10 GB")
    assert "JFSF_CACHE_LIMIT is '10 GB'" in refused("cache")


@WITH_SIGNALS
def test_an_interrupt_that_is_ignored_stays_so():
    code = INTERRUPTED.replace("default_int_handler", "SIG_IGN")
    command = [sys.executable, "-c", code, "jfsf.apps.cli", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0 and done.stdout == f"ready\njfsf {__version__}\n"
