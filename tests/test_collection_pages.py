"""The pages of a collection: shapes, pairs, triangles, and the sliders of a model."""

from base64 import b64decode

import numpy as np
import pytest
import trimesh
from browser import needs_chromium, opened
from test_report import record_of
from typer.testing import CliRunner

from jfsf.apps import model
from jfsf.apps.cli._app import app
from jfsf.apps.collections._cycles import Triangle
from jfsf.apps.collections._grow import Graph, Matched, Paths
from jfsf.apps.plot._frames import frame
from jfsf.apps.report import write_model_page
from jfsf.apps.report._collection import places, shape_picture, write_collection_page
from jfsf.apps.report._html import Row
from jfsf.data import load, names
from jfsf.mesh import read
from jfsf.types import Maps, Mesh

SHAPES = tuple("abcd")
NOTHING = Maps(np.zeros(1, np.int32), np.zeros(1, np.int32))


@pytest.fixture(scope="module")
def rods():
    """The model of four shapes that bend a little."""
    rod = trimesh.creation.icosphere(subdivisions=2)
    points = np.asarray(rod.vertices) * [1, 1, 3]
    angle = np.linspace(-0.5, 0.5, len(SHAPES))[:, None] * points[:, 2]
    moved = [points[:, 0], points[:, 1] + points[:, 2] * np.sin(angle)]
    shapes = np.stack([np.broadcast_to(moved[0], angle.shape), moved[1]], -1)
    shapes = np.concatenate([shapes, (points[:, 2] * np.cos(angle))[..., None]], -1)
    return model.fit_model(shapes, rod.faces)


