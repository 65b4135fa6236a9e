"""A template on a scan: near it, whole, without flaws, wherever the scan lies."""

from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import jfsf
from jfsf.apps.cli._app import app
from jfsf.apps.export import export_mesh
from jfsf.apps.mapfiles import write_map
from jfsf.apps.registration import Registration, RegistrationSettings, register
from jfsf.apps.registration._flaws import flaws_of, unfold
from jfsf.apps.registration._register import scale_and_sign, scan_of
from jfsf.mesh import MeshError, closest, read, surface_area
from jfsf.mesh._closest import nearest_of, on_rim, surface_tree
from jfsf.refine._rest import at_rest
from jfsf.testing import blob, mirror
from jfsf.types import Certificate, Mesh

TEMPLATE = blob(0, subdivisions=3)
N = len(TEMPLATE.vertices)


def bent(points):
    """A smooth deformation that bends, and stretches by up to a fifth."""
    x, y, z = points.T
    angle = 0.5 * x
    turned = (
        np.cos(angle) * y - np.sin(angle) * z,
        np.sin(angle) * y + np.cos(angle) * z,
    )
    return np.stack([x, 1.1 * turned[0], turned[1] + 0.1 * x**2], 1)


def scan_with_map(seed=0):
    """The template bent, with four times the faces, in another order; and the map."""
    vertices, faces = trimesh.remesh.subdivide(*TEMPLATE)
    order = np.random.default_rng(seed).permutation(len(vertices))
    place = np.argsort(order)
    return Mesh(bent(vertices)[order], place[faces].astype(np.int32)), place[:N]


SCAN, T = scan_with_map()
UNIT = np.sqrt(surface_area(SCAN))
TRUTH = bent(TEMPLATE.vertices)


@pytest.fixture(scope="module")
def found():
    return register(TEMPLATE, SCAN, T)


def error(found: Registration, truth=TRUTH, unit=UNIT):
    """Of each vertex, in sqrt(area)."""
    return np.linalg.norm(found.vertices - truth, axis=1) / unit


def is_whole(found: Registration):
    return found.flipped == 0 and found.collapsed == 0


def test_the_template_lies_on_the_scan(found):
    assert found.distance.mean() < 0.0015 * UNIT
    assert np.quantile(found.distance, 0.95) < 0.005 * UNIT
    assert is_whole(found) and not found.bridged.any()
    assert error(found).mean() < 0.005
    assert found.orientation_sign == 1
    assert 0.9 < found.scale < 1.2


def test_the_points_below_are_on_the_faces_of_the_scan(found):
    corners = SCAN.vertices[SCAN.faces[found.on_face]]
    below = np.einsum("nc,ncd->nd", found.barycentric, corners)
    away = np.linalg.norm(found.vertices - below, axis=1)
    np.testing.assert_allclose(away, found.distance, atol=1e-12)
    assert found.barycentric.min() >= 0
    np.testing.assert_allclose(found.barycentric.sum(1), 1)


def test_it_follows_the_scan_whatever_the_units(found):
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    move = lambda points: 1000 * points @ turn.T + [3e4, -1e4, 500]
    template = Mesh(TEMPLATE.vertices * 0.01 + [5, 0, 2], TEMPLATE.faces)
    again = register(template, Mesh(move(SCAN.vertices), SCAN.faces), T)
    np.testing.assert_allclose(again.vertices, move(found.vertices), atol=1e-3)
    np.testing.assert_allclose(again.distance, 1000 * found.distance, atol=1e-3)
    np.testing.assert_allclose(again.scale, 1e5 * found.scale, rtol=1e-6)


def test_a_scan_that_is_the_template():
    found = register(TEMPLATE, TEMPLATE, np.arange(N))
    np.testing.assert_allclose(found.vertices, TEMPLATE.vertices, atol=1e-6)
    assert is_whole(found) and abs(found.scale - 1) < 1e-6


