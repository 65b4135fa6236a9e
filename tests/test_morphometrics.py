"""Morphometrics: geomorph's numbers, dense oracles, invariances, and the command.

`gpagen.json` holds landmarks of embedded bodies (points of their template) and what R
made of them: the source of geomorph 4.0.9, without printing and parallel work (the
package needs a newer R), with the body of gpagen of 4.1.0, which calls it:

    A <- arrayspecs(read.csv("landmarks.csv", row.names = 1), 17, 3)
    none <- gpagen(A); bending <- gpagen(A, curves, surface)
    surfaces <- gpagen(A, surfaces = surface)
    procrustes <- gpagen(A, curves, surface, ProcD = TRUE)
    turned <- gpagen(A, all turned by TURN)     # the first specimen
    sym <- bilat.symmetry(A without curves, object.sym = TRUE, pairs)$symm.shape
    estimate.missing(A, "TPS")                  # landmarks 5 and 16 of specimen 2
    fit <- lm(two.d.array(none$coords) ~ log(none$Csize))    # procD.lm
    prcomp(two.d.array(none$coords))

Numbers of landmarks are from 0 there.
"""

import csv
import json
from functools import cache
from itertools import combinations, permutations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import jfsf
from jfsf import testing
from jfsf.apps import morphometrics as room
from jfsf.apps.cli._app import app
from jfsf.apps.landmarks import (
    Landmarks,
    read_landmarks,
    read_specimens,
    write_landmarks,
)
from jfsf.apps.landmarks._morphometrics import specimens_csv, specimens_tps
from jfsf.apps.morphometrics._draw import draw_components
from jfsf.apps.morphometrics._procrustes import similarity
from jfsf.apps.morphometrics._sliding import Sliders, bending_energy, slide
from jfsf.apps.morphometrics._tables import ALONE, lists_in, write_lists

R = json.loads(Path(__file__).with_name("gpagen.json").read_text())
PAIRS = R["pairs"]
OFF_CURVES = [i for i in range(17) if i not in (8, 9, 10, 11)]  # those that slide there
TURN = Rotation.from_euler("xyz", [241, 289, 8], degrees=True).as_matrix()
RNG = np.random.default_rng(0)
MEAN = RNG.normal(size=(9, 3))


def near(found, expected, atol=1e-6):
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


@cache
def bodies():
    """Landmarks (6, 17, 3) of embedded bodies."""
    found = map(jfsf.data.load, R["specimens"])
    at = R["template_points"]
    return np.stack([one.mesh.vertices[one.template_to_vertex[at]] for one in found])


def like(s, *, spread=0.02, seed=1):
    """Landmarks of s specimens near MEAN, in places and sizes of their own."""
    rng = np.random.default_rng(seed)
    shapes = MEAN + spread * rng.normal(size=(s, *MEAN.shape))
    turns = Rotation.random(s, rng=seed).as_matrix()
    sizes = np.exp(rng.normal(size=(s, 1, 1)))
    return sizes * np.einsum("sab,slb->sla", turns, shapes) + rng.normal(size=(s, 1, 3))


@pytest.mark.parametrize(
    "name, curves, surface, slide",
    [
        ("none", False, False, "bending"),
        ("surfaces", False, True, "bending"),
        ("bending", True, True, "bending"),
        ("procrustes", True, True, "procrustes"),
    ],
)
def test_procrustes_is_gpagen(name, curves, surface, slide):
    options = {"curves": R["curves"] if curves else None}
    options |= {"surfaces": R["surface"] if surface else None}
    found = room.procrustes(bodies(), slide=slide, **options)
    expected = np.reshape(R[name], found.shapes.shape)
    near(found.shapes, expected)
    near(found.sizes, R["sizes"])
    near(found.mean, expected.mean(0))
    away = np.linalg.norm((expected - expected.mean(0)).reshape(6, -1), axis=1)
    near(found.distances, away)
    # gpagen says 3 and 5 iterations, and 11 where it gives up.
    assert found.rested == (name in ("none", "surfaces"))


