"""What Y has, carried to X: on the right places, across seams, from file to file."""

import io
import json
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from typer.testing import CliRunner

import jfsf
from jfsf.apps import transfer
from jfsf.apps.cli._app import app
from jfsf.apps.cli._collection_carried import carried_of, write_carried
from jfsf.apps.export import export_textured
from jfsf.apps.landmarks import Landmarks, read_landmarks, write_landmarks
from jfsf.apps.mapfiles import write_map, write_match
from jfsf.apps.transfer._files import (
    Column,
    png_of,
    read_image,
    read_labels,
    read_values,
    write_column,
)
from jfsf.apps.transfer._nearest import finder, in_faces, nearest, place, placed
from jfsf.apps.transfer._overlay import Overlay, extended, overlay_template
from jfsf.apps.transfer._texture import MARGIN, look_up
from jfsf.mesh import MeshError, closest, decimate, read, read_uv, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._edit import mirror_image
from jfsf.testing import blob, mirror
from jfsf.types import Certificate, Mesh

Y = blob(0, subdivisions=3)
COARSE = decimate(blob(0, subdivisions=4), 350)  # the same surface
RNG = np.random.default_rng(0)


def bent(points):
    """A smooth deformation that bends, and stretches by up to a fifth."""
    x, y, z = points.T
    angle = 0.4 * x
    turned = (
        np.cos(angle) * y - np.sin(angle) * z,
        np.sin(angle) * y + np.cos(angle) * z,
    )
    return np.stack([x, 1.1 * turned[0], turned[1] + 0.1 * x**2], 1)


X = Mesh(bent(COARSE.vertices), COARSE.faces)
T_XY = KDTree(Y.vertices).query(COARSE.vertices)[1]
UNIT = np.sqrt(surface_area(Y))
N_X, N_Y = len(X.vertices), len(Y.vertices)


@pytest.fixture(scope="module")
def both():
    return transfer.overlay(X, Y, T_XY)


def exact():
    """X where it lies on Y, without a registration."""
    known = np.ones(N_X, bool)
    return Overlay(X, Y, COARSE.vertices, Y.vertices, known, 1)


def at_faces(mesh):
    return mesh.vertices[mesh.faces].mean(1)


def quadrant(points):
    return (points[:, 0] > 0) + 2 * (points[:, 1] > 0)


def run(*args):
    return CliRunner().invoke(app, ["transfer", *map(str, args)])


# Values, labels and landmarks.


def test_values_are_those_of_the_points(both):
    found = transfer.values(both, Y.vertices)
    assert np.linalg.norm(found - COARSE.vertices, axis=1).mean() < 0.012 * UNIT
    # The images of the map are vertices only.
    snapped = np.linalg.norm(Y.vertices[T_XY] - COARSE.vertices, axis=1).mean()
    assert np.linalg.norm(found - COARSE.vertices, axis=1).mean() < snapped
    assert both.orientation_sign == 1 and both.known_x.all()


def test_values_keep_their_shape_and_their_unknowns():
    one = transfer.values(exact(), Y.vertices[:, 0])
    assert one.shape == (N_X,) and one.dtype == np.float64
    assert np.allclose(one, transfer.values(exact(), Y.vertices)[:, 0])
    assert np.allclose(transfer.values(exact(), np.full((N_Y, 2, 2), 3)), 3)
    holed = np.where(Y.vertices[:, 2] > 1, np.nan, 1.0)
    lost = np.isnan(transfer.values(exact(), holed))
    assert lost.any() and (COARSE.vertices[lost, 2] > 0.7).all()


def test_a_mesh_on_itself_has_its_own_values():
    same = Overlay(Y, Y, Y.vertices, Y.vertices, np.ones(N_Y, bool), 1)
    values = RNG.normal(size=N_Y)
    assert np.allclose(transfer.values(same, values), values)
    names = np.array([f"n{i}" for i in range(N_Y)])
    assert (transfer.labels(same, names) == names).all()
    numbers = np.arange(len(Y.faces))
    assert (transfer.labels(same, numbers) == numbers).all()


@pytest.mark.parametrize("to", ["vertices", "faces"])
@pytest.mark.parametrize("of", ["vertices", "faces"])
def test_labels_are_right_but_along_borders(of, to):
    of_y = quadrant(Y.vertices if of == "vertices" else at_faces(Y))
    found = transfer.labels(exact(), of_y, to=to)
    places = COARSE.vertices if to == "vertices" else at_faces(COARSE)
    wrong = found != quadrant(places)
    assert wrong.mean() < 0.08
    assert (np.abs(places[wrong, :2]).min(1) < 0.15).all()


def test_a_face_takes_the_label_of_most_of_its_area():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    x = Mesh(square[:3], np.array([[0, 1, 2]]))
    # Y is the same triangle, cut at x = 0.4: a ninth of that, and the rest.
    points = np.array([[0, 0, 0], [0.4, 0, 0], [0.4, 0.4, 0], [1, 0, 0], [1, 1, 0.0]])
    y = Mesh(points, np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2]]))
    both = Overlay(x, y, x.vertices, y.vertices, np.ones(3, bool), 0)
    labels = np.array(["left", "right", "right"])
    assert transfer.labels(both, labels, of="faces").tolist() == ["right"]
    to = transfer.labels(both, labels, of="faces", to="vertices")
    assert to.tolist() == ["left", "right", "right"]