def test_a_map_that_mirrors(found):
    there = mirror(SCAN)
    again = register(TEMPLATE, there, T)
    assert again.orientation_sign == -1 and is_whole(again)
    np.testing.assert_allclose(again.vertices * [-1, 1, 1], found.vertices, atol=1e-6)
    same = register(TEMPLATE, there, T, orientation_sign=-1)
    assert np.array_equal(same.vertices, again.vertices)


def test_a_scan_that_is_wound_inward(found):
    # Faces keep their corners: the weights are those of the file.
    again = register(TEMPLATE, Mesh(SCAN.vertices, SCAN.faces[:, ::-1]), T)
    np.testing.assert_allclose(again.vertices, found.vertices, atol=1e-9)
    assert again.orientation_sign == 1


def test_a_map_with_noise_is_made_smooth(found):
    rng = np.random.default_rng(1)
    near = np.asarray(KDTree(SCAN.vertices).query(SCAN.vertices[T], 8)[1])
    noisy = near[np.arange(N), rng.integers(0, 8, N)]
    again = register(TEMPLATE, SCAN, noisy)
    assert is_whole(again)
    assert error(again).mean() < 0.6 * (
        np.linalg.norm(SCAN.vertices[noisy] - TRUTH, axis=1).mean() / UNIT
    )


@pytest.fixture(scope="module")
def holed():
    """The scan with a hole, the map to what is left, and vertices of the hole."""
    centre = TRUTH[np.argmax(TRUTH[:, 0])]
    inside = np.linalg.norm(SCAN.vertices - centre, axis=1) < 0.12 * UNIT
    faces = SCAN.faces[~inside[SCAN.faces].any(1)]
    index = np.unique(faces)
    number = np.full(len(SCAN.vertices), -1)
    number[index] = np.arange(len(index))
    left = SCAN.vertices[index]
    nearest = np.asarray(KDTree(left).query(TRUTH)[1])
    scan = Mesh(left, number[faces].astype(np.int32))
    return scan, nearest, np.linalg.norm(TRUTH - centre, axis=1) < 0.09 * UNIT


def test_a_hole_is_bridged(holed):
    scan, nearest, inside = holed
    found = register(TEMPLATE, scan, nearest)
    assert is_whole(found)
    assert inside.sum() > 5 and found.bridged[inside].all()
    assert found.bridged.mean() < 2 * inside.mean()
    assert found.distance[~found.bridged].max() < 0.01 * UNIT
    assert error(found)[inside].max() < 0.05


def test_what_is_not_matched_keeps_its_form(holed):
    scan, nearest, inside = holed
    wrong = np.where(inside, 0, nearest)
    matched = ~inside & (KDTree(scan.vertices).query(TRUTH)[0] < 0.02 * UNIT)
    found = register(TEMPLATE, scan, wrong, matched=matched)
    assert is_whole(found) and error(found)[inside].max() < 0.05


def test_the_rim_of_an_open_template_goes_to_that_of_the_scan():
    def half(mesh):
        kept = mesh.vertices[:, 2] > -0.2
        faces = mesh.faces[kept[mesh.faces].all(1)]
        index, corners = np.unique(faces, return_inverse=True)
        return Mesh(mesh.vertices[index], corners.reshape(-1, 3).astype(np.int32))

    part = half(TEMPLATE)
    found = register(
        part, Mesh(bent(part.vertices), part.faces), np.arange(len(part[0]))
    )
    unit = np.sqrt(surface_area(part))
    assert is_whole(found) and not found.bridged.any()
    assert error(found, bent(part.vertices), unit).max() < 0.03


@pytest.mark.parametrize(
    "change, words",
    [
        ({"T": T[:-1]}, "does it run the other way"),
        ({"T": T.astype(float)}, "give .* whole numbers"),
        ({"T": T + len(SCAN.vertices)}, "names vertices"),
        ({"matched": np.ones(N)}, "bool"),
        ({"matched": np.zeros(N, bool)}, "must be matched"),
        ({"orientation_sign": 0}, "orientation_sign is 0"),
        ({"scan": Mesh(SCAN.vertices, SCAN.faces[:0])}, "scan: has no faces"),
        (
            {"template": Mesh(TEMPLATE.vertices, TEMPLATE.faces[:9])},
            "belong to no face",
        ),
    ],
)
def test_what_it_refuses(change, words):
    given: dict[str, Any] = {"template": TEMPLATE, "scan": SCAN, "T": T} | change
    with pytest.raises(ValueError, match=words):
        register(**given)


