"""Two meshes to a map, and what must not change it. One size: one compilation."""

import ast
from dataclasses import replace
from functools import cache, partial
from threading import Barrier

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import quick_compiler
from documents import ROOT, blocks
from scipy.spatial import KDTree
from shapes import SMALL, small

import jfsf
from jfsf import testing
from jfsf.apps.report._words import warnings_of
from jfsf.convert import sinkhorn
from jfsf.evaluate import geodesic_error
from jfsf.initial._start import nonisometric_starts, search_starts
from jfsf.matching import (
    Settings,
    _policy,
    _run_stages,
    _shapes,
    _stages,
    attempt,
    shape_samples,
)
from jfsf.matching._arguments import MatchInputs, checked_initial
from jfsf.matching._kept_landmarks import MISSED
from jfsf.matching._match import attempted_pair
from jfsf.matching._pairs import PairState
from jfsf.matching._steps import given_start, refine_start
from jfsf.runtime import _programs, _runners
from jfsf.runtime._runners import OneByOne, Runner
from jfsf.runtime._sizes import PaddedShape, padded_pair, padded_shapes, spectrum_like
from jfsf.spectral import features, functional_map, truncate, truncate_pair, wks
from jfsf.types import Maps, Mesh


@cache
def template():
    """Points of the template in T pose, and each one's mirror image."""
    rest, vertex = jfsf.data.load("man_t")
    points = rest.vertices[vertex]
    return points, KDTree(points).query(points * (-1, 1, 1))[1]


# Right maps of shapes as small as these have a confidence of about 0.6. By the default
# they are in doubt, and coarse copies of every pair are compiled and tried.
SURE = Settings(retry_below=0.3)


def match(mesh_x, mesh_y, **options):
    return jfsf.match(mesh_x, mesh_y, cache=False, **{"settings": SURE} | options)


@cache
def plain():
    (mesh_x, _), (mesh_y, _) = shapes()
    return match(mesh_x, mesh_y)


def shapes():
    # Padded to 320, and with the eigenpairs of the first: the programs of its symmetry.
    return small("man_walk", 600), small("man_up", 620)


def error(found, mesh_y=None):
    (_, gt_x), (own_y, gt_y) = shapes()
    at = slice(None, None, 20)
    return geodesic_error(found.T_xy, mesh_y or own_y, gt_x[at], gt_y[at]).mean()


def same(found, share=1.0):
    for ours, theirs in ((found.T_xy, plain().T_xy), (found.T_yx, plain().T_yx)):
        assert (np.asarray(ours) == np.asarray(theirs)).mean() >= share


def nearly_same(found):
    """Where the images differ they are neighbours, and few do.

    For inputs that differ by rounding, as where sums have another order: by 1e-13 in
    eigenvalues and 1e-10 in eigenvectors. The search's map then differs by 1e-12. But
    some rows of a plan have two entries equal to 1e-8. The first of these that rounding
    decides otherwise moves one image to a neighbour, and the rounds of refinement and
    bending carry that on. Of ten such inputs each changed 2 to 10 % of the images, by
    0.6 of the longest edge at most.
    """
    for name, (mesh, _) in zip(("T_yx", "T_xy"), shapes(), strict=True):
        ours, theirs = (np.asarray(getattr(m, name)) for m in (found, plain()))
        assert (ours != theirs).mean() < 0.15
        edges = np.diff(mesh.vertices[mesh.faces[:, [0, 1, 2, 0]]], axis=1)
        apart = mesh.vertices[ours] - mesh.vertices[theirs]
        assert np.linalg.norm(apart, axis=1).max() < np.linalg.norm(edges, axis=2).max()


def test_the_truth_is_found():
    (mesh_x, _), (mesh_y, _) = shapes()
    found = plain()
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    assert n_x != n_y
    assert found.T_xy.shape == (n_x,) and found.T_yx.shape == (n_y,)
    assert 0 <= found.T_xy.min() and found.T_xy.max() < n_y
    assert 0 <= found.T_yx.min() and found.T_yx.max() < n_x
    assert error(found) < 0.05


def test_each_stage_is_named_as_it_begins():
    (mesh_x, _), (mesh_y, _) = shapes()
    plain()  # compiles
    named = []
    same(match(mesh_x, mesh_y, progress=named.append))
    first = ["spectra", "features", "search"]
    assert named == [*first, "refinement", "bending and conversion"]


@cache
def specs():
    """Both spectra, as `match` has them, not padded."""
    pair = truncate_pair(*(jfsf.basis(mesh, cache=False) for mesh, _ in shapes()))
    return jax.tree.map(jnp.asarray, pair)