def test_landmarks_lie_on_the_surface_of_x(both):
    at = RNG.integers(0, N_Y, 40)
    named = Landmarks(tuple(f"p{i}" for i in at), Y.vertices[at], system="LPS")
    found = transfer.landmarks(both, named)
    assert found.names == named.names and found.system == "LPS"
    assert closest(surface_tree(X), found.points).distance.max() < 1e-9
    away = np.linalg.norm(found.points - bent(Y.vertices[at]), axis=1)
    assert away.mean() < 0.012 * UNIT
    by_vertex = transfer.landmarks(both, named._replace(points=None, vertices=at))
    assert np.allclose(by_vertex.points, found.points)


def test_a_map_that_mirrors():
    turned = mirror(X)
    found = transfer.overlay(turned, Y, T_XY)
    assert found.orientation_sign == -1
    carried = transfer.values(found, Y.vertices)
    assert np.linalg.norm(carried - COARSE.vertices, axis=1).mean() < 0.02 * UNIT


def test_what_is_not_matched_gets_nothing():
    known = COARSE.vertices[:, 2] < 0.8
    found = transfer.overlay(X, Y, T_XY, matched_x=known)
    assert (np.isnan(transfer.values(found, Y.vertices[:, 0])) == ~known).all()
    assert ((transfer.labels(found, quadrant(Y.vertices)) == -1) == ~known).all()
    names = np.array(["a", "b"])[(Y.vertices[:, 0] > 0).astype(int)]
    by_face = transfer.labels(found, names, to="faces")
    assert ((by_face == "") == ~known[X.faces].all(1)).all()
    top = Landmarks(("top",), Y.vertices[[Y.vertices[:, 2].argmax()]])
    assert "top" in transfer.landmarks(found, top).said[-1]


def test_the_other_side_of_a_thin_part_is_not_taken():
    plate = trimesh.creation.box([2, 2, 0.02]).subdivide().subdivide()
    y = Mesh(np.asarray(plate.vertices), np.asarray(plate.faces, np.int32))
    # The upper side of X is nearer to the lower one of Y.
    x = Mesh(y.vertices * [0.99, 0.99, 1] - [0, 0, 0.015], y.faces)
    both = Overlay(x, y, x.vertices, y.vertices, np.ones(len(x[0]), bool), 1)
    side_x, side_y = placed(both)
    points = in_faces(side_x.faces, np.full((1, 3), 1 / 3))
    at, normals = place(side_x, points)
    assert normals is not None
    found = nearest(finder(side_y), at, normals)
    flat = np.abs(normals[:, 2]) > 0.9
    height = np.einsum("qc,qc->q", found.weights, y.vertices[found.corners, 2])
    assert (np.sign(height) == np.sign(normals[:, 2]))[flat].all()


def test_walking_finds_the_nearest_points():
    both = exact()._replace(mesh_x=blob(0), at_x=blob(0).vertices)
    side_x, side_y = placed(both)
    points = in_faces(side_x.faces, RNG.dirichlet([1, 1, 1], 5))
    at, normals = place(side_x, points)
    found = nearest(finder(side_y), at, normals)
    mine = np.einsum("qc,qcd->qd", found.weights, Y.vertices[found.corners])
    best = closest(surface_tree(Y), at)
    assert np.linalg.norm(mine - at, axis=1).max() < best.distance.max() + 0.02 * UNIT
    assert (np.linalg.norm(mine - best.position, axis=1) < 1e-6).mean() > 0.95


def test_point_clouds_go_by_their_nearest_vertices():
    cloud_x, cloud_y = (Mesh(m.vertices, np.zeros((0, 3), int)) for m in (X, Y))
    for x, y in ((cloud_x, Y), (X, cloud_y), (cloud_x, cloud_y)):
        found = transfer.overlay(x, y, T_XY)
        assert np.allclose(transfer.values(found, Y.vertices), Y.vertices[T_XY])
        assert (transfer.labels(found, quadrant(Y.vertices)).shape) == (N_X,)
    with pytest.raises(ValueError, match="X has no faces"):
        transfer.labels(found, np.arange(N_Y), to="faces")


@pytest.fixture(scope="module")
def registered():
    return jfsf.register(X, Y, T_XY)


def test_a_template_that_was_registered(registered):
    found = overlay_template(X, Y, registered)
    carried = transfer.values(found, X.vertices)  # from X, the template, to Y
    assert np.linalg.norm(carried - bent(Y.vertices), axis=1).mean() < 0.02 * UNIT
    with pytest.raises(ValueError, match="registration has"):
        overlay_template(Y, X, registered)


