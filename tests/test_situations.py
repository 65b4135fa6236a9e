"""Files of the experiment situations.py: read or refused as its rows say."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import typer

from jfsf.apps.cli import app
from jfsf.apps.landmarks import read_landmarks, read_vertex_pairs
from jfsf.mesh import MeshError, check, read, read_noted, rounding
from jfsf.mesh._read import format_of

ROOT = Path(__file__).parents[1]
LIBRARIES = ".vtk", ".vtp", ".gii"  # which may not be installed
LANDMARKS = ".mrk.json", ".fcsv", ".pp"


@pytest.fixture(scope="module")
def situations():
    # The scripts import each other from their folder.
    folder = str(ROOT / "experiments")
    sys.path.insert(0, folder)
    yield import_module("situations")
    sys.path.remove(folder)


@pytest.fixture(scope="module")
def made(situations, tmp_path_factory):
    """The commands of each situation, and the folder of its files."""
    root, found = tmp_path_factory.mktemp("situations"), {}
    for name, own in situations.FILES.items():
        (folder := root / name.replace(" ", "_")).mkdir()
        found[name] = own.commands(folder), folder
    return found


def meshes(folder):
    return [path for path in sorted(folder.iterdir()) if format_of(path)]


def test_commands_parse_and_name_files_that_are_there(made):
    verbs = typer.main.get_command(app).commands  # type: ignore
    for commands, folder in made.values():
        assert len({command.name for command in commands}) == len(commands)
        for command in commands:
            verb, *rest = command.args
            given = verbs[verb].make_context(verb, list(rest)).params
            for name in ("x", "y", "path", "template", "scan", "map_file", "gt_x"):
                if given.get(name) is not None:
                    assert (folder / given[name]).exists(), command.name


def test_other_files_are_read(made):
    for name in made.keys() - {"not finite", "formats", "carried"}:
        for path in meshes(made[name][1]):
            mesh, notes = read_noted(path)
            assert len(mesh.vertices) > 500
            assert (name == "long lines") >= bool(notes), path
    for path in meshes(made["formats"][1]):
        if not set(path.suffixes) & set(LIBRARIES):
            assert len(read(path).vertices) in (1202, 1152), path


def test_flaws_are_those_that_are_to_be_found(made):
    def reports(name):
        return {p.name: check(read(p)) for p in meshes(made[name][1])}

    assert {r.components for r in reports("two bodies in a file").values()} == {2}
    torn = reports("torn meshes").values()
    assert sorted(r.components for r in torn) == [6, 6, 13, 13]
    assert sorted(r.nonmanifold_edges for r in torn) == [20, 20, 40, 40]
    areas = {round(r.area, 9) for r in reports("concave quads").values()}
    assert len(areas) == 1
    far = {p.stem: rounding(read(p)) for p in meshes(made["far from the origin"][1])}
    assert far["in_doubles"] is None and far["a_body"] and far["a_statue"]
    folder = made["not finite"][1]
    bad = [p for p in meshes(folder) if np.isnan(read(p, finite=False).vertices).any()]
    assert len(bad) == 3
    for path in bad:
        with pytest.raises(MeshError, match="not finite"):
            read(path)


def test_landmarks_of_all_formats_are_the_same(made):
    _, folder = made["landmark files"]
    for side in "xy":
        every = []
        for suffix in (*LANDMARKS, ".csv"):
            found = read_landmarks(folder / f"{side}{suffix}")
            points = np.asarray(found.points)
            points = points * [-1, -1, 1] if found.system == "RAS" else points
            every.append(dict(zip(found.names, points.tolist(), strict=True)))
        assert all(one == every[0] for one in every) and len(every[0]) == 5
    assert read_vertex_pairs(folder / "pairs.txt").shape == (5, 2)


def test_a_command_is_run_and_judged(situations, tmp_path):
    runs = import_module("situation_runs")
    checks = {"small": runs.Check(lambda: 0.01), "large": runs.Check(lambda: 0.3)}
    words, unsaid = ("jfsf ", "cat"), ("dog", "jfsf")
    command = runs.Command("a", ("--version",), words, 1, unsaid, checks)
    row = runs.row_of(command, tmp_path, tmp_path)
    assert row["code"] == 0 and row["said"][0].startswith("jfsf ")
    assert not row["expected"] and row["wrong"] == [
        *("exit code 0, not 1", "did not say 'cat'", "said 'jfsf'"),
        "large 0.3, above 0.1",
    ]
    row = runs.row_of(command._replace(needs="none_such"), tmp_path, tmp_path)
    assert row["skipped"] == "needs none_such"


def test_the_guide_has_the_table(situations):
    page = ROOT / "jfsf" / "guide" / "troubleshooting.md"
    text = page.read_text(encoding="utf-8")
    assert situations.table() in text


@pytest.mark.slow  # matches in earnest, doubtful pairs too
@pytest.mark.parametrize("name", ["left and right", "left and right, bones", "bodies"])
def test_a_mirrored_shape_is_said_to_be(situations, name):
    found = situations.of_pairs(name, 2)
    assert [row["expected"] for row in found["pairs"]] == [True, True]
    for row in found["pairs"]:
        assert row["says_mirror"] == (name != "bodies")