@pytest.mark.slow  # the whole of match, compiled once more
def test_large_meshes_are_matched_through_tiles_and_samples():
    small = Settings(tiles_above=200, samples=256, exhaustive_up_to=300)
    found = jfsf.match_spectra(*specs(), settings=small)
    assert found.T_xy.shape == (len(shapes()[0][0].vertices),)
    # Samples of a mesh of 500 vertices are few.
    assert error(found) < 1.3 * error(plain())


def test_the_certificate_says_so():
    found = plain().certificate
    assert found.finite and found.empty == 0
    assert found.orientation > 0.8
    assert 0.7 < found.coverage_xy <= 1 and 0.7 < found.coverage_yx <= 1
    assert 0 <= found.bijectivity_x < 0.1 and 0 <= found.bijectivity_y < 0.1
    assert 0.3 < found.nn_agreement <= 1 and 0 <= found.marginal_error < 0.5
    assert 0 <= found.orthogonality < 2
    assert all(np.shape(field) == () for field in found.figures().values())
    assert found.landmarks.shape == (0,)


def test_units_motion_and_winding_change_nothing():
    (mesh_x, _), (mesh_y, _) = shapes()
    moved = testing.move(mesh_x, turned(), unit=1000.0)
    inside_out = mesh_y._replace(faces=mesh_y.faces[:, ::-1])
    # Coordinates and faces given otherwise sum up otherwise.
    nearly_same(match(moved, inside_out))
    # A power of two rounds nothing.
    doubled = mesh_x._replace(vertices=2.0 * mesh_x.vertices)
    same(match(doubled, mesh_y))


def as_match_does(*specs):
    """Padded as `match` pads: the same programs."""
    pair = PairState(padded_pair(*specs), MatchInputs())
    return _policy.match_pairs([pair], OneByOne(keep=False), settings=SURE)[0]


class Noting(OneByOne):
    """Runs the stages, and notes what they are given and what they return.

    given: (stage, shapes and types of its arguments), in their order.
    """

    given: list
    results: dict

    def map(self, name, stage, inputs, at_a_time=1):
        results = super().map(name, stage, inputs, at_a_time)
        self.given += [(name, types(args)) for args in inputs]
        self.results[name] = results
        return results


def types(args):
    # Weak types too: 1 and jnp.int32(1) are two programs.
    return str(jax.tree.map(jax.typeof, args))


def noting():
    runner = Noting(keep=False)
    runner.given, runner.results = [], {}
    return runner


class Abstract(Runner):
    """As `CompileOnly`, without a compiler."""

    def __init__(self):
        self.given = []

    def map(self, name, stage, inputs, at_a_time=1):
        self.given += [(name, types(args)) for args in inputs]
        return [jax.eval_shape(stage, *args) for args in inputs]


def test_the_programs_are_compiled_for_what_they_get():
    sizes = [(len(mesh.vertices), len(mesh.faces)) for mesh, _ in shapes()]
    k = len(specs()[0].evals)
    like_x, like_y = map(spectrum_like, padded_shapes(k, sizes))
    ahead, runner = Abstract(), noting()
    _policy.compile_first_attempt(
        PairState((like_x, like_y), MatchInputs()), ahead, settings=SURE
    )
    padded = jax.tree.map(jnp.asarray, padded_pair(*specs()))
    _policy.match_pairs([PairState(padded, MatchInputs())], runner, settings=SURE)
    assert runner.given == ahead.given


def test_signs_of_eigenvectors_change_nothing():
    rng = np.random.default_rng(0)
    by = [rng.choice((-1.0, 1.0), len(spec.evals)) for spec in specs()]
    for one in by:
        one[0] = 1
    flipped = map(testing.flip_signs, specs(), by)
    found = as_match_does(*flipped)
    n_x, n_y = (len(mesh.vertices) for mesh, _ in shapes())
    same(found._replace(T_xy=found.T_xy[:n_x], T_yx=found.T_yx[:n_y]), 0.97)
    C_yx = testing.flip_map(found.C_yx, *by)
    np.testing.assert_allclose(C_yx[:30, :30], plain().C_yx[:30, :30], atol=0.1)