def test_axes_of_gpagen_that_mirror_are_turned_back():
    found = room.procrustes(bodies() @ TURN.T)
    near(found.shapes[0] * [1, 1, -1], np.reshape(R["turned"], (17, 3)))


def test_place_size_and_pose_of_a_specimen_do_not_count():
    points, rng = like(6), np.random.default_rng(2)
    before = room.procrustes(points)
    turns = Rotation.random(5, rng=3).as_matrix()
    factors = np.r_[1, 1 + rng.random(5)]
    moved = points * factors[:, None, None] + rng.normal(size=(6, 1, 3))
    moved[1:] = np.einsum("sab,slb->sla", turns, moved[1:])
    after = room.procrustes(moved)
    near(after.shapes, before.shapes, 1e-12)
    near(after.sizes, before.sizes * factors, 1e-12)


def test_the_order_of_specimens_and_landmarks_hardly_counts():
    """The first specimen is the first mean, and gpagen ends before it rests wholly."""
    points = like(6)
    specimens, landmarks = [3, 1, 0, 5, 4, 2], RNG.permutation(9)
    before = room.procrustes(points).shapes[specimens][:, landmarks]
    after = room.procrustes(points[specimens][:, landmarks]).shapes
    between = lambda shapes: cdist(*[shapes.reshape(6, -1)] * 2)
    near(between(after), between(before), 1e-4)


def test_a_mirror_image_is_not_turned_onto_the_others():
    points = np.stack([MEAN, MEAN, MEAN, MEAN * [-1, 1, 1]])
    away = room.procrustes(points).distances
    assert away[3] > 2 * away[:3].max() and away.min() > 0.05


def test_sliding_is_the_least_energy_along_the_directions():
    """One slide against a dense solver of the same quadratic form."""
    mean, shape = MEAN, MEAN + 0.1 * RNG.normal(size=MEAN.shape)
    sliders = Sliders(np.array([[0, 1, 2]]), np.zeros(0, int))
    energy = -bending_energy(mean)
    assert np.linalg.eigvalsh(energy).min() > -1e-12  # an energy
    near(energy @ np.c_[np.ones(9), mean], 0, 1e-9)  # of what is not affine
    found = slide(shape[None], mean, sliders, energy)[0]
    tried = np.repeat(shape[None], 4001, 0)
    tried[:, 1] += np.linspace(-1, 1, 4001)[:, None] * (shape[2] - shape[0])
    off = tried - mean
    energies = np.einsum("sld,lk,skd->s", off, energy, off)
    near(found, tried[energies.argmin()], 1e-3)


@pytest.mark.parametrize("signs", [[1, 1, 1], [1, 1, -1]])
def test_a_similarity_is_that_of_least_squares(signs):
    onto = like(1, spread=0.5)[0] * signs
    scale, turn, shift = similarity(MEAN, onto)
    a, b = (own - own.mean(0) for own in (MEAN, onto))
    near(turn.T, Rotation.align_vectors(b, a)[0].as_matrix(), 1e-9)
    off = scale * MEAN @ turn + shift - onto
    near(off.sum(0), 0, 1e-9)  # nor does another shift
    near((off * (a @ turn)).sum(), 0, 1e-9)  # or scale bring them nearer


def test_missing_landmarks_are_those_of_geomorph():
    points = bodies().copy()
    points[1, [4, 15]] = np.nan
    found = room.estimate_missing(points)
    near(found[1, [4, 15]], R["estimate_missing"])
    near(np.delete(found, 1, 0), np.delete(bodies(), 1, 0))
    assert room.estimate_missing(bodies()) is not points


def test_the_spline_interpolates_and_keeps_affine_maps():
    targets = MEAN + 0.1 * RNG.normal(size=MEAN.shape)
    near(room.warp(MEAN, MEAN, targets), targets, 1e-9)
    matrix, points = RNG.normal(size=(3, 3)), RNG.normal(size=(20, 3))
    near(room.warp(points, MEAN, MEAN @ matrix + 1), points @ matrix + 1, 1e-9)