def test_flaws_are_counted():
    rest, scan = at_rest(TEMPLATE), scan_of(TEMPLATE)
    clean = flaws_of(rest, TEMPLATE.vertices, 1.0, scan, 1)
    assert not clean.flipped.any() and not clean.collapsed.any()
    a, b, c = TEMPLATE.faces[100]
    folded = TEMPLATE.vertices.copy()
    folded[a] += 2.5 * (folded[[b, c]].mean(0) - folded[a])
    assert flaws_of(rest, folded, 1.0, scan, 1).flipped[100]
    flat = TEMPLATE.vertices.copy()
    flat[a] = flat[b]
    assert flaws_of(rest, flat, 1.0, scan, 1).collapsed[100]


@pytest.mark.parametrize("corners", [[100], [100, 300, 700]])
def test_what_is_turned_over_is_turned_back_and_the_rest_stays(corners):
    rest, scan = at_rest(TEMPLATE), scan_of(TEMPLATE)
    folded = TEMPLATE.vertices.copy()
    for face in corners:
        a, b, c = TEMPLATE.faces[face]
        folded[a] += 2.5 * (folded[[b, c]].mean(0) - folded[a])
    flawed = lambda moved: flaws_of(rest, moved, 1.0, scan, 1).flipped
    assert flawed(folded)[corners].all()
    moved = unfold(rest, folded, 1.0, flawed)
    assert not flawed(moved).any()
    changed = (moved != folded).any(1)
    assert changed.sum() < 40 * len(corners)
    away = np.linalg.norm(moved - folded, axis=1)
    assert away.max() <= np.linalg.norm(folded - TEMPLATE.vertices, axis=1).max()


def test_a_flaw_that_nothing_mends_stays():
    always = np.zeros(len(TEMPLATE.faces), bool)
    always[7] = True
    moved = unfold(at_rest(TEMPLATE), TEMPLATE.vertices, 1.0, lambda _: always)
    np.testing.assert_array_equal(moved, TEMPLATE.vertices)


@pytest.mark.parametrize("sign", [1, -1])
def test_scale_and_side_are_read_from_the_map(sign):
    images = 3.0 * bent(TEMPLATE.vertices) * [sign, 1, 1]
    scale, found = scale_and_sign(TEMPLATE.vertices, images)
    assert found == sign and 2.8 < scale < 3.5


@pytest.mark.parametrize("seed", range(3))
def test_the_closest_point_is_that_of_all_faces(seed):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(40, 3)) * [10 if seed else 1, 1, 1]
    faces = rng.permuted(np.tile(np.arange(40), (60, 1)), axis=1)[:, :3]
    surface = surface_tree(Mesh(vertices, faces))
    points = rng.normal(size=(30, 3)) * 3
    row, every = np.repeat(np.arange(30), 60), np.tile(np.arange(60), 30)
    found, best = closest(surface, points), nearest_of(surface, points, row, every)
    np.testing.assert_allclose(found.distance, best.distance, rtol=1e-12)
    at = np.einsum("qc,qcd->qd", found.barycentric, vertices[faces[found.face]])
    np.testing.assert_allclose(at, found.position, atol=1e-12)
    # Of points on the faces, and by another library.
    other = trimesh.triangles.closest_point(vertices[faces[found.face]], points)
    np.testing.assert_allclose(found.position, other, atol=1e-9)


def test_points_on_the_rim():
    square = Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), QUAD)
    surface = surface_tree(square)
    points = np.array([[0.5, -1, 0], [2, 2, 0], [0.5, 0.5, 1], [0.6, 0.3, 1]])
    assert on_rim(surface, closest(surface, points)).tolist() == [
        True,
        True,
        False,
        False,
    ]
    with pytest.raises(MeshError, match="no faces"):
        surface_tree(Mesh(square.vertices, QUAD[:0]))