@pytest.mark.slow
def test_turns_of_repeated_eigenvectors_change_nothing():

    def repeated(spec, angle):
        """Eigenvalues 4 and 5 become one, and its eigenvectors turn."""
        evals, evecs, at = np.array(spec.evals), np.array(spec.evecs), slice(4, 6)
        c, s = np.cos(angle), np.sin(angle)
        evals[at] = evals[at].mean()
        evecs[:, at] = evecs[:, at] @ [[c, -s], [s, c]]
        return spec._replace(evals=evals, evecs=evecs)

    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    n_x, some = len(mesh_x.vertices), slice(None, None, 20)
    maps, errors = [], []
    for angles in ((0, 0), (0.7, -2)):
        turned = map(repeated, specs(), angles)
        found = as_match_does(*turned)
        maps.append(np.asarray(found.T_xy[:n_x]))
        error = geodesic_error(maps[-1], mesh_y, gt_x[some], gt_y[some])
        errors.append(error.mean())
    # Other starts and another course, which rounding ends on near vertices: on so few,
    # a turn by 1e-6 moves the map as much as any other does, and the error by a fifth.
    apart = mesh_y.vertices[maps[0]] - mesh_y.vertices[maps[1]]
    size = np.linalg.norm(np.ptp(mesh_y.vertices, 0))
    assert np.linalg.norm(apart, axis=1).mean() < size / 100
    assert max(errors) < 1.4 * min(errors) and max(errors) < 0.05


def test_both_mirrored_is_neither_mirrored():
    (mesh_x, _), (mesh_y, _) = shapes()
    found = match(testing.mirror(mesh_x), testing.mirror(mesh_y))
    nearly_same(found)


def test_swapping_the_shapes_swaps_the_maps():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    found = match(mesh_y, mesh_x)
    at = slice(None, None, 20)
    forth = geodesic_error(found.T_yx, mesh_y, gt_x[at], gt_y[at]).mean()
    back = geodesic_error(found.T_xy, mesh_x, gt_y[at], gt_x[at]).mean()
    # On so few vertices, spectra that differ in the last digits change it by a tenth.
    assert forth < 1.6 * error(plain()) and back < 0.05
    # Maps are read off T_xy on the way, so the two ways round differ in detail.
    moved = mesh_y.vertices[found.T_yx] - mesh_y.vertices[plain().T_xy]
    size = np.linalg.norm(np.ptp(mesh_y.vertices, 0))
    assert np.linalg.norm(moved, axis=1).mean() < size / 50


def compiled():
    return len(_programs.known)


def turned():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn)), np.array([1.0, -2.0, 3.0])


def test_reverse_asks_for_the_mirror_image():
    (mesh_x, _), (mesh_y, _) = shapes()
    found = match(mesh_x, mesh_y, orientation="reverse")
    assert found.certificate.orientation < -0.5
    # Against the mirror image of Y it is the right map.
    other = match(mesh_x, testing.mirror(mesh_y), orientation="reverse")
    assert other.certificate.orientation < -0.5 and error(other) < 0.05


def test_left_goes_to_right():
    (mesh, vertex), _ = shapes()  # padded to the size of the pair: one program
    _, opposite = template()
    found = jfsf.symmetry(mesh, settings=SURE, cache=False)
    at = slice(None, None, 20)
    for T in (found.T_xy, found.T_yx):
        assert geodesic_error(T, mesh, vertex[at], vertex[opposite][at]).mean() < 0.06
        assert geodesic_error(T, mesh, vertex[at], vertex[at]).mean() > 0.3
    assert found.certificate.orientation < -0.8
    # It undoes itself.
    size = np.linalg.norm(np.ptp(mesh.vertices, 0))
    twice = mesh.vertices[found.T_xy[found.T_xy]] - mesh.vertices
    assert np.linalg.norm(twice, axis=1).mean() < size / 50


def test_the_orientation_may_be_traced():
    (mesh_x, _), (mesh_y, _) = shapes()
    plain()
    before = compiled()
    match(mesh_x, mesh_y, orientation="any")
    match(mesh_x, mesh_y, orientation="reverse")
    assert compiled() == before


def test_the_programs_of_search_and_refinement_serve_all_sizes():
    def samples(n):
        return jax.eval_shape(shape_samples, spectrum_like(PaddedShape(128, n, 2 * n)))

    assert samples(5120) == samples(10240)


