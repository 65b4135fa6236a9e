"""Pictures: colours follow the map, files are whole, no display, errors that help."""

import sys

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf.data import load
from jfsf.plot import coordinate_colours, draw_maps, draw_pair, pull_back
from jfsf.types import Mesh

TETRA = Mesh(
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
)
PYRAMID = Mesh(
    np.array([[0.0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2], [1, 2, 1]]),
    np.array(
        [[0, 1, 2], [0, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]], np.int32
    ),
)
T = np.array([4, 0, 2, 2], np.int32)  # TETRA to PYRAMID
PNG = b"\x89PNG\r\n\x1a\n"


@given(st.lists(st.integers(0, 4), min_size=1, max_size=9))
def test_colour_of_a_vertex_is_its_images(T_xy):
    colours = coordinate_colours(PYRAMID.vertices)
    pulled = pull_back(colours, np.array(T_xy, np.int32))
    for i, j in enumerate(T_xy):
        assert (pulled[i] == colours[j]).all()


def test_pull_back_takes_jax_arrays():
    colours = coordinate_colours(PYRAMID.vertices)
    assert np.array_equal(pull_back(colours, jnp.array(T)), colours[T])


def test_pull_back_refuses_what_is_no_map():
    colours = np.zeros((5, 3))
    with pytest.raises(ValueError, match="from 1 to 5.*the map from Y to X"):
        pull_back(colours, [1, 5])
    with pytest.raises(ValueError, match="from -1 to 2"):
        pull_back(colours, [2, -1])
    with pytest.raises(ValueError, match="float64"):
        pull_back(colours, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"\(1, 1\)"):
        pull_back(colours, [[0]])


def test_colouring_is_smooth_free_of_units_and_tells_the_limbs_apart():
    vertices, faces = load("man_up").mesh
    colours = coordinate_colours(vertices)
    assert colours.shape == vertices.shape and 0 <= colours.min() <= colours.max() <= 1
    assert np.allclose(coordinate_colours(1000 * vertices + 7), colours)
    assert np.abs(colours[faces[:, 0]] - colours[faces[:, 1]]).max() < 0.15
    corners = [
        np.argmax(vertices[:, :2] @ c) for c in ([1, 1], [1, -1], [-1, 1], [-1, -1])
    ]
    apart = np.linalg.norm(colours[corners][:, None] - colours[corners], axis=2)
    assert apart[np.triu_indices(4, 1)].min() > 0.3


def test_up_turns_the_colouring():
    vertices = load("man_up").mesh.vertices
    lying = vertices @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z up, front -y
    assert np.allclose(coordinate_colours(lying, up="z"), coordinate_colours(vertices))
    rolled = vertices[:, [1, 0, 2]] * [1, 1, -1]  # x up
    assert np.allclose(coordinate_colours(rolled, up="x"), coordinate_colours(vertices))


def test_flat_shapes_and_single_points_have_colours():
    flat = PYRAMID.vertices * [1, 1, 0]
    assert np.isfinite(coordinate_colours(flat)).all()
    assert np.isfinite(coordinate_colours(flat[:1])).all()


def test_draws_a_png_without_display_or_pyplot(tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)
    x, y = load("man_walk"), load("man_up")
    T_xy = np.zeros(len(x.mesh.vertices), np.int32)
    T_xy[x.template_to_vertex] = y.template_to_vertex
    path = tmp_path / "pair.png"
    draw_pair(x.mesh, y.mesh, T_xy, path=path, title="a pair")
    assert path.read_bytes().startswith(PNG)
    assert 20_000 < path.stat().st_size < 600_000
    assert [p.name for p in tmp_path.iterdir()] == ["pair.png"]
    assert "matplotlib.pyplot" not in sys.modules


def test_picture_shows_the_maps_colours():
    # Constant map: X wears one colour, only lighter or darker; Y wears many.
    from matplotlib.collections import TriMesh

    fig = draw_pair(TETRA, PYRAMID, np.full(4, 2))
    x, y = (c for c in fig.axes[0].collections if isinstance(c, TriMesh))
    paint = coordinate_colours(PYRAMID.vertices)[2]
    ratio = np.asarray(x.get_facecolor())[:, :3] / paint
    assert np.ptp(ratio, axis=1).max() < 0.2
    assert np.asarray(y.get_facecolor())[:, :3].std(0).max() > 0.1


def test_draws_errors_clouds_and_several_maps(tmp_path):
    cloud = TETRA._replace(faces=np.zeros((0, 3), np.int32))
    errors = np.array([0, 0.1, np.nan, 3])
    for mesh in (TETRA, cloud):
        fig = draw_pair(mesh, PYRAMID, T, errors=errors, up="z", turn=0.0)
        assert [t.get_text() for t in fig.axes[0].texts][-2:] == ["0", "2.94"]
    draw_pair(TETRA, PYRAMID, T, errors=np.full(4, np.nan))
    path = tmp_path / "maps.png"
    fig = draw_maps(TETRA, cloud, {"one": T % 4, "two": T * 0}, path=path, title="maps")
    assert [t.get_text() for t in fig.axes[0].texts] == ["Y", "one", "two", "maps"]
    assert path.read_bytes().startswith(PNG)


def test_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    def half(file, *_, **__):
        file.write(PNG)
        raise OSError("disk full")

    path = tmp_path / "map.png"
    path.write_bytes(b"old")
    monkeypatch.setattr("matplotlib.image.imsave", half)
    with pytest.raises(OSError, match="disk full"):
        draw_pair(TETRA, PYRAMID, T, path=path)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"]


def test_missing_matplotlib_says_how_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.backends.backend_agg", None)
    with pytest.raises(ImportError, match=r"pip install 'jfsf\[viz\]'"):
        draw_pair(TETRA, PYRAMID, T)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"T_xy": T[:3]}, r"X has 4 vertices, T_xy has shape \(3,\)"),
        ({"T_xy": T + 1}, "from 1 to 5"),
        ({"errors": np.zeros(5)}, r"X has 4 vertices, errors \(5,\)"),
        ({"path": "map.pdf"}, "ends in .png; got map.pdf"),
        ({"up": "w"}, "x, y, z; got 'w'"),
        ({"mesh_x": Mesh(np.zeros((4, 2)), TETRA.faces)}, r"got \(4, 2\)"),
        ({"mesh_y": PYRAMID._replace(vertices=np.full((5, 3), np.nan))}, "not finite"),
    ],
)
def test_wrong_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        draw_pair(**{"mesh_x": TETRA, "mesh_y": PYRAMID, "T_xy": T} | change)


def test_no_maps():
    with pytest.raises(ValueError, match="no map"):
        draw_maps(TETRA, PYRAMID, {})