def test_components_are_those_of_prcomp():
    shapes = room.procrustes(bodies()).shapes
    found = room.components(shapes)
    expected = np.array(R["prcomp_variances"])
    near(found.variance, expected, 1e-9)
    near(found.share, expected / expected.sum())
    rebuilt = found.mean + np.einsum("sk,kld->sld", found.scores, found.axes)
    near(rebuilt, shapes, 1e-12)
    near(np.einsum("kld,mld->km", found.axes, found.axes), np.eye(5), 1e-12)


def test_allometry_is_procd_lm():
    aligned = room.procrustes(bodies())
    found = room.allometry(aligned.shapes, aligned.sizes)
    near(found.sums, R["procD_lm_SS"], 1e-9)
    near(found.scores, R["RegScore"])
    assert found.share == pytest.approx(found.sums[0] / found.sums[2])
    assert found.F == pytest.approx(found.sums[0] / (found.sums[1] / 4))
    # All 720 orders, one by one, by least squares.
    flat, log = aligned.shapes.reshape(6, -1), np.log(aligned.sizes)
    rest = []
    for order in permutations(range(6)):
        design = np.c_[np.ones(6), log[list(order)]]
        rest.append(np.linalg.lstsq(design, flat)[1].sum())
    as_good = np.array(rest) <= rest[0] * (1 + 1e-9)
    assert (found.orders, found.p) == (720, pytest.approx(as_good.mean()))


def test_chance_alone_gives_any_p():
    """40 sets of 12 specimens without allometry, and one that has it."""
    ps = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        shapes, sizes = rng.normal(size=(12, 5, 3)), np.exp(rng.normal(size=12))
        ps.append(room.allometry(shapes, sizes, permutations=199).p)
    assert 0.35 < np.mean(ps) < 0.65 and 0.3 < np.mean(np.array(ps) < 0.5) < 0.7
    shapes += np.log(sizes)[:, None, None] * MEAN[:5]
    found = room.allometry(shapes, sizes, permutations=1500)  # in two pieces
    assert found.p == 1 / 1501 and found.orders == 1501
    slope = found.slope.ravel() @ MEAN[:5].ravel() / np.linalg.norm(found.slope)
    assert slope > 0.9 * np.linalg.norm(MEAN[:5])
    assert room.allometry(shapes, sizes, permutations=1500).p == found.p


def test_symmetric_parts_are_those_of_bilat_symmetry():
    points = bodies()[:, OFF_CURVES]
    pairs = [[OFF_CURVES.index(i) for i in pair] for pair in PAIRS]
    found = room.symmetric_parts(room.procrustes(points).shapes, pairs)
    near(found.symmetric, np.reshape(R["sym"], found.symmetric.shape))
    # T poses are nearly symmetric, walking is not.
    assert found.distances[[0, 4]].max() < 0.02 < 0.3 < found.distances[1:4].min()


def test_symmetric_parts_of_shapes_with_a_known_asymmetry():
    """By hand: pairs at +-x, and one landmark of the midline that is moved in x."""
    side, middle = RNG.normal(size=(3, 3)) + [3, 0, 0], RNG.normal(size=(2, 3))
    middle[:, 0] = 0
    whole = np.concatenate([side, side * [-1, 1, 1], middle])
    pairs = [[0, 3], [1, 4], [2, 5]]
    size = np.linalg.norm(whole - whole.mean(0))
    none = room.symmetric_parts(np.stack([whole, 2 * whole]), pairs)
    near(none.asymmetric, 0, 1e-9)
    bent = whole.copy()
    bent[6, 0] += 1e-3 * size
    found = room.symmetric_parts(np.stack([whole, bent]), pairs)
    # What a rotation and a shift can do against it is taken away: least squares.
    field = np.zeros_like(whole)
    field[6, 0] = 1e-3
    centred = (whole - whole.mean(0)) / size
    rigid = [np.tile(axis, (8, 1)) for axis in np.eye(3)]
    rigid += [np.cross(axis, centred) for axis in np.eye(3)]
    basis = np.reshape(rigid, (6, -1)).T
    left = field.ravel() - basis @ np.linalg.lstsq(basis, field.ravel())[0]
    near(found.distances, [0, np.linalg.norm(left)], 1e-6)
    image = found.symmetric[:, [3, 4, 5, 0, 1, 2, 6, 7]]
    flips = [np.where(np.arange(3) == axis, -1, 1) for axis in range(3)]
    assert min(np.abs(image * flip - found.symmetric).max() for flip in flips) < 1e-6


