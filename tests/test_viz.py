"""Pictures: colours follow the map, files are whole, no display, errors that help."""

import sys

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jfsf.apps.plot import coordinate_colours, draw_pair, draw_shape, pull_back
from jfsf.apps.plot._charts import (
    Panel,
    draw_curves,
    draw_error_curves,
    draw_functional_map,
)
from jfsf.apps.plot._colours import matched_colours, texture_coordinates
from jfsf.apps.plot._frames import frame, frames_of_pair
from jfsf.apps.plot._panels import picture_of
from jfsf.apps.plot._pictures import draw_maps
from jfsf.data import load
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
PLAIN = np.eye(3)
PNG = b"\x89PNG\r\n\x1a\n"


@given(st.lists(st.integers(0, 4), min_size=1, max_size=9))
def test_colour_of_a_vertex_is_its_images(T_xy):
    colours = coordinate_colours(PYRAMID.vertices)
    pulled = pull_back(colours, np.array(T_xy, np.int32))
    for i, j in enumerate(T_xy):
        assert (pulled[i] == colours[j]).all()


def test_what_is_not_matched_is_grey():
    colours = coordinate_colours(PYRAMID.vertices)
    matched = np.array([True, False, True, True, False])
    shown = matched_colours(colours, jnp.asarray(matched))
    assert np.array_equal(shown[matched], colours[matched])
    assert np.ptp(shown[~matched], 0).max() == 0 and np.ptp(shown[1]) < 0.03
    assert np.array_equal(matched_colours(colours, None), colours)
    for wrong in (matched[1:], matched.astype(int)):
        with pytest.raises(ValueError, match="the shape has 5 vertices, what is match"):
            matched_colours(colours, wrong)


def test_a_pair_of_parts_is_drawn_with_what_is_matched():
    pixels = lambda **matched: picture_of(draw_pair(TETRA, PYRAMID, T, **matched), 30)
    hues = lambda image: np.ptp(image.astype(int), axis=2).max()
    all_of_it = {"matched_x": np.ones(4, bool), "matched_y": np.ones(5, bool)}
    plain = pixels()
    assert np.array_equal(pixels(**all_of_it), plain)
    grey = pixels(**{name: ~matched for name, matched in all_of_it.items()})
    assert hues(grey) < 20 < 60 < hues(plain)


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
    from matplotlib.text import Text

    names = "lemur", "otter"
    figure = draw_pair(x.mesh, y.mesh, T_xy, names=names, path=path, title="a pair")
    written = {text.get_text() for text in figure.findobj(Text)}
    assert {"lemur, coloured by its map to otter", "otter"} <= written
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
        ({"errors": np.zeros(5)}, r"has 4 vertices, errors \(5,\)"),
        ({"path": "map.pdf"}, "ends in .png; got map.pdf"),
        ({"up": "w"}, "x, y, z, -x, -y, -z; got 'w'"),
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


def faces_of(fig, i):
    """Facecolours of the i-th shape of a picture."""
    from matplotlib.collections import TriMesh

    shapes = [c for c in fig.axes[0].collections if isinstance(c, TriMesh)]
    return np.asarray(shapes[i].get_facecolor())[:, :3]


@pytest.fixture
def unlit(monkeypatch):
    """Colours as they are, without light."""
    monkeypatch.setattr("jfsf.apps.plot._panels.lit", lambda colours, *_: colours)


def truth(name_x, name_y):
    """Two bodies, y up and facing z, and the map between them."""
    x, y = load(name_x), load(name_y)
    points = x.mesh.vertices[x.template_to_vertex]
    near = KDTree(points).query(x.mesh.vertices)[1]
    return x.mesh, y.mesh, y.template_to_vertex[near]


def turned(mesh, rotation):
    return mesh._replace(vertices=rotation.apply(mesh.vertices))


def degrees(one, other):
    """Of the rotation between two frames."""
    return np.degrees(Rotation.from_matrix(one @ other.T).magnitude())


TURNS = {
    "z up": Rotation.from_euler("x", 90, degrees=True),
    "-y up": Rotation.from_euler("z", 180, degrees=True),
    "random": Rotation.random(rng=3),
}


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_y_is_turned_onto_x_whatever_the_axes_of_its_file(turn):
    x, y, T_xy = truth("man_walk", "man_up")
    plain = frames_of_pair(x, y, T_xy)
    assert np.array_equal(plain[0], PLAIN) and degrees(*plain) < 30
    axes_x, axes_y = frames_of_pair(x, turned(y, turn), T_xy)
    assert np.array_equal(axes_x, plain[0])
    assert degrees(axes_y, turn.apply(plain[1].T).T) < 1e-3
    # And X by the axis that is said to be up.
    lying = TURNS["z up"]
    axes_x, axes_y = frames_of_pair(turned(x, lying), turned(y, turn), T_xy, up="z")
    assert np.allclose(axes_x, lying.apply(np.eye(3)).T, atol=1e-12)
    assert degrees(axes_y, turn.apply(plain[1].T).T) < 1e-3