@pytest.mark.parametrize(("large", "at_a_time"), [(1 << 26, 2), (99, 1)])
def test_large_shapes_have_their_features_one_by_one(monkeypatch, large, at_a_time):
    running, most = [], []
    both = Barrier(at_a_time)

    def program(side):
        running.append(side)
        both.wait(20)
        most.append(len(running))
        both.wait(20)
        running.pop()
        return side

    monkeypatch.setattr(_runners, "compile_ahead", lambda *_, **__: program)
    monkeypatch.setattr(_runners, "LARGE_BYTES", large)
    inputs = [(np.zeros(25, "f4"),), (np.ones(25, "f4"),)]
    sides = OneByOne().map("features", partial(program), inputs, at_a_time=2)
    assert max(most) == at_a_time
    assert [side[0] for side in sides] == [0, 1]


class Counted:
    """A runner that traces each stage once, and returns shapes."""

    def __init__(self):
        self.programs = {}

    def map(self, name, stage, inputs, at_a_time=1):
        return [self.one(stage, args) for args in inputs]

    def one(self, stage, args):
        leaves, tree = jax.tree.flatten(args)
        shapes = [(x.shape, x.dtype) for x in map(jax.typeof, leaves)]
        asked = stage.func, tree, *shapes
        if asked not in self.programs:
            self.programs[asked] = jax.eval_shape(stage, *args)
        return self.programs[asked]


def all_stages(pair, runner, settings):
    """Those of a pair in doubt, too, on shapes in place of arrays."""
    _policy.compile_first_attempt(pair, runner, settings=settings)
    k = settings.k
    copies = padded_shapes(k, [(settings.coarse_vertices, 2396)] * 2)
    copy = PairState(tuple(map(spectrum_like, copies)), MatchInputs())
    _policy.compile_first_attempt(copy, runner, settings=settings)
    stage = partial(nonisometric_starts, settings=settings.search)
    stacked = runner.one(stage, _run_stages.search_inputs([copy], [copy.samples])[0])
    start = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), stacked)
    _run_stages.attempt_starts([(copy, start)], runner, settings)
    # The map of the copies is bent on the whole shapes.
    C_yx = jax.ShapeDtypeStruct((k, k), start.C_yx.dtype)
    _run_stages.attempt_starts([(pair, start)], runner, settings, refined=[C_yx])


@pytest.mark.slow
def test_a_folder_of_many_sizes_needs_fifteen_programs():
    rng = np.random.default_rng(0)
    runner, settings = Counted(), Settings()
    for _ in range(100):
        n = rng.integers(2600, 25_600, 2)
        if max(n) > 4 * min(n):
            continue
        pair = map(spectrum_like, padded_shapes(128, [(m, 2 * m - 4) for m in n]))
        all_stages(PairState(tuple(pair), MatchInputs()), runner, settings)
    assert 9 <= len(runner.programs) <= 15


def test_a_cloud_without_an_outside_has_no_left_and_right():
    points = np.random.default_rng(0).random((162, 3))
    cloud = Mesh(points, np.zeros((0, 3), np.int32))
    with pytest.raises(jfsf.MeshError, match="symmetry: mesh has 162 vertices and no"):
        jfsf.symmetry(cloud, cache=False)


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_one_landmark_decides_a_flip():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    points, opposite = template()
    hand = points[:, 0].argmax()
    for truth, way in ((gt_y, 1), (gt_y[opposite], -1)):
        known = np.array([[gt_x[hand], truth[hand]]])
        found = match(mesh_x, mesh_y, orientation="any", landmarks=known)
        assert way * found.certificate.orientation > 0.8
        at = slice(None, None, 20)
        assert geodesic_error(found.T_xy, mesh_y, gt_x[at], truth[at]).mean() < 0.05


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_exchanged_landmarks_are_named_and_not_obeyed():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    points, _ = template()
    left = points[:, 0] > 0
    low = points[:, 1]
    at = [points[:, 0].argmax(), points[:, 0].argmin(), low.argmax()]
    at += [np.where(side, low, np.inf).argmin() for side in (left, ~left)]
    known = np.stack([gt_x[at], gt_y[at]], 1)
    known[:2, 1] = known[1::-1, 1]
    found = jfsf.match(mesh_x, mesh_y, landmarks=known, cache=False)
    missed = np.asarray(found.certificate.landmarks) > MISSED
    np.testing.assert_array_equal(missed, [True, True, False, False, False])
    at = slice(None, None, 20)
    assert geodesic_error(found.T_xy, mesh_y, gt_x[at], gt_y[at]).mean() < 0.05


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_point_clouds_are_not_mirrored():
    # Of 1300 points, neighbours are on several limbs. Of 2500, the first map is sure.
    (mesh_x, gt_x), (mesh_y, gt_y) = (small(n, 5100) for n in ("man_walk", "man_up"))
    cloud_x, cloud_y = (m._replace(faces=m.faces[:0]) for m in (mesh_x, mesh_y))
    found = jfsf.match(cloud_x, cloud_y, cache=False)
    assert found.T_xy.shape == (len(mesh_x.vertices),)
    assert found.certificate.orientation > 0.8 and found.certificate.finite
    at = slice(None, None, 20)
    assert geodesic_error(found.T_xy, mesh_y, gt_x[at], gt_y[at]).mean() < 0.06


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_a_cloud_without_an_outside_is_matched_up_to_its_mirror_image(monkeypatch):
    # Of 300 points, neighbours are on several limbs.
    (mesh_x, gt_x), (mesh_y, gt_y) = small("man_walk", 1100), small("man_up", 1060)
    _, opposite = template()
    cloud = mesh_x._replace(faces=np.zeros((0, 3), np.int32))
    monkeypatch.setattr(_shapes, "reconstruct", lambda mesh: (mesh, mesh))
    found = match(cloud, mesh_y)
    assert found.T_xy.shape == (len(mesh_x.vertices),)
    evidence = found.certificate
    assert np.isnan(evidence.orientation) and evidence.finite
    # There is no surface to bend.
    assert np.isnan(evidence.confidence) and found.info.sources == ["search"]
    at = slice(None, None, 20)
    errors = [
        geodesic_error(found.T_xy, mesh_y, gt_x[at], truth[at]).mean()
        for truth in (gt_y, gt_y[opposite])
    ]
    assert min(errors) < 0.06
    (said,) = (w for w in warnings_of(found.certificate, "preserve") if "left" in w)
    assert "cannot be told" in said
    assert not any("left" in w for w in warnings_of(found.certificate, "any"))