def test_names_in_a_picture_do_not_overlap():
    shapes = like(40)
    shapes[7, [0, 1]] = shapes[7, [1, 0]]
    found = room.components(room.procrustes(shapes).shapes)
    names, groups = [f"specimen {i}" for i in range(40)], ["_a", "$b"] * 20
    figure = draw_components(None, found, names, groups)
    shown = figure.axes[0].texts
    assert "specimen 7" in [text.get_text() for text in shown]  # it lies far away
    assert 5 < len(shown) < 40
    boxes = [text.get_window_extent() for text in shown]
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    labels = [text.get_text().strip() for text in figure.legends[0].get_texts()]
    assert labels == ["$b", "_a"]


LOST = np.array([like(3)[0], like(3)[1], like(3)[2]])
LOST[0, 2] = np.nan
FLAT = like(3) * [1, 1, 0]
BOTH = {"curves": [[0, 1, 2]], "surfaces": [1]}


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: room.procrustes(np.zeros((3, 4, 2))), r"points are \(3, 4, 2\)"),
        (lambda: room.procrustes(like(1)), "specimens are 1; it needs 2"),
        (lambda: room.procrustes(LOST), "landmark 2 of specimen 0 is .*estimate it"),
        (lambda: room.procrustes(0 * like(2)), "specimen 0 are at one place"),
        (lambda: room.procrustes(like(2), slide="far"), "slide is 'far'"),
        (lambda: room.procrustes(like(2), curves=[[0, 1]]), r"pass \(r, 3\)"),
        (lambda: room.procrustes(like(2), curves=[[0, 1, 9]]), "0 to 8"),
        (lambda: room.procrustes(like(2), curves=[[0, 1, 1]]), "twice in a row"),
        (lambda: room.procrustes(like(2), surfaces=[3, 3]), "3 is twice in surfaces"),
        (lambda: room.procrustes(like(2), **BOTH), "1 is twice in curves and surfaces"),
        (lambda: room.procrustes(like(2)[:, :4], surfaces=[1]), "4 landmarks; a surf"),
        (lambda: room.procrustes(FLAT, surfaces=[1]), "lie in a plane"),
        (lambda: room.estimate_missing(LOST[:2]), r"1 of 2 .*landmark 2 \(in 1\)"),
        (lambda: room.warp(MEAN, FLAT[0], MEAN), "9 landmarks lie in a plane"),
        (lambda: room.warp(MEAN, MEAN[[0, 0, *range(7)]], MEAN), "two landmarks"),
        (lambda: room.warp(MEAN[0], MEAN, MEAN), r"points are \(3,\)"),
        (lambda: room.allometry(like(3), [1, 2, 3]), "specimens are 3; it needs 4"),
        (lambda: room.allometry(like(4), [1, 2, 3]), "sizes are"),
        (lambda: room.allometry(like(4), [2.0] * 4), "all sizes are 2"),
        (lambda: room.allometry(like(4), range(1, 5), permutations=0), "are 0"),
        (lambda: room.allometry(like(1).repeat(4, 0), range(1, 5)), "are equal"),
        (lambda: room.symmetric_parts(like(2), [[0, 1], [1, 2]]), "1 is twice in pa"),
    ],
)
def test_bad_arguments_are_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_neighbours_at_one_place_do_not_slide():
    points = like(2)
    points[1, 2] = points[1, 0]
    with pytest.raises(ValueError, match="0 and landmark 2 of specimen 1 are at one"):
        room.procrustes(points, curves=[[0, 1, 2]])


def test_landmarks_at_one_place_have_no_bending_energy():
    points = like(2)
    points[:, 5] = points[:, 4]
    with pytest.raises(ValueError, match="4 and landmark 5 are at one place"):
        room.procrustes(points, curves=[[0, 1, 2]])