def test_only_what_is_matched_turns_y():
    x, y, T_xy = truth("man_walk", "man_up")
    turn, matched = TURNS["random"], x.vertices[:, 1] > np.median(x.vertices[:, 1])
    wrong = np.where(matched, T_xy, 0)
    axes_y = frames_of_pair(x, turned(y, turn), wrong, matched_x=matched)[1]
    assert degrees(axes_y, turn.as_matrix()) < 30
    none = frames_of_pair(x, y, T_xy, matched_x=matched & False)
    assert np.array_equal(none[1], PLAIN)
    with pytest.raises(ValueError, match="what is matched is int64"):
        frames_of_pair(x, y, T_xy, matched_x=matched.astype(int))


def test_a_mirrored_map_never_reflects_y():
    x = load("man_up").mesh
    mirrored = Mesh(x.vertices * [-1, 1, 1], x.faces[:, ::-1])
    axes_y = frames_of_pair(x, mirrored, np.arange(len(x.vertices)))[1]
    assert np.isclose(np.linalg.det(axes_y), 1)


def test_where_no_rotation_explains_the_map_y_stands_as_its_file_says():
    x, y, T_xy = truth("man_walk", "man_up")
    chance = np.random.default_rng(0).permutation(T_xy)
    for T in (chance, T_xy * 0):
        assert np.array_equal(frames_of_pair(x, turned(y, TURNS["z up"]), T)[1], PLAIN)


@pytest.mark.parametrize("axis", ["x", "y", "z", "-x", "-y", "-z"])
def test_axes_by_name_are_rotations_with_that_axis_up(axis):
    axes = frame(axis)
    assert np.allclose(axes.T @ axes, PLAIN) and np.linalg.det(axes) > 0
    assert axes["xyz".index(axis[-1]), 1] == (-1 if axis[0] == "-" else 1)


def test_a_shape_wears_its_own_colours_or_grey(unlit):
    paint = np.random.default_rng(0).random((4, 3))
    assert np.array_equal(faces_of(draw_shape(TETRA, paint), 0), paint)
    grey = faces_of(draw_shape(TETRA), 0)
    assert np.ptp(grey, axis=0).max() == 0
    with pytest.raises(ValueError, match=r"4 vertices, colours \(3, 3\)"):
        draw_shape(TETRA, paint[:3])


def test_error_curves_end_where_all_points_are_within():
    fig = draw_error_curves({"a": [0.0, 0.1, 0.2, np.nan], "b": [0.01]}, limit=0.25)
    a, b = fig.axes[0].lines
    x, y = map(np.asarray, a.get_data())
    assert np.array_equal(y[[0, -1]], [25, 75]) and x[-1] == 0.25
    assert y[np.searchsorted(x, 0.1001)] == 50
    assert a.get_label() == "a (mean 0.100)" and np.asarray(b.get_ydata())[-1] == 100
    with pytest.raises(ValueError, match="limit is 0"):
        draw_error_curves({"a": [0.1]}, limit=0)


def test_a_label_keeps_its_colour_in_all_panels():
    many = {str(i): ([0, 1], [i, i]) for i in range(9)}
    fig = draw_curves([Panel(many), Panel({"8": many["8"]}), Panel({"": many["0"]})])
    first, second, third = fig.axes
    assert first.lines[8].get_color() == second.lines[0].get_color()
    assert len({(a.get_color(), a.get_linestyle()) for a in first.lines}) == 9
    assert third.get_legend() is None
    with pytest.raises(ValueError, match=r"'a' has x of shape \(2,\) and y of \(3,\)"):
        draw_curves([Panel({"a": ([1, 2], [1, 2, 3])})])
    with pytest.raises(ValueError, match="no curve"):
        draw_curves([])


def test_functional_map_is_red_above_zero_and_blue_below():
    C_yx = np.array([[1.0, 0, -1], [0, 0.5, 0]])
    (image,) = draw_functional_map(C_yx, title="C_yx").axes[0].images
    red, white, blue = np.asarray(image.get_array())[0]
    assert red[0] > red[2] + 0.3 and blue[2] > blue[0] + 0.3
    assert np.allclose(white, 1, atol=1e-3)
    (image,) = draw_functional_map(C_yx, size=2).axes[0].images
    assert np.shape(image.get_array())[:2] == (2, 2)
    for wrong in (C_yx[0], C_yx * np.nan, C_yx[:0]):
        with pytest.raises(ValueError, match="finite matrix"):
            draw_functional_map(wrong)


def test_texture_coordinates_are_what_the_viewer_sees():
    flat = np.array([[0.0, 0, 9], [2, 0, 5], [2, 4, 1]])
    wanted = np.array([[0, 0], [0.5, 0], [0.5, 1]])
    np.testing.assert_allclose(texture_coordinates(flat), wanted)
    np.testing.assert_allclose(texture_coordinates(100 * flat + 7), wanted)
    assert not texture_coordinates(flat[:1]).any()