def test_a_given_map_of_a_cloud_has_no_rivals(monkeypatch):
    (mesh_x, _), (mesh_y, _) = shapes()
    cloud = mesh_x._replace(faces=np.zeros((0, 3), np.int32))
    monkeypatch.setattr(_shapes, "reconstruct", lambda mesh: (mesh, mesh))
    T_xy = np.asarray(plain().T_xy)
    found = match(cloud, mesh_y, initial=T_xy)
    assert found.info.sources == ["given"]
    assert np.isnan([found.certificate.share, found.certificate.confidence]).all()


@pytest.mark.parametrize("side", ["mesh_x", "mesh_y"])
def test_a_bad_mesh_is_named(side):
    good = testing.blob(0)
    twice = Mesh(
        np.concatenate([good.vertices, good.vertices + 9]),
        np.concatenate([good.faces, good.faces + len(good.vertices)]),
    )
    pair = {"mesh_x": good, "mesh_y": good} | {side: twice}
    with pytest.raises(jfsf.MeshError, match=f"{side}: has 2 connected components"):
        jfsf.match(**pair, cache=False)
    pair[side] = testing.blob(0, subdivisions=0)
    with pytest.raises(
        jfsf.MeshError, match=f"{side}: has 12 vertices, matching needs 160"
    ):
        jfsf.match(**pair, cache=False)
    # Found before the faces are wound, which would trip over it.
    pair[side] = good._replace(faces=good.faces + 9)
    with pytest.raises(jfsf.MeshError, match=f"{side}: a face names vertex"):
        jfsf.match(**pair, cache=False)


@pytest.mark.parametrize(
    "landmarks, message",
    [
        ([1, 2], r"landmarks have shape \(2,\)"),
        ([[0, 0, 0]], r"landmarks have shape \(1, 3\)"),
        ([[0.5, 1.0]], "landmarks are float64; give vertex numbers"),
        ([[0, 0], [162, 0]], "0 to 162 of mesh_x, which has vertices 0 to 161"),
        ([[0, -1]], "-1 to -1 of mesh_y, which has vertices 0 to 161"),
    ],
)
def test_bad_landmarks(landmarks, message):
    good = testing.blob(0)
    with pytest.raises(ValueError, match="match: .*" + message):
        jfsf.match(good, good, landmarks=landmarks, cache=False)


def test_an_unknown_orientation():
    good = testing.blob(0)
    with pytest.raises(ValueError, match="'preserve', 'reverse' or 'any', not 'left'"):
        jfsf.match(good, good, orientation="left", cache=False)  # type: ignore


def ten_lines(emb_x, emb_y, marginal_x, marginal_y, search):
    """A converter of a user's: nearest neighbour by a dense table, no tiles."""
    square = jnp.sum((emb_x[:, None] - emb_y[None]) ** 2, 2)
    far_x, far_y = (jnp.where(m > 0, 0, jnp.inf) for m in (marginal_x, marginal_y))
    T_xy = jnp.argmin(square + far_y[None, :], 1)
    return Maps(T_xy, jnp.argmin(square + far_x[:, None], 0))