def test_a_specimen_with_few_landmarks_is_named():
    points = like(4)
    points[2, 3:] = np.nan
    with pytest.raises(ValueError, match="specimen 2 has 3 of 9 landmarks"):
        room.estimate_missing(points)


@pytest.mark.parametrize("suffix", [".csv", ".tps"])
def test_specimens_come_back(tmp_path, suffix):
    points = like(3)
    points[1, 2] = np.nan
    names, own = ["a", "b, c", "d e"], ["nasion", "x", "", *"hijklm"]
    path = tmp_path / f"all{suffix}"
    is_table = suffix == ".csv"
    text = (
        specimens_csv(names, own, points) if is_table else specimens_tps(names, points)
    )
    path.write_text(text)
    found = read_specimens(path)
    np.testing.assert_array_equal(found.points, points)
    assert found.specimens == tuple(names)
    # A table numbers those without a name.
    assert found.landmarks == (
        ("nasion", "x", "3", *"hijklm") if is_table else 9 * ("",)
    )


TPS = "LM3=1\n1 2 3\nIMAGE=a.png\nSCALE=2\n"


NONE = 3 * [np.nan]


@pytest.mark.parametrize(
    "name, text, expected",
    [
        ("a.tps", TPS + "LM3=1\nNA NA NA\n", {"a.png": [2, 4, 6], "2": NONE}),
        ("a.csv", '"",X1.X,X1.Y,X1.Z\n"s",1,2,3\n', {"s": [1, 2, 3]}),
        (
            "a.txt",
            "id ax ay az\ns 1 2 3\nt NA NA NA\n",
            {"s": [1, 2, 3], "t": NONE},
        ),
    ],
)
def test_files_of_specimens(tmp_path, name, text, expected):
    (tmp_path / name).write_text(text)
    found = read_specimens(tmp_path / name)
    assert found.specimens == tuple(expected)
    np.testing.assert_array_equal(found.points[:, 0], list(expected.values()))


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("a.csv", "sep=;\nid;a x;a y;a z\ns;1;;3\n", "line 3 .*without the numb"),
        ("a.tps", TPS + "LM3=2\n1 2 3\n1 2 3\n", "'2' has 2 landmarks, the first 1"),
        ("a.tps", TPS + TPS, "names that others have, such as 'a.png'"),
        ("a.tps", "LM=1\n1 2\n", "in a plane"),
        ("a.tps", "nothing", "has no specimen"),
        ("a.csv", "name,x,y,z\n", "no table of specimens"),
        ("a.csv", "id,a_x,a_z,a_y\ns,1,2,3\n", "no table of specimens"),
        ("a.csv", "id,a_x,a_y,a_z\ns,1,2\n", "line 2 has 3 cells, the first 4"),
        ("a.fcsv", "", "landmarks of many specimens are .tps"),
    ],
)
def test_files_without_specimens_are_named(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=words):
        read_specimens(tmp_path / name)


def run(*args):
    done = CliRunner().invoke(app, ["morphometrics", *map(str, args)])
    return SimpleNamespace(code=done.exit_code, text=" ".join(done.output.split()))


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def folder(tmp_path):
    """Bodies as landmarks.csv with one landmark missing, and lists in R's numbers."""
    points = bodies().copy()
    points[2, 4] = np.nan
    names = [f"l{i}" for i in range(17)]
    table = specimens_csv(R["specimens"], names, points)
    (tmp_path / "landmarks.csv").write_text(table)
    rows = lambda name: "\n".join(
        ",".join(str(1 + i) for i in np.atleast_1d(row)) for row in R[name]
    )
    (tmp_path / "curveslide.csv").write_text(f"before,slide,after\n{rows('curves')}\n")
    (tmp_path / "surfslide.csv").write_text(rows("surface"))
    (tmp_path / "landmark_pairs.csv").write_text("left,right\n")
    (tmp_path / "pairs.csv").write_text(
        '"","left","right"\n'
        + "\n".join(f'"{i}",{a + 1},{b + 1}' for i, (a, b) in enumerate(PAIRS, 1))
    )
    groups = [f"{name};{name.split('_')[0]};{name[-1]}" for name in R["specimens"][:5]]
    (tmp_path / "groups.csv").write_text("\n".join(["name;who;end", *groups]))
    return tmp_path