QUAD = np.array([[0, 1, 2], [0, 2, 3]])
FIGURES = dict.fromkeys(Certificate._fields, np.asarray(0.95))
FIGURES |= {"confidence": np.asarray(0.6), "landmarks": np.zeros(0)}
FIGURES |= {"empty": np.asarray(0), "finite": np.asarray(True)}
FIGURES |= {"rivals": np.asarray(0.0), "mirrored": np.asarray(0.0)}
FIGURES |= {"region_cost": np.asarray(np.nan)}
FIGURES |= {f"bijectivity_{side}": np.asarray(0.01) for side in "xy"}
DOUBTFUL = Certificate(**FIGURES)


def run(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("register")
    export_mesh(folder / "template.ply", TEMPLATE)
    export_mesh(folder / "scan.ply", SCAN)
    write_map(folder / "map.npz", T)
    return folder


def test_the_command_writes_the_template_on_the_scan(folder, found):
    files = folder / "template.ply", folder / "scan.ply"
    out = folder / "warped.ply"
    done = run("register", *files, "--out", out, "--map", folder / "map.npz")
    assert done.exit_code == 0, done.output
    for words in ("distance to the scan", "flipped faces", "bridged vertices"):
        assert words in done.output
    mesh = read(out)
    assert np.array_equal(mesh.faces, TEMPLATE.faces)
    np.testing.assert_allclose(mesh.vertices, found.vertices, atol=1e-9)
    data = meshio.read(out).point_data
    np.testing.assert_allclose(data["quality"], found.distance, atol=1e-6)
    assert not data["bridged"].any()


def test_the_command_finds_a_map_itself(folder, monkeypatch):
    def match(mesh, scan, *, orientation, cache, progress):
        assert (orientation, cache) == ("any", False) and progress
        assert len(mesh.vertices) == N and len(scan.vertices) == len(SCAN.vertices)
        return SimpleNamespace(T_xy=T, certificate=DOUBTFUL)

    monkeypatch.setattr("jfsf.matching.match", match)
    files = folder / "template.ply", folder / "scan.ply"
    args = "--out", folder / "found.obj", "--orientation", "any", "--no-cache"
    done = run("register", *files, *args)
    assert done.exit_code == 0, done.output
    assert "0.60, doubtful" in done.output and "warning: " in done.output
    assert np.array_equal(read(folder / "found.obj").faces, TEMPLATE.faces)


@pytest.mark.parametrize(
    "change, words",
    [
        (("--out", "warped.stl"), "not '.stl'"),
        (("--largest-component",), "leave it out"),
        (("--map", "none.npz"), "none.npz"),
    ],
)
def test_the_command_refuses_in_one_line(folder, change, words):
    args = ["register", folder / "template.ply", folder / "scan.ply"]
    args += ["--out", folder / "never.ply", "--map", folder / "map.npz"]
    done = run(*args, *change)
    assert done.exit_code == 1 and words in done.stderr
    assert done.stderr.count("\n") == 1 and not (folder / "never.ply").exists()


def test_values_of_a_vertex_have_names_of_their_own(tmp_path):
    for name in ("x", "Height", "rgb", ""):
        with pytest.raises(ValueError, match="take another name"):
            export_mesh(tmp_path / "a.ply", TEMPLATE, values={name: np.zeros(N)})
    with pytest.raises(ValueError, match="height"):
        export_mesh(tmp_path / "a.ply", TEMPLATE, values={"height": np.zeros(3)})


def test_it_is_at_the_top():
    assert jfsf.register is register and jfsf.Registration is Registration


@pytest.mark.parametrize(
    "change",
    [
        {"hold": 0.0},
        {"max_distance": np.nan},
        {"reaches": ()},
        {"map_reaches": (0.1, 0.0)},
    ],
)
def test_numbers_that_nothing_can_be_registered_with(change):
    with pytest.raises(
        ValueError, match=f"RegistrationSettings: .*{next(iter(change))}"
    ):
        RegistrationSettings(**change)