# Another number of eigenpairs, other converters, and copies of both shapes.
OTHER = replace(
    SMALL,
    search=Settings().search,  # with SMALL's the first map is wrong
    refine_converter=ten_lines,
    converter=partial(sinkhorn, k0=40),
    coarse_vertices=200,
)


@pytest.fixture(scope="module")
def by_copies():
    """No first map is sure enough. The copies are padded to the size of the shapes."""
    (mesh_x, _), (mesh_y, _) = shapes()
    doubtful, names = replace(OTHER, retry_below=1.0, nonisometric_attempts=2), []
    with quick_compiler():
        found = match(mesh_x, mesh_y, settings=doubtful, progress=names.append)
    return found, names


def test_settings_change_any_stage(by_copies):
    found, _ = by_copies
    assert found.C_yx.shape == (40, 40)
    assert error(found) < 0.05 and 0 < found.certificate.nn_agreement <= 1


def test_a_doubtful_pair_is_matched_by_its_copies(by_copies):
    found, names = by_copies
    candidates = Settings().search.nonisometric_candidates
    assert names.count("further starts") == 1 and names.count("spectra") == 1
    # Those of the first map, those of all on the copies, and no other.
    assert names.count("refinement") == 2 and candidates > 1
    tried = len(found.info.source)
    assert found.info.sources == ["search", *["coarse copies"] * (tried - 1)]
    assert 1 <= tried <= 3 and names.count("bending and conversion") == 2 + tried - 1
    assert 0 <= found.certificate.share <= 1
    assert found.info.confidence.shape == (tried,)


@pytest.mark.slow
@pytest.mark.usefixtures("by_copies", "run_once")  # which compiles most of it
def test_to_bend_copies_is_as_good_as_to_bend_the_whole():
    (mesh_x, _), (mesh_y, _) = shapes()
    large = replace(OTHER, rigid_below=0, copies_above=100)
    states = [
        attempted_pair(mesh_x, mesh_y, settings=settings, cache=False)
        for settings in (large, replace(large, copies_above=10**6))
    ]
    found, plain = states
    assert found.coarse is not None and plain.coarse is None
    sizes = len(mesh_x.vertices), len(mesh_y.vertices)
    bent, whole = (s.result(large).without_padding(*sizes) for s in states)
    assert error(bent) < 1.1 * error(whole) + 1e-3 and error(bent) < 0.05
    odds = [float(state.best.certificate.log_odds) for state in states]
    assert odds[0] > odds[1] - 1
    assert found.seconds["bending and conversion"] > 0
    assert not np.array_equal(found.best.T_xy, plain.best.T_xy)


def functions_of_the_guide():
    """Those that the page on stages defines, by name; nothing is matched."""
    page = ROOT / "jfsf" / "apps" / "guide" / "stages.md"
    names = {}
    for code in blocks(page.read_text(), "python"):
        kept = ast.Import | ast.ImportFrom | ast.FunctionDef
        body = [node for node in ast.parse(code).body if isinstance(node, kept)]
        exec(compile(ast.Module(body, []), str(page), "exec"), names)
    return names


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_the_guides_own_stages_match_a_shape_that_was_turned():
    (mesh_x, gt_x), _ = shapes()
    names = functions_of_the_guide()
    mine = Settings(
        describe=names["my_features"],
        refine=names["my_refinement"],
        deform=names["my_deformation"],
    )
    other, gt_y = small("man_walk", 590)
    moved = testing.move(other, turned(), unit=7.0)
    found = match(mesh_x, moved, settings=mine)
    at = slice(None, None, 20)
    assert geodesic_error(found.T_xy, moved, gt_x[at], gt_y[at]).mean() < 0.03
    # ICP stays at the size of the start.
    assert found.certificate.residual < 0.01 and found.certificate.confidence > 0.9


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_a_converter_without_a_plan_has_a_certificate():
    (mesh_x, _), (mesh_y, _) = shapes()
    mine = jfsf.Settings(retry_below=0, converter=ten_lines, bend_rounds=1)
    start = plain().C_yx
    found = match(mesh_x, mesh_y, initial=start, settings=mine)
    evidence = found.certificate
    assert error(found) < 0.05 and evidence.finite and evidence.coverage_xy > 0.6
    assert np.isnan(evidence.marginal_error) and np.isnan(evidence.nn_agreement)