def test_the_command_compares_specimens(folder):
    out, file = folder / "shape", folder / "landmarks.csv"
    args = ["--curves", folder / "curveslide.csv", "--pairs", folder / "pairs.csv"]
    args += ["--surfaces", folder / "surfslide.csv"]
    args += ["--groups", folder / "groups.csv", "--group", "end"]
    done = run(file, "--out", out, *args)
    assert done.code == 0, done.text
    for words in (
        "6 specimens, 17 landmarks; 4 on curves and 5 on surfaces slide by bending",
        "1 landmark is missing: estimated by thin-plate spline, from the others "
        "woman_walk: l4",
        "asymmetry: mean Procrustes distance from the symmetric part",
        "variance of the symmetric part: PC1",
        "(720 orders of the specimens, seed 0)",
        "farthest from the mean: woman_up",
        "warning: the shapes still moved when it ended",
        f"warning: {folder / 'groups.csv'}: has no end of woman_up",
    ):
        assert words in done.text
    points = read_specimens(file).points
    options = {"curves": R["curves"], "surfaces": R["surface"]}
    aligned = room.procrustes(room.estimate_missing(points), **options)
    parts = room.symmetric_parts(aligned.shapes, PAIRS)
    modes = room.components(parts.symmetric)
    shapes = {"symmetric": parts.symmetric, "asymmetric": parts.asymmetric}
    for name, own in ({"aligned": aligned.shapes} | shapes).items():
        np.testing.assert_array_equal(read_specimens(out / f"{name}.csv").points, own)
    sizes, scores = rows_of(out / "sizes.csv"), rows_of(out / "scores.csv")
    near([float(row["asymmetry"]) for row in sizes], parts.distances)
    assert [row["estimated"] for row in sizes] == ["0", "0", "1", "0", "0", "0"]
    near([float(row["PC1"]) for row in scores], modes.scores[:, 0])
    assert [row["end"] for row in scores] == ["t", "k", "k", "k", "t", ""]
    end = read_landmarks(out / "shapes" / "PC2_max.fcsv")
    expected = modes.mean + modes.scores[:, 1].max() * modes.axes[1]
    near(end.points, aligned.sizes.mean() * expected, 1e-9)
    model = rows_of(out / "allometry.csv")
    assert [row["Df"] for row in model] == ["1", "4", "5"]
    assert (out / "components.png").stat().st_size
    assert (out / "allometry.png").stat().st_size
    # Again with less: what is not made now is gone, and the lists are pointed at.
    done = run(file, "--out", out)
    assert done.code == 0 and not (out / "symmetric.csv").exists()
    hint = f"{folder / 'curveslide.csv'} is there and was not used; add --curves"
    assert hint in done.text and "landmark_pairs.csv" not in done.text


def test_landmarks_off_the_midline_without_a_partner_are_named(folder):
    names = [f"l{i}" for i in OFF_CURVES]
    table = specimens_csv(R["specimens"], names, bodies()[:, OFF_CURVES])
    (folder / "landmarks.csv").write_text(table)
    args = folder / "landmarks.csv", "--out", folder / "shape"
    for kept in (PAIRS, PAIRS[1:]):
        rows = [f"{OFF_CURVES.index(a) + 1},{OFF_CURVES.index(b) + 1}" for a, b in kept]
        (folder / "pairs.csv").write_text("\n".join(["left,right", *rows]))
        done = run(*args, "--pairs", folder / "pairs.csv")
        assert ("no partner" in done.text) is (kept != PAIRS), done.text
    a, b = sorted(PAIRS[0])
    assert f"pairs.csv: l{a}, l{b} have no partner" in done.text