def test_whole_files_in_place_of_what_was_kept(both):
    stray = Mesh(np.vstack([X.vertices[:1], [[9, 9, 9]], X.vertices]), X.faces + 2)
    whole_y = Mesh(np.vstack([Y.vertices, Y.vertices[:1] + 9]), Y.faces)
    found = extended(both, stray, whole_y)
    carried = transfer.values(found, np.append(Y.vertices[:, 0], 0))
    expected = transfer.values(both, Y.vertices[:, 0])
    assert np.isnan(carried[1]) and np.allclose(carried[0], expected[0])
    assert np.allclose(carried[2:], expected)
    with_names = transfer.labels(found, np.append(quadrant(Y.vertices), 7))
    assert with_names[1] == -1
    assert (with_names[2:] == transfer.labels(both, quadrant(Y.vertices))).all()


def test_vertices_that_are_not_finite_get_nothing_and_give_nothing(both):
    nowhere = [[np.nan, 0, 0]]
    whole_x = Mesh(np.vstack([X.vertices, nowhere]), [*X.faces, [0, 1, N_X]])
    whole_y = Mesh(np.vstack([Y.vertices, nowhere]), [*Y.faces, [0, 1, N_Y]])
    found = extended(both, whole_x, whole_y)
    assert not np.isfinite(found.at_x[-1]).any() and not found.known_x[-1]
    carried = transfer.values(found, np.append(Y.vertices[:, 0], 0))
    assert np.isnan(carried[-1])
    assert np.allclose(carried[:-1], transfer.values(both, Y.vertices[:, 0]))
    with pytest.raises(MeshError, match="a face names vertex 900000"):
        extended(both, X, Mesh(Y.vertices, Y.faces + 900000))


def test_landmarks_on_pieces_without_a_place_are_an_error(registered):
    piece = np.array([[8.0, 0, 0], [9, 0, 0], [8, 1, 0]])
    whole = Mesh(np.vstack([X.vertices, piece]), [*X.faces, N_X + np.arange(3)])
    found = extended(overlay_template(X, Y, registered), Y, whole)
    on_it = Landmarks(("tip", "crumb"), np.stack([X.vertices[0], piece.mean(0)]))
    with pytest.raises(ValueError, match=r"\['crumb'\] lie on pieces of Y"):
        transfer.landmarks(found, on_it)
    kept = transfer.landmarks(found, Landmarks(("tip",), X.vertices[:1]))
    assert np.isfinite(kept.points).all() and not kept.said


# Textures.