def test_descriptors_replace_the_wave_kernel_signature():
    # Given the default's own, from another program and so rounded otherwise.
    (mesh_x, _), (mesh_y, _) = shapes()
    step = Settings().features.wks_step
    given = tuple(np.asarray(wks(spec))[:, ::step] for spec in specs())
    found = match(mesh_x, mesh_y, descriptors=given)
    nearly_same(found)


def test_descriptors_may_stand_beside_it():
    spec = specs()[0]
    given = jnp.sin(jnp.arange(len(spec.mass), dtype=spec.mass.dtype))[:, None]
    plain, alone, beside = (
        features(spec, desc, settings=jfsf.FeatureSettings(keep_wks=keep))
        for desc, keep in ((None, False), (given, False), (given, True))
    )
    assert np.array_equal(alone.descriptors, given)
    assert np.array_equal(beside.descriptors[:, :1], given)
    assert np.array_equal(beside.descriptors[:, 1:], plain.descriptors)
    with pytest.raises(ValueError, match=r"features: descriptors are \(3, 1\)"):
        features(spec, given[:3])


@cache
def sampled():
    """The first stage, apart from `match`."""
    x, y = map(shape_samples, specs())
    return x, y


@pytest.mark.slow
def test_the_searchs_own_map_as_initial_gives_the_default():
    (mesh_x, _), (mesh_y, _) = shapes()
    runner = noting()
    pair = PairState(padded_pair(*specs()), MatchInputs())
    _policy.match_pairs([pair], runner, settings=SURE)
    ((start, _),) = runner.results["search"]
    initial = np.asarray(start.C_yx)
    stages = []
    found = match(mesh_x, mesh_y, initial=initial, progress=stages.append)
    same(found)
    assert np.isnan(found.certificate.gap)  # no search, no second candidate
    # However sure it is, it is compared with others; none fits nearly as well.
    assert found.info.sources == ["given"] and "further starts" in stages
    assert found.certificate.share > 0.5


@pytest.mark.slow
def test_maps_of_anyone_are_refined():
    (mesh_x, _), (mesh_y, _) = shapes()
    # A record with T_xy, which is T_xy alone.
    T_xy = np.asarray(plain().T_xy)
    sizes = len(mesh_x.vertices), len(mesh_y.vertices)
    for initial in (plain(), T_xy):
        np.testing.assert_array_equal(checked_initial(initial, sizes), T_xy)
    found = match(mesh_x, mesh_y, initial=plain())
    assert error(found) < 1.1 * error(plain())


def test_a_refinement_that_begins_above_the_search_needs_an_initial_map():
    settings = Settings(ks=(50, 60))
    with pytest.raises(ValueError, match="ks begins at 50, .* finds maps of 40"):
        jfsf.match_spectra(*specs(), settings=settings)


@pytest.mark.slow
def test_a_small_initial_map_grows():
    x, y = (side.refinement for side in sampled())
    T_xy = jnp.asarray(plain().T_xy)
    small = functional_map(T_xy, truncate(x.spec, 12), truncate(y.spec, 12))
    settings = Settings(ks=(30, 40))
    C_yx = _stages.refine_by_zoomout(x, y, small, settings=settings)
    assert C_yx.shape == (40, 40)
    truth = functional_map(T_xy, truncate(x.spec, 40), truncate(y.spec, 40))
    gap = jnp.linalg.norm(C_yx - truth) / jnp.linalg.norm(truth)
    assert gap < 0.5


@pytest.mark.slow
def test_an_attempt_is_match():
    x, y = sampled()
    found = search_starts(x.search, y.search)[0]
    start = given_start(*specs(), found.C_yx)
    assert start.sign == found.sign == 1
    np.testing.assert_allclose(start.orientation, found.orientation, atol=1e-6)
    C_yx = refine_start((x.refinement, y.refinement), start)
    k = len(specs()[0].evals)
    assert C_yx.shape == (k, k)
    ours = attempt(specs(), (x, y), start)
    nearly_same(ours)
    evidence = ours.certificate
    assert evidence.orientation > 0.8 and evidence.finite and np.isnan(evidence.gap)


def test_rows_of_zeros_are_left_out_of_a_map():
    C_yx = jnp.asarray(np.random.default_rng(0).normal(size=(20, 20)))
    embed = partial(_stages.deform_by_arap, *specs(), settings=Settings(bend_rounds=0))
    padded = jnp.pad(C_yx, (0, 10))
    for ours, truth in zip(embed(padded)[:2], embed(C_yx)[:2], strict=True):
        np.testing.assert_allclose(ours[:, :20], truth)
        assert not ours[:, 20:].any()