def test_the_command_warps_a_mesh(folder):
    """The mean and the ends, where the mesh of a specimen lies and in its size."""
    mesh = testing.blob(0)
    at = np.arange(0, 162, 20)
    own = mesh.vertices[at]
    rng = np.random.default_rng(0)
    points = own + 0.05 * rng.normal(size=(5, *own.shape))
    points[0] = own
    turns = Rotation.random(5, rng=1).as_matrix()
    turns[0] = np.eye(3)
    sizes = np.array([1, 9, 2, 3, 4])[:, None, None]
    points = np.einsum("sab,slb->sla", turns, points) * sizes
    names = [f"m{i}" for i in range(5)]
    marks = [f"l{i}" for i in range(9)]
    (folder / "all.csv").write_text(specimens_csv(names, marks, points))
    for name in ("m0", "other"):
        trimesh.Trimesh(*mesh, process=False).export(folder / f"{name}.ply")

    def warped(out, template, landmarks=None):
        args = ["--out", folder / out, "--template", folder / template]
        if landmarks is not None:
            write_landmarks(folder / "t.fcsv", landmarks)
            args += ["--template-landmarks", folder / "t.fcsv"]
        return run(folder / "all.csv", *args)

    done = warped("a", "m0.ply")
    assert done.code == 0, done.text
    mean = jfsf.read(folder / "a" / "shapes" / "mean.ply")
    landmarks = read_landmarks(folder / "a" / "shapes" / "mean.fcsv").points
    near(mean.vertices[at], landmarks)
    assert np.abs(landmarks - own).max() < 0.1
    low, high = (
        jfsf.read(folder / "a" / "shapes" / f"PC1_{end}.ply").vertices
        for end in ("min", "max")
    )
    assert 0.02 < np.abs(high - low).max() < 0.5
    # By a file of landmarks, of which one is another: the others are enough.
    own_file = Landmarks((*marks[:8], "other"), own)
    done = warped("b", "m0.ply", own_file)
    assert done.code == 0, done.text
    near(jfsf.read(folder / "b" / "shapes" / "mean.ply").vertices, mean.vertices, 0.1)
    far, none = own_file._replace(points=own + 9), Landmarks(("p", "q"), own[:2])
    for template, words in (
        (["other.ply"], "no specimen has the name 'other'"),
        (["m0.ply", far], f"{folder / 'm0.ply'}: "),
        (["m0.ply", none], "no landmark has the same name"),
    ):
        done = warped("c", *template)
        assert words in done.text and done.code == 1
    assert not (folder / "c").exists()


def test_landmarks_without_a_partner_are_left_out_of_the_symmetric_shapes(folder):
    """As `jfsf collection --symmetric` lists them; without them it is the same."""
    out, file = folder / "shape", folder / "landmarks.csv"
    mates = [[1 + a, 1 + b] for a, b in PAIRS]
    (one, other), *rest = mates
    lines = [f"{one},", *(f"{a},{b}" for a, b in rest)]
    (folder / "alone.csv").write_text("\n".join(["left,right", *lines]))
    done = run(file, "--out", out, "--pairs", folder / "alone.csv")
    assert done.code == 0, done.text
    assert f"as they have no partner: l{one - 1}" in done.text
    found = read_specimens(out / "symmetric.csv")
    kept = [i for i in range(17) if i != one - 1]
    assert found.landmarks == tuple(f"l{i}" for i in kept)
    shapes = read_specimens(out / "aligned.csv").points
    assert shapes.shape == (6, 17, 3)
    pairs = [[kept.index(a - 1), kept.index(b - 1)] for a, b in rest]
    parts = room.symmetric_parts(shapes[:, kept], pairs)
    near(found.points, parts.symmetric)
    end = read_landmarks(out / "shapes" / "PC1_min.fcsv")
    assert end.names == found.landmarks


def test_lists_of_landmarks_come_back(tmp_path):
    lists = {"curves": np.array([[0, 3, 1]]), "pairs": np.array([[0, 4], [2, ALONE]])}
    written = write_lists(tmp_path, lists)
    assert (tmp_path / "landmark_pairs.csv").read_text() == "left,right\n1,5\n3,\n"
    found = lists_in(tmp_path, 5)
    assert [path.name for path in written] == ["curveslide.csv", "landmark_pairs.csv"]
    assert found.keys() == lists.keys()
    for kind, rows in found.items():
        np.testing.assert_array_equal(rows, lists[kind])
    assert write_lists(tmp_path, {}) == [] == list(tmp_path.iterdir())