def charts(mesh):
    """Texture coordinates by six projections: seams where the direction changes."""
    normal = np.cross(*np.diff(mesh.vertices[mesh.faces], axis=1).swapaxes(0, 1))
    axis = np.abs(normal).argmax(1)
    side = np.take_along_axis(normal, axis[:, None], 1)[:, 0] > 0
    uv = np.zeros((len(mesh.faces), 3, 2))
    for chart in range(6):
        own = (axis == chart // 2) & (side == chart % 2)
        kept = [i for i in range(3) if i != chart // 2]
        flat = mesh.vertices[mesh.faces[own]][:, :, kept]
        low, high = mesh.vertices.min(), mesh.vertices.max()
        unit = 0.05 + 0.9 * (flat - low) / (high - low)
        uv[own] = (unit + [chart % 3, chart // 3]) / [3, 2]
    return uv


def painted(mesh, uv, size=256):
    """An image whose colours are positions on the mesh, and a function of these."""
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    colour = lambda points: 255 * (points - low) / (high - low)
    image = np.zeros((size, size, 3))
    weights = RNG.dirichlet([1, 1, 1], 300)
    rows = np.concatenate([weights, np.eye(3)])
    at = np.einsum("wc,fcd->fwd", rows, uv).reshape(-1, 2)
    points = np.einsum("wc,fcd->fwd", rows, mesh.vertices[mesh.faces]).reshape(-1, 3)
    texel = np.stack([(1 - at[:, 1]) * size, at[:, 0] * size], 1).astype(int)
    image[texel[:, 0], texel[:, 1]] = colour(points)
    filled = image.any(2)
    rest = np.argwhere(~filled)
    near = KDTree(np.argwhere(filled)).query(rest)[1]
    image[rest[:, 0], rest[:, 1]] = image[filled][near]
    return np.rint(image).astype(np.uint8), colour


def test_a_texture_has_no_smear_at_seams():
    uv = charts(Y)
    image, colour = painted(Y, uv)
    both = exact()
    baked = transfer.texture(both, uv, image, size=512)
    assert baked.image.shape == (512, 512, 3) and baked.image.dtype == np.uint8
    weights = RNG.dirichlet([1, 1, 1], 20)
    at = np.einsum("wc,fcd->fwd", weights, baked.uv).reshape(-1, 2)
    seen = look_up(baked.image, at)
    points = np.einsum("wc,fcd->fwd", weights, COARSE.vertices[X.faces]).reshape(-1, 3)
    on_y = closest(surface_tree(Y), points).position
    wrong = np.abs(seen - colour(on_y)).max(1) > 8
    assert wrong.mean() < 0.002
    # One texture coordinate a vertex smears.
    per_vertex = np.zeros((N_Y, 2))
    per_vertex[Y.faces] = uv
    one = transfer.values(both, per_vertex)[X.faces]
    smeared = look_up(image, np.einsum("wc,fcd->fwd", weights, one).reshape(-1, 2))
    assert (np.abs(smeared - colour(on_y)).max(1) > 8).mean() > 0.05


@pytest.mark.parametrize("size", [128, 512])
def test_no_two_faces_share_a_texel(size):
    corners = Y.vertices[Y.faces][:400] * RNG.uniform(0.2, 3, (400, 1, 1))
    found = transfer.atlas(corners, size)
    taken = np.zeros((size, size), int)
    faces = []
    for cells in found.cells:
        texel = (cells.first[:, None] + cells.texels[None]).reshape(-1, 2)
        np.add.at(taken, (texel[:, 0], texel[:, 1]), 1)
        faces += cells.face.tolist()
        assert np.allclose(cells.weights.sum(1), 1) and cells.weights.min() >= 0
    assert sorted(faces) == list(range(400)) and taken.max() == 1
    assert found.uv.min() > 0 and found.uv.max() < 1
    # All faces are turned the same way in the image, the large ones the largest.
    one, two = found.uv[:, 1] - found.uv[:, 0], found.uv[:, 2] - found.uv[:, 0]
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    assert (area > 0).all()
    place = {
        tuple(texel): i for i, texel in enumerate(np.argwhere(taken >= 0).tolist())
    }
    assert len(place) == size**2 and area.min() * size**2 >= (8 - MARGIN) ** 2


def test_what_has_no_texture_is_grey():
    known = COARSE.vertices[:, 2] < 0.8
    uv = charts(Y)
    uv[at_faces(Y)[:, 2] < -1] = np.nan
    white = np.full((8, 8, 3), 255, np.uint8)
    baked = transfer.texture(exact()._replace(known_x=known), uv, white, size=256)
    middle = look_up(baked.image, baked.uv.mean(1))
    grey = (middle == 128).all(1)
    assert grey[~known[X.faces].all(1)].all()
    height = at_faces(COARSE)[:, 2]
    assert grey[height < -1.2].all()
    assert not grey[known[X.faces].all(1) & (height > -0.8)].any()


def test_colours_between_texels():
    image = np.arange(12, dtype=np.uint8).reshape(2, 2, 3) * 10
    at = lambda u, v: look_up(image, np.array([[u, v]]))[0].tolist()
    assert at(0.25, 0.75) == [0, 10, 20] and at(0.75, 0.25) == [90, 100, 110]
    assert at(0.5, 0.75) == [15, 25, 35] and at(1.25, -0.25) == [0, 10, 20]
    assert at(np.nan, 0) == [128, 128, 128]
    clear = look_up(np.zeros((2, 2, 4), np.uint8), np.full((1, 2), np.nan))
    assert clear[0].tolist() == [128, 128, 128, 255]


# Files.


def test_texture_coordinates_of_a_file(tmp_path):
    uv = charts(Y)
    for suffix in (".obj", ".glb"):
        path = tmp_path / f"y{suffix}"
        export_textured(path, Y, uv, png_of(np.zeros((4, 4, 3), np.uint8)))
        mesh = read(path)
        assert np.allclose(read_uv(path, mesh), uv, atol=1e-6)
        assert np.allclose(mesh.vertices[mesh.faces], Y.vertices[Y.faces], atol=1e-6)
    assert (read(tmp_path / "y.obj").vertices == Y.vertices).all()
    material = (tmp_path / "y.mtl").read_text()
    assert "map_Kd y.png" in material and (tmp_path / "y.png").exists()
    seen = trimesh.load(tmp_path / "y.glb", process=False, force="mesh")
    assert np.allclose(seen.visual.uv[seen.faces], uv, atol=1e-6)
    assert seen.visual.material.baseColorTexture.size == (4, 4)


def test_texture_coordinates_of_polygons(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nvt 0.5\nvt 1 0\nvt 1 1\n"
    path = tmp_path / "quad.obj"
    path.write_text(text + "f 1/1/1 2/2 3/3 4/-1\nf 2 5 3\n")
    uv = read_uv(path, read(path))
    assert np.isnan(uv[2]).all() and uv.shape == (3, 3, 2)
    mesh = read(path)
    known = {0: [0.5, 0], 1: [1, 0], 2: [1, 1], 3: [1, 1]}
    for face, corners in zip(mesh.faces[:2], uv[:2], strict=True):
        assert corners.tolist() == [known[v] for v in face.tolist()]
    ply = tmp_path / "quad.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y"
    head += "\nproperty float z\n{}element face 1\nproperty list uchar int "
    head += "vertex_indices\n{}end_header\n"
    corners = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
    flat = [[0, 0], [1, 0], [1, 1], [0, 1]]
    rows = "\n".join(f"{c} {u} {v}" for c, (u, v) in zip(corners, flat, strict=True))
    own = "property float s\nproperty float t\n"
    ply.write_text(head.format(own, "") + rows + "\n4 0 1 2 3\n")
    mesh = read(ply)
    expected = np.array(flat)[mesh.faces]
    assert (read_uv(ply, mesh) == expected).all()
    wedge = "property list uchar float texcoord\n"
    text = "\n".join(corners) + "\n4 0 1 2 3 8 0 0 1 0 1 1 0 1\n"
    ply.write_text(head.format("", wedge) + text)
    assert (read_uv(ply, read(ply)) == expected).all()
    ply.write_text(head.format("", "") + "\n".join(corners) + "\n4 0 1 2 3\n")
    with pytest.raises(MeshError, match="has no texture coordinates for its 2 faces"):
        read_uv(ply, read(ply))
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nf 1/1 2/1 3/5\n")
    with pytest.raises(MeshError, match="names texture coordinates 5 of 1"):
        read_uv(path, read(path))
    with pytest.raises(MeshError, match="holds no texture coordinates"):
        read_uv(tmp_path / "a.stl", Y)


@pytest.mark.parametrize("suffix", [".npy", ".csv", ".txt"])
def test_round_trips_of_columns(tmp_path, suffix):
    path = tmp_path / f"column{suffix}"
    rows = RNG.normal(size=(5, 2))
    rows[2, 1] = np.nan
    write_column(path, Column(rows))
    assert np.allclose(read_values(path, 5).rows, rows, equal_nan=True)
    write_column(path, Column(rows[:, 0]))
    assert np.allclose(read_values(path, 5).rows, rows[:, 0])
    for labels in (
        np.array([3, -1, 2]),
        np.array(["Kopf", "", "左手"]),
        np.array(["arm, left", "", ""]),
        np.array(['a "b"', "1_0", "2"]),
    ):
        write_column(path, Column(labels))
        found = read_labels(path, 9, 3).rows
        assert found.tolist() == labels.tolist()


def test_titles_are_kept(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("thick; bent\n1;2\n3;\n")
    found = read_values(path, 2)
    assert found.titles == ("thick", "bent") and np.isnan(found.rows[1, 1])
    write_column(path, found)
    assert path.read_text() == "thick,bent\n1,2\n3,nan\n"
    path.write_bytes("sep=;\r\nlänge;b\r\n1;2\r\n3;-1.#IND\r\n".encode("utf-16"))
    found = read_values(path, 2)
    assert found.titles == ("länge", "b")
    assert np.array_equal(found.rows, [[1, 2], [3, np.nan]], equal_nan=True)
    path.write_bytes("sep=;\r\nfuß\r\n1\r\n".encode("utf-16"))
    assert read_labels(path, 2, 7).rows.tolist() == ["fuß", "1"]
    path.write_bytes("fuß\n1\n".encode("cp1252"))
    with pytest.raises(ValueError, match="a.csv: is not UTF-8 .*; save it as that"):
        read_labels(path, 2, 7)
    path.write_text("part\r\n1\r\n2\r\n")
    found = read_labels(path, 2, 7)
    assert found.titles == ("part",) and found.rows.tolist() == [1, 2]


def test_labels_of_the_princeton_benchmark(tmp_path):
    path = tmp_path / "a.seg"
    path.write_text("0\n0\n3\n")
    found = read_labels(path, 2, 3)
    assert found.rows.tolist() == [0, 0, 3]
    write_column(tmp_path / "b.seg", found)
    assert (tmp_path / "b.seg").read_text() == path.read_text()
    with pytest.raises(ValueError, match="a.seg: values are .npy, .csv, .txt, not"):
        read_values(path, 3)


def test_parts_of_smpl(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"leftHand": [3, 1], "rückgrat": [1, 0]}', encoding="utf-8")
    found = read_labels(path, 5, 3)
    assert found.rows.tolist() == ["rückgrat", "leftHand", "", "leftHand", ""]
    write_column(tmp_path / "b.json", found)
    again = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert again == {"leftHand": [1, 3], "rückgrat": [0]}
    numbers = Column(np.array([4, -1, 4]))
    write_column(tmp_path / "c.json", numbers)
    assert json.loads((tmp_path / "c.json").read_text()) == {"4": [0, 2]}
    for text, message in (
        ("[1, 2]", "expected a list of vertices, counted from 0, for the name of each"),
        ("{}", "expected a list of vertices"),
        ('{"arm": 1}', "part 'arm' is no list; expected a list"),
        ('{"arm": [0.5]}', "part 'arm' is no list"),
        ('{"arm": [0, 5]}', "part 'arm' has vertex 5, and the mesh has 5, from 0 on"),
        ("{", "is no JSON"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=f"a.json: {message}"):
            read_labels(path, 5, 3)
    with pytest.raises(ValueError, match="b.json: values are"):
        write_column(tmp_path / "b.json", Column(np.zeros(3)))


def test_text_of_one_column(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("1\n\n3\n")
    assert np.allclose(read_values(path, 3).rows, [1, np.nan, 3], 0, 0, True)
    assert read_values(path, 2).rows.tolist() == [1, 3]
    np.savetxt(path, [1, 2])
    assert read_labels(path, 2, 9).rows.tolist() == [1, 2]
    for ending in ("", "\n", "\n\n", "\n\n\n"):
        path.write_text("a\nb" + ending)
        assert read_labels(path, 2, 9).rows.tolist() == ["a", "b"]
    path.write_text("1.5\n2\n")
    with pytest.raises(ValueError, match="label 1 is 1.5, not a whole number"):
        read_labels(path, 2, 9)
    path = tmp_path / "a.csv"
    path.write_text("0,arm\n1,leg\n")
    with pytest.raises(ValueError, match="line 1 has 2 cells, expected one label"):
        read_labels(path, 2, 9)


def test_wrong_columns_name_what_was_found(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("1\n2\n3\n")
    with pytest.raises(ValueError, match=r"a.txt: has 3 rows of numbers, expected 4"):
        read_values(path, 4)
    with pytest.raises(ValueError, match=r"has 3 labels, expected one for each of 7"):
        read_labels(path, 7, 9)
    path.write_text("1 2\n2 x\n")
    with pytest.raises(ValueError, match="line 2 is '2 x', expected 2 numbers"):
        read_values(path, 2)
    path.write_text("\n")
    with pytest.raises(ValueError, match="is empty"):
        read_values(path, 2)
    path = tmp_path / "a.npy"
    np.save(path, np.array([1.5, 2]))
    with pytest.raises(ValueError, match="label 1 is 1.5, not a whole number"):
        read_labels(path, 2, 3)
    np.save(path, np.array([1j, 2]))
    with pytest.raises(ValueError, match="complex128"):
        read_values(path, 2)
    with path.open("wb") as file:
        np.savez(file, a=np.zeros(2), b=np.zeros(2))
    with pytest.raises(ValueError, match="several arrays"):
        read_values(path, 2)
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match="a.npy: is no array"):
        read_values(path, 2)
    with pytest.raises(ValueError, match="not '.mat'"):
        read_values(tmp_path / "a.mat", 2)


def test_wrong_arguments_say_what_was_found(both):
    with pytest.raises(ValueError, match="does it run the other way"):
        transfer.overlay(X, Y, np.zeros(N_Y, int))
    with pytest.raises(ValueError, match="names vertices 0 to 9999"):
        transfer.overlay(X, Y, np.where(np.arange(N_X) == 3, 9999, 0))
    with pytest.raises(ValueError, match="matched_x is float64"):
        transfer.overlay(X, Y, T_XY, matched_x=np.ones(N_X))
    with pytest.raises(ValueError, match="one row a vertex of Y"):
        transfer.values(both, np.zeros(N_X))
    with pytest.raises(ValueError, match="whole numbers or names"):
        transfer.labels(both, np.zeros(N_Y))
    with pytest.raises(ValueError, match=f"has 3 labels, and Y has {N_Y} vertices"):
        transfer.labels(both, np.arange(3))
    with pytest.raises(ValueError, match="to is 'edges'"):
        transfer.labels(both, np.arange(N_Y), to="edges")
    image, uv = np.zeros((2, 2, 3), np.uint8), charts(Y)
    with pytest.raises(ValueError, match="uv_y is"):
        transfer.texture(both, uv[:5], image)
    with pytest.raises(ValueError, match="image_y is float64"):
        transfer.texture(both, uv, image.astype(float))
    with pytest.raises(ValueError, match="power of two"):
        transfer.texture(both, uv, image, size=100)
    with pytest.raises(ValueError, match="do not fit"):
        transfer.texture(both, uv, image, size=64)


def test_a_collection_carries_what_its_template_has(tmp_path, registered):
    meshes = {"template": X, "scan": Y}
    paths = {name: tmp_path / f"{name}.off" for name in meshes}
    for name, mesh in meshes.items():
        trimesh.Trimesh(*mesh, process=False).export(paths[name])
    read_back = {name: read(path) for name, path in paths.items()}
    shapes = {name: SimpleNamespace(mesh=mesh) for name, mesh in read_back.items()}
    (tmp_path / "registered").mkdir()
    np.savez(tmp_path / "registered" / "scan.npz", **registered._asdict())
    np.save(tmp_path / "v.npy", X.vertices)
    (tmp_path / "l.txt").write_text("\n".join(map(str, quadrant(at_faces(COARSE)))))
    files = {"labels": tmp_path / "l.txt", "values": tmp_path / "v.npy"}
    carried = carried_of(paths["template"], **files)
    rows = [{"name": "scan", "reason": ""}, {"name": "lost", "reason": "broken"}]
    args = tmp_path, rows, paths, shapes, "template", carried
    write_carried(*args, set(), read_back["template"])
    values = np.load(tmp_path / "values" / "scan.npy")
    assert np.linalg.norm(values - bent(Y.vertices), axis=1).mean() < 0.02 * UNIT
    right = np.loadtxt(tmp_path / "labels" / "scan.txt") == quadrant(at_faces(Y))
    assert right.mean() > 0.9
    assert len(list((tmp_path / "labels").iterdir())) == 1
    with pytest.raises(ValueError, match=f"{N_X} vertices or of {len(X.faces)} faces"):
        carried_of(paths["template"], labels=tmp_path / "v.npy")
    # What is kept of a scan that was mirrored back is the mirror image of its file.
    trimesh.Trimesh(*mirror_image(read_back["scan"]), process=False).export(
        paths["scan"]
    )
    write_carried(*args, {"scan"}, read_back["template"])
    again = np.load(tmp_path / "values" / "scan.npy")
    np.testing.assert_allclose(again, values, atol=1e-6)


# The command.


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("transfer")
    write_map(folder / "map.npz", T_XY.astype(np.int32))
    for name, mesh in (("x", X), ("y", Y)):
        trimesh.Trimesh(*mesh, process=False).export(folder / f"{name}.off")
    file = io.BytesIO()
    Image.new("RGB", (8, 8), (200, 10, 10)).save(file, "png")
    export_textured(folder / "seams.obj", Y, charts(Y), file.getvalue())
    return folder


def test_the_command_carries_values_and_labels(folder):
    pair = folder / "x.off", folder / "y.off", folder / "map.npz"
    np.savetxt(folder / "v.txt", Y.vertices)
    found = run(*pair, "--values", folder / "v.txt", "--out", folder / "xv.npy")
    assert found.exit_code == 0, found.output
    carried = np.load(folder / "xv.npy")
    assert np.linalg.norm(carried - COARSE.vertices, axis=1).mean() < 0.012 * UNIT
    np.save(folder / "l.npy", quadrant(at_faces(Y)))
    args = "--labels", folder / "l.npy", "--to", "faces", "--out", folder / "xl.txt"
    assert run(*pair, *args).exit_code == 0
    right = np.loadtxt(folder / "xl.txt") == quadrant(at_faces(COARSE))
    assert right.mean() > 0.9
    parts = {"left": Y.vertices[:, 0] < 0, "right": Y.vertices[:, 0] >= 0}
    text = json.dumps({name: np.flatnonzero(of).tolist() for name, of in parts.items()})
    (folder / "parts.json").write_text(text)
    args = "--labels", folder / "parts.json", "--out", folder / "xp.json"
    assert run(*pair, *args).exit_code == 0
    left = json.loads((folder / "xp.json").read_text())["left"]
    is_left = np.isin(np.arange(len(COARSE.vertices)), left)
    assert (is_left == (COARSE.vertices[:, 0] < 0)).mean() > 0.9
    refused = run(*pair, *args, "--to", "faces")
    assert refused.exit_code == 1 and "give --to vertices" in refused.output


def test_the_command_carries_a_texture_and_landmarks(folder):
    pair = folder / "x.off", folder / "seams.obj", folder / "map.npz"
    out = folder / "x_new.obj"
    args = "--texture", folder / "seams.png", "--size", "256", "--out", out
    found = run(*pair, *args)
    assert found.exit_code == 0, found.output
    assert np.allclose(read(out).vertices, X.vertices, atol=1e-6)
    image = read_image(folder / "x_new.png")
    middle = look_up(image, read_uv(out, read(out)).mean(1))
    assert (middle == [200, 10, 10]).all()
    at = Y.vertices[[Y.vertices[:, 2].argmax()]]
    write_landmarks(folder / "tip.fcsv", Landmarks(("tip",), at))
    args = "--landmarks", folder / "tip.fcsv", "--out", folder / "tip.mrk.json"
    assert run(*pair, *args).exit_code == 0
    tip = read_landmarks(folder / "tip.mrk.json")
    assert tip.names == ("tip",)
    assert np.linalg.norm(tip.points - bent(at)) < 0.05 * UNIT


def test_the_command_says_how_far_off_landmarks_may_be(folder):
    figures = jnp.asarray(0.9)
    evidence = Certificate(*(figures for _ in Certificate._fields))
    radius = np.linspace(0.01, 0.02, N_Y)
    match = jfsf.Match(
        T_XY.astype(np.int32),
        KDTree(COARSE.vertices).query(Y.vertices)[1].astype(np.int32),
        np.eye(20),
        evidence._replace(landmarks=jnp.zeros(0), finite=jnp.asarray(True)),
        radius_y=radius,
    )
    write_match(folder / "sure.npz", match)
    write_landmarks(folder / "tip.csv", Landmarks(("tip",), Y.vertices[[7]]))
    args = "--landmarks", folder / "tip.csv", "--out", folder / "tip.pp"
    found = run(folder / "x.off", folder / "y.off", folder / "sure.npz", *args)
    assert found.exit_code == 0, found.output
    length = radius[7] * np.sqrt(surface_area(read(folder / "x.off")))
    assert f"tip: within {length:.3g}, 90 %" in " ".join(found.output.split())


def test_the_command_takes_what_repair_is_for(folder):
    rows = [f"v {x} {y} {z}" for x, y, z in X.vertices] + ["v nan 0 0"]
    rows += [f"f {a} {b} {c}" for a, b, c in X.faces + 1]
    (folder / "broken.obj").write_text("\n".join(rows))
    np.savetxt(folder / "v.txt", Y.vertices)
    write_map(folder / "repaired.npz", np.append(T_XY, 0).astype(np.int32))
    pair = folder / "broken.obj", folder / "y.off", folder / "repaired.npz"
    args = "--values", folder / "v.txt", "--out", folder / "b.npy", "--repair"
    found = run(*pair, *args)
    assert found.exit_code == 0, found.output
    carried = np.load(folder / "b.npy")
    assert len(carried) == N_X + 1 and np.isnan(carried[-1]).all()
    assert np.isfinite(carried[:-1]).all()


def test_maps_of_parts_beside_vertices_without_a_face(folder):
    """What is matched is of the file's vertices; those without a face are dropped."""
    far = [[9.0, 9.0, 9.0]]
    strays = Mesh(np.vstack([far, X.vertices]), X.faces + 1)
    trimesh.Trimesh(*strays, process=False).export(folder / "strays.off")
    lower = np.append(False, X.vertices[:, 0] < 0)
    figures = jnp.asarray(0.9)
    evidence = Certificate(*(figures for _ in Certificate._fields))
    match = jfsf.Match(
        np.append(0, T_XY).astype(np.int32),
        1 + KDTree(COARSE.vertices).query(Y.vertices)[1].astype(np.int32),
        np.eye(20),
        evidence._replace(landmarks=jnp.zeros(0), finite=jnp.asarray(True)),
        matched_x=lower,
        matched_y=np.ones(N_Y, bool),
    )
    write_match(folder / "parts.npz", match)
    pair = folder / "strays.off", folder / "y.off", folder / "parts.npz"
    ask = "--labels", folder / "l.npy", "--out", folder / "parts.txt"
    np.save(folder / "l.npy", quadrant(Y.vertices))
    assert run(*pair, *ask).exit_code == 0
    mirrors = match.certificate._replace(orientation=jnp.asarray(-0.9))
    write_match(folder / "mirrors.npz", match._replace(certificate=mirrors))
    words = " ".join(run(*pair[:2], folder / "mirrors.npz", *ask).output.split())
    assert "the map mirrors, orientation -0.90" in words
    command = ["register", *pair[:2], "--map", pair[2], "--out", folder / "r.ply"]
    found = CliRunner().invoke(app, list(map(str, command)))
    assert found.exit_code == 0, found.output
    words = " ".join(found.output.split())
    assert f"1 of {N_X + 1} vertices are left out" in words
    assert len(read(folder / "r.ply").vertices) == N_X
    truth = np.arange(1, N_X + 1), T_XY
    for name, rows in zip(("gx.vts", "gy.vts"), truth, strict=True):
        np.savetxt(folder / name, rows + 1, "%d")
    command = ["evaluate", *pair, "--gt-x", folder / "gx.vts", "--gt-y"]
    command += [folder / "gy.vts", "--json", folder / "e.json"]
    found = CliRunner().invoke(app, list(map(str, command)))
    assert found.exit_code == 0, found.output
    record = json.loads((folder / "e.json").read_text())
    assert record["points_left_out"] == N_X - lower.sum()
    assert record["figures"]["error_max"] == 0


def test_images_of_more_than_eight_bits_are_an_error(tmp_path):
    deep = np.full((2, 2), 30000, np.uint16)
    Image.fromarray(deep).save(tmp_path / "deep.png")
    with pytest.raises(ValueError, match="more than 8 bits a channel"):
        read_image(tmp_path / "deep.png")


def test_the_command_refuses_before_it_works(folder):
    pair = folder / "x.off", folder / "y.off", folder / "map.npz"
    out = "--out", folder / "none.npy"
    np.save(folder / "few.npy", np.zeros(7))
    few = "--values", folder / "few.npy"
    cases = {
        "nothing was given": [],
        "--values and --labels was given": [*few, "--labels", folder / "few.npy"],
        f"few.npy: is float64 (7,); expected numbers ({N_Y},)": few,
        "holds no T_yx": [*few, "--from", "x"],
        "give --labels": [*few, "--to", "faces"],
        "written as .obj, .glb": ["--texture", folder / "seams.png"],
        "landmarks are written as": ["--landmarks", folder / "tip.fcsv"],
    }
    np.save(folder / "few.npy", np.zeros(7))
    for words, args in cases.items():
        if "T_yx" in words:
            np.save(folder / "few.npy", np.zeros(N_X))
        found = run(*pair, *args, *out)
        assert found.exit_code == 1 and words in " ".join(found.output.split()), words
        np.save(folder / "few.npy", np.zeros(7))
    assert not (folder / "none.npy").exists()
    over = folder / "seams.obj"
    args = "--texture", folder / "seams.png", "--out", folder / "seams.obj"
    found = run(folder / "x.off", over, folder / "map.npz", *args)
    assert found.exit_code == 1 and "is an input" in found.output
    text = folder / "text.png"
    text.write_text("no image")
    args = "--texture", text, "--out", folder / "none.glb"
    found = run(folder / "x.off", over, folder / "map.npz", *args)
    assert found.exit_code == 1 and "is not a readable image" in found.output