def test_a_refinement_may_end_before_the_search_does():
    settings = Settings(ks=(20, 30))  # the search finds maps of 40 functions
    found = jax.eval_shape(partial(jfsf.match_spectra, settings=settings), *specs())
    assert found.T_xy.shape == specs()[0].mass.shape


def test_stages_vmap_over_pairs():
    x, y = specs()
    two = jax.tree.map(lambda *a: jnp.stack(a), x, x)
    found = jax.vmap(lambda spec: features(spec))(two)
    for ours, theirs in zip(
        jax.tree.leaves(found), jax.tree.leaves(features(x)), strict=True
    ):
        np.testing.assert_allclose(ours[1], theirs, atol=1e-8)


@pytest.mark.parametrize(
    "descriptors, message",
    [
        (np.zeros((162, 2)), r"descriptors are ndarray; give \(desc_x, desc_y\)"),
        ((np.zeros((9, 2)), np.zeros((162, 2))), r"of mesh_x are \(9, 2\); give"),
        ((np.zeros((162, 2)), np.zeros((162, 0))), r"of mesh_y are \(162, 0\)"),
        ((np.zeros((162, 2)), np.zeros((162, 3))), "2 columns on mesh_x and 3 on"),
        ((np.full((162, 2), np.nan),) * 2, "mesh_x are float64, or not finite"),
    ],
)
def test_bad_descriptors(descriptors, message):
    good = testing.blob(0)
    with pytest.raises(ValueError, match="match: .*" + message):
        jfsf.match(good, good, descriptors=descriptors, cache=False)


@pytest.mark.parametrize(
    "initial, message",
    [
        (np.zeros(162), r"initial is float64 \(162,\); give C_yx"),
        (np.zeros(9, int), "a map of 9 vertices .* mesh_x has 162 vertices"),
        (np.full(162, 162), "vertices 162 to 162"),
        (np.full((5, 5), np.nan), "initial is not finite"),
        (np.zeros((1, 5)), r"initial is float64 \(1, 5\)"),
    ],
)
def test_bad_initial_maps(initial, message):
    good = testing.blob(0)
    with pytest.raises(ValueError, match="match: .*" + message):
        jfsf.match(good, good, initial=initial, cache=False)


def test_the_limit_of_vertices_follows_the_settings():
    few = testing.blob(0, subdivisions=1)  # 42 vertices
    with pytest.raises(jfsf.MeshError, match="42 vertices, matching needs 160"):
        jfsf.basis(few, cache=False)


def test_what_does_not_fit_two_spectra_is_named():
    x, y = testing.blob_spectrum(0, 45), testing.blob_spectrum(1, 45)
    n = len(x.mass)
    for words, own in (
        ("landmarks are .* give .l, 2. integers", {"landmarks": np.zeros((5, 3), int)}),
        ("landmarks are float", {"landmarks": np.zeros((5, 2))}),
        ("landmarks are", {"landmarks": [1, 2]}),
        ("equally many columns", {"descriptors": (np.ones((n, 2)), np.ones((n, 3)))}),
        ("a row a vertex", {"descriptors": (np.ones((n, 2)), np.ones((9, 2)))}),
        ("descriptors are ndarray", {"descriptors": np.ones((n, 2))}),
        ("initial is .*give C_yx", {"initial": [[1.0]]}),
    ):
        with pytest.raises(ValueError, match=words):
            jfsf.match_spectra(x, y, **own)
    with pytest.raises(ValueError, match="45 and 41 eigenpairs"):
        jfsf.match_spectra(x, testing.blob_spectrum(1, 41))


def test_what_is_given_as_lists_or_badly_is_named():
    ball = testing.blob()
    n = len(ball.vertices)
    huge = np.full((n, 2), 1e300)
    for words, own in (
        ("whose square float", {"descriptors": (huge, huge)}),
        ("map of 0 vertices", {"initial": np.zeros(0, int)}),
        ("unequal lengths", {"landmarks": [[1, 2], [3]]}),
        ("orientation is", {"orientation": "keep left"}),
    ):
        with pytest.raises(ValueError, match=words):
            jfsf.match(ball, ball, **own)
    cloud = Mesh(ball.vertices, np.zeros((0, 3), int))
    with pytest.raises(ValueError, match="orientation is"):
        jfsf.match(cloud, cloud, orientation="keep left")