def test_outliers_and_mirror_images_are_named(folder):
    points = like(10)
    points[4] *= [1, 1, -1]
    points[6, [0, 1]] = points[6, [1, 0]]
    text = specimens_tps("abcdefghij", points)
    (folder / "all.tps").write_text(text)
    done = run(folder / "all.tps", "--out", folder / "a")
    assert "outliers: e, g; look for misplaced landmarks" in done.text
    assert "mirror images of the others: e? Nothing is mirrored" in done.text


def test_two_specimens_are_enough(folder):
    (folder / "two.tps").write_text(specimens_tps(["a", "b"], like(2)))
    done = run(folder / "two.tps", "--out", folder / "a")
    assert done.code == 0 and "variance: PC1 100.0%" in done.text
    assert "no allometry: specimens are 2; it needs 4" in done.text
    (folder / "two.tps").write_text(specimens_tps(["a", "b"], like(1).repeat(2, 0)))
    done = run(folder / "two.tps", "--out", folder / "a")
    assert done.code == 0 and "variance: none" in done.text


@pytest.mark.parametrize(
    "args, text, words",
    [
        (["--slide", "procrustes"], "", "--slide is for semilandmarks"),
        (["--group", "who"], "", "--group names a column"),
        (["--template-landmarks", "FILE"], "", "give --template too"),
        (["--curves", "FILE"], "before,slide,after\n1,2\n", "line 2 is '1,2'"),
        (["--curves", "FILE"], "1,2,x\n", "line 1 is '1,2,x'"),
        (["--curves", "FILE"], "1,2,18\n", "line 1 has 18; landmarks are 1 to 17"),
        (["--curves", "FILE"], "0,1,2\n", "line 1 has 0"),
        (["--curves", "FILE"], "1,2,2\n", "line 1 has a landmark twice"),
        (["--curves", "FILE"], "1,2,3\n3,2,4\n", "landmark 2 is twice"),
        (["--curves", "FILE"], "", "is empty"),
        (["--surfaces", "FILE"], "1\n2\n1\n", "landmark 1 is twice"),
        (["--pairs", "FILE"], "left,right\n1,2\n2,3\n", "landmark 2 is twice"),
        (["--pairs", "FILE"], "left,right\n,3\n", "line 2 is ',3'"),
        (["--pairs", "FILE"], '"",left,right\n1,2\n', "line 2 is '1,2'"),
        (["--curves", "FILE"], '1,"2,3\n', "line 1 is '1,2,3'"),
        (["--groups", "FILE"], "name\nman_t\n", "has one column"),
        (
            ["--groups", "FILE"],
            "name,a\nman_t,1\nman_t,2\n",
            "line 3 has 'man_t' again",
        ),
        (["--groups", "FILE"], "name,a\nMAN_T,1\n", "names none of the specimens"),
        (["--groups", "FILE", "--group", "b"], "name,a\nman_t,1\n", "no column 'b'"),
    ],
)
def test_bad_options_are_named(folder, args, text, words):
    (folder / "file.csv").write_text(text)
    args = [folder / "file.csv" if arg == "FILE" else arg for arg in args]
    done = run(folder / "landmarks.csv", "--out", folder / "shape", *args)
    assert done.code == 1 and words in done.text, done.text
    assert not (folder / "shape").exists()


def test_names_stand_in_errors_and_inputs_are_safe(folder):
    points = like(3)
    points[1, 2] = points[1, 0]
    text = specimens_csv(["a", "b", "c"], [*"rstuvwxyz"], points)
    (folder / "all.csv").write_text(text)
    (folder / "c.csv").write_text("1,2,3\n")
    done = run(folder / "all.csv", "--out", folder / "a", "--curves", folder / "c.csv")
    assert "landmark 'r' and landmark 't' of specimen 'b' are at one place" in done.text
    done = run(folder / "all.csv", "--out", folder)
    assert done.code == 1 and f"{folder / 'all.csv'} is in it" in done.text
    assert (folder / "all.csv").read_text() == text