@pytest.fixture(scope="module")
def model_page(rods, tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.html"
    write_model_page(path, rods, SHAPES, modes=2, up="z")
    return path


def test_the_page_of_a_model_holds_its_shapes(rods, model_page):
    record = record_of(model_page)
    assert record["names"] == list(SHAPES) and len(record["modes"]) == 2
    mean, shape = np.asarray(rods.mean), record["shape"]
    size = np.ptp(mean, axis=0).max()
    points = np.frombuffer(b64decode(shape["points"]), "<u2").reshape(-1, 3) / 65535
    points = size * (points + shape["low"])
    mode = record["modes"][0]
    at = np.frombuffer(b64decode(mode["at"]), "<i2").reshape(-1, 3)
    far = points + size * mode["unit"] * at
    reach = record["reach"] * np.sqrt(rods.variance[:1])
    true = np.asarray(model.shape_at(rods, reach))
    true = (true - (mean.min(0) + mean.max(0)) / 2) @ frame("z")
    np.testing.assert_allclose(far, true, atol=1e-3 * size)
    scores = np.asarray(rods.scores)[:, :2] / np.sqrt(rods.variance[:2])
    np.testing.assert_allclose(record["scores"], scores, rtol=1e-4)


def test_a_model_that_does_not_fit_is_refused(rods, tmp_path):
    with pytest.raises(ValueError, match="3 names for a model of 4 shapes"):
        write_model_page(tmp_path / "a.html", rods, SHAPES[1:])
    assert not list(tmp_path.iterdir())


@needs_chromium
def test_sliders_move_the_shape(model_page, tmp_path):
    move = (
        "const s = document.querySelectorAll('#sliders input')[arguments[0]];"
        "s.value = arguments[1]; s.oninput();"
    )
    for page in opened(model_page, tmp_path / "profile"):
        assert page.run("return document.body.dataset.ready") == "yes"
        assert len(page.all("#sliders input")) == 2
        mean = page.pixels("#canvas-x")
        page.driver.execute_script(move, 0, 2)
        assert page.one("#sliders output").text == "2.00"
        assert (page.pixels("#canvas-x") != mean).mean() > 0.005
        page.one("#mean").click()
        assert (page.pixels("#canvas-x") == mean).all()
        page.one("#modes button:last-child").click()
        assert page.one("#scale").is_displayed()
        page.one("#modes button").click()
        choose = (
            "const box = document.getElementById(arguments[0]);"
            "box.value = arguments[1]; box.onchange();"
        )
        page.driver.execute_script(choose, "shape", "a")
        assert page.one("#sliders output").text != "0.00"
        found = "return performance.getEntriesByType('resource').map((e) => e.name)"
        assert [n for n in page.run(found) if not n.startswith("data:")] == []
        assert page.errors() == []


def graph():
    """Four shapes: b is the template, d is not joined, the map from c to d is wrong."""
    edges = {(0, 1): 0.99, (0, 2): 0.9, (1, 2): 0.99, (2, 3): 0.2}
    matched = {edge: Matched(NOTHING, p) for edge, p in edges.items()}
    paths = Paths(1, np.array([1, -1, 1, 2]), np.array([0.99, 1, 0.99, 0.2]))
    found = [Triangle((0, 1, 2), 0.03)]
    return Graph(matched, found, edges, paths, np.array([1, 1, 1, 0], bool))


@pytest.fixture
def index(tmp_path):
    rows = [
        Row("a", "a.html", None, 0.99, ["near"]),
        Row("b", None, None, 1.0, ["the template"]),
        Row("c", "c.html", None, 0.8, []),
        Row("d", None, None, float("nan"), ["<i>fits none</i>"], failed=True),
    ]
    links = {"The model": "model.html"}
    write_collection_page(tmp_path / "i.html", rows, graph(), SHAPES, links=links)
    return tmp_path / "i.html"


def test_the_index_lists_what_to_look_at_first(index):
    record = record_of(index)
    assert [row["name"] for row in record["rows"]] == ["d", "c", "a", "b"]
    assert record["rows"][0]["verdict"] == "left out"
    assert record["counts"] == "4 shapes, 3 joined, template b, 4 pairs matched"
    kinds = {(a, b): kind for a, b, kind, _ in record["graph"]["edges"]}
    assert kinds == {(0, 1): "way", (0, 2): "trusted", (1, 2): "way", (2, 3): "dropped"}
    levels = [node["level"] for node in record["graph"]["nodes"]]
    assert levels == ["good", "template", "good", "failed"]
    assert record["triangles"] == [["a, b, c", "0.030", "agree"]]
    assert [row[0] for row in record["dropped"]] == ["c, d"]


@pytest.mark.slow
@needs_chromium
def test_the_index_is_drawn(index, tmp_path):
    for phone in (False, True):
        for page in opened(index, tmp_path / f"profile{phone}", phone):
            assert page.run("return document.body.dataset.ready") == "yes"
            assert len(page.all("#graph .edge")) == 4
            assert len(page.all("#graph .node")) == 4
            assert page.one("#links a").text == "The model" and not page.all("i b")
            width = page.run("return document.documentElement.scrollWidth")
            assert width == page.run("return window.innerWidth")
            assert page.errors() == []


def test_matched_shapes_are_drawn_near():
    # Two chains that no pair connects.
    edges = [(0, 1), (1, 2), (2, 3), (4, 5)]
    at = places(edges, 6)
    away = np.linalg.norm(at[:, None] - at[None], axis=2)
    assert at.min() >= 0 and at.max() <= 1 and (away[np.triu_indices(6, 1)] > 0.1).all()
    near = np.mean([away[edge] for edge in edges])
    assert near < 0.6 * away[np.triu_indices(6, 1)].mean()
    assert away[0, 3] > 2 * away[0, 1]
    assert (places(edges, 6) == at).all() and places([], 1).shape == (1, 2)


def test_a_picture_takes_the_colours_of_the_template():
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = Mesh(ball.vertices * [1, 1.4, 2], np.asarray(ball.faces, np.int32))
    own = np.arange(len(mesh.vertices), dtype=np.int32)
    grey = shape_picture(mesh)
    assert grey.startswith("data:image/png;base64,")
    assert shape_picture(mesh, mesh, own, own) not in (grey, "")
    with pytest.raises(ValueError, match="without maps"):
        shape_picture(mesh, mesh)


def test_shapes_are_written_once(tmp_path):
    run = lambda: CliRunner().invoke(app, ["shapes", str(tmp_path / "bodies")])
    assert "wrote 12 shapes" in run().output.replace("\n", " ")
    assert "wrote 0 shapes" in run().output.replace("\n", " ")
    files = {path.stem: path for path in (tmp_path / "bodies").iterdir()}
    assert set(files) == set(names())
    found, true = read(files["man_t"]), load("man_t").mesh
    assert (found.faces == true.faces).all()
    np.testing.assert_allclose(found.vertices, true.vertices)
    before = files["man_t"].stat().st_mtime_ns
    assert run().exit_code == 0 and files["man_t"].stat().st_mtime_ns == before
