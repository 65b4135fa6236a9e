"""Two meshes to a map, and what must not change it. One size: one compilation."""

import time
from functools import cache, partial

import fast_simplification
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

import jfsf
from jfsf import pipeline, testing
from jfsf.convert import maps_of, sinkhorn
from jfsf.evaluate import MISSED, certify, geodesic_error
from jfsf.initial import SearchSettings, candidates, search_samples
from jfsf.matching import _match, _running
from jfsf.report import warnings_of
from jfsf.settings import Settings
from jfsf.sizes import Given, Size, padded, padded_sizes, spectrum_like
from jfsf.spectral import features, functional_map, truncate, truncate_pair, wks
from jfsf.storage import _programs
from jfsf.types import Maps, Mesh


@cache
def small(name, faces):
    """A decimated shape, and its vertex for each template point."""
    mesh, vertex = jfsf.data.load(name)
    points, corners = fast_simplification.simplify(
        mesh.vertices.astype(np.float32), mesh.faces, target_count=faces
    )
    near = np.asarray(KDTree(points).query(mesh.vertices)[1])
    return Mesh(points.astype(np.float64), corners.astype(np.int32)), near[vertex]


@cache
def template():
    """Points of the template in T pose, and each one's mirror image."""
    rest, vertex = jfsf.data.load("man_t")
    points = rest.vertices[vertex]
    return points, KDTree(points).query(points * (-1, 1, 1))[1]


@cache
def plain():
    (mesh_x, _), (mesh_y, _) = shapes()
    return jfsf.match(mesh_x, mesh_y, cache=False)


def shapes():
    return small("man_walk", 1100), small("man_up", 1060)


def error(found, mesh_y=None):
    (_, gt_x), (own_y, gt_y) = shapes()
    at = slice(None, None, 20)
    return geodesic_error(found.T_xy, mesh_y or own_y, gt_x[at], gt_y[at]).mean()


def same(found, share=1.0):
    for ours, theirs in ((found.T_xy, plain().T_xy), (found.T_yx, plain().T_yx)):
        assert (np.asarray(ours) == np.asarray(theirs)).mean() >= share


def nearly_same(found):
    """Up to rounding: it decides ties, which a dozen rounds carry on."""
    same(found, 0.8)
    (mesh, _) = shapes()[1]
    one, two, _ = mesh.vertices[mesh.faces.T]
    edge = np.linalg.norm(one - two, axis=1).mean()
    apart = mesh.vertices[found.T_xy] - mesh.vertices[plain().T_xy]
    assert np.linalg.norm(apart, axis=1).mean() < edge / 5


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
    named = []
    same(jfsf.match(mesh_x, mesh_y, cache=False, progress=named.append))
    first = ["spectra", "features", "search"]
    assert named == [*first, "refinement", "bending and conversion"]


@cache
def specs():
    """Both spectra, as `match` has them, not padded."""
    pair = truncate_pair(*(jfsf.basis(mesh, cache=False) for mesh, _ in shapes()))
    return jax.tree.map(jnp.asarray, pair)


@pytest.mark.slow  # the whole of match, compiled once more
def test_large_meshes_are_matched_through_tiles_and_samples():
    small = Settings(
        tiles_above=200, samples_above=300, samples=256, exhaustive_up_to=300
    )
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
    for other in (mesh_y, inside_out):
        nearly_same(jfsf.match(moved, other, cache=False))


def as_match_does(*specs, run=partial(_running.run_stage, keep=False)):
    """Padded as `match` pads: the same programs."""
    settings = Settings()
    both = padded_sizes([mesh for mesh, _ in shapes()], settings)
    pair = tuple(map(padded, specs, both))
    given = Given(None, None, None, 1, False)
    choose = _running.most_confident
    return pipeline.run_stages(
        *(*pair, *given),
        settings=settings,
        run=run,
        run_sides=lambda stage, *sides: [run(stage, *side) for side in sides],
        most_confident=choose,
        most_promising=_running.most_promising,
    )


@pytest.mark.parametrize("x64", [False, True])
def test_the_program_is_compiled_for_what_it_gets(x64):
    (mesh_x, _), (mesh_y, _) = shapes()
    cloud = mesh_x._replace(faces=mesh_x.faces[:0])
    with jax.enable_x64(x64):
        for meshes in ((mesh_x, mesh_y), (cloud, mesh_y), (mesh_x,)):
            both = padded_sizes(meshes, Settings())
            for mesh, size in zip(meshes, both, strict=True):
                spec = padded(jfsf.basis(mesh, cache=False), size)
                like = jax.tree.map(jax.typeof, spectrum_like(size))
                assert jax.tree.map(jax.typeof, spec) == like


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
    found = jfsf.match(testing.mirror(mesh_x), testing.mirror(mesh_y), cache=False)
    nearly_same(found)


def test_swapping_the_shapes_swaps_the_maps():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    found = jfsf.match(mesh_y, mesh_x, cache=False)
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
    found = jfsf.match(mesh_x, mesh_y, orientation="reverse", cache=False)
    assert found.certificate.orientation < -0.5
    # Against the mirror image of Y it is the right map.
    other = jfsf.match(
        mesh_x, testing.mirror(mesh_y), orientation="reverse", cache=False
    )
    assert other.certificate.orientation < -0.5 and error(other) < 0.05


def test_left_goes_to_right():
    (mesh, vertex), _ = shapes()  # padded to the size of the pair: one program
    _, opposite = template()
    found = jfsf.symmetry(mesh, cache=False)
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
    jfsf.match(mesh_x, mesh_y, orientation="any", cache=False)
    jfsf.match(mesh_x, mesh_y, orientation="reverse", cache=False)
    assert compiled() == before


def test_the_programs_of_search_and_refinement_serve_all_sizes():
    def samples(n):
        shape = spectrum_like(Size(128, n, 2 * n))
        return jax.eval_shape(pipeline.shape_samples, shape)

    assert samples(5120) == samples(10240)


@pytest.mark.parametrize(("large", "at_a_time"), [(1 << 26, 2), (99, 1)])
def test_large_shapes_have_their_features_one_by_one(monkeypatch, large, at_a_time):
    running, most = [], []

    def program(side):
        running.append(side)
        time.sleep(0.1)
        most.append(len(running))
        running.pop()
        return side

    monkeypatch.setattr(_running, "_program", lambda *_: program)
    monkeypatch.setattr(_running, "LARGE", large)
    sides = _running._run_sides(None, (np.zeros(25, "f4"),), (np.ones(25, "f4"),))
    assert max(most) == at_a_time
    assert [side[0] for side in sides] == [0, 1]


def test_a_folder_of_many_sizes_needs_twelve_programs():
    rng = np.random.default_rng(0)
    programs = {}

    def run(stage, *args):
        leaves, tree = jax.tree.flatten(args)
        shapes = [(x.shape, x.dtype) for x in map(jax.typeof, leaves)]
        asked = stage.func, tree, *shapes
        if asked not in programs:
            programs[asked] = jax.eval_shape(stage, *args)
        return programs[asked]

    def all_starts(attempt, first, others, *_):
        for make in others:
            make()
        return attempt(first)

    def first_two(promise, starts, num):
        one = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), starts)
        jax.eval_shape(promise, one)
        assert num == 2
        return starts

    settings = Settings()
    given = Given(None, None, None, 1, False)
    for _ in range(100):
        n = rng.integers(2600, 25_600, 2)
        if max(n) > 4 * min(n):
            continue
        meshes = [Mesh(np.zeros((m, 3)), np.zeros((2 * m - 4, 3), int)) for m in n]
        pair = map(spectrum_like, padded_sizes(meshes, settings))
        pipeline.run_stages(
            *(*pair, *given),
            settings=settings,
            run=run,
            run_sides=lambda stage, *sides: [run(stage, *side) for side in sides],
            most_confident=all_starts,
            most_promising=first_two,
        )
    assert 9 <= len(programs) <= 12


def test_a_cloud_without_an_outside_has_no_left_and_right():
    points = np.random.default_rng(0).random((162, 3))
    cloud = Mesh(points, np.zeros((0, 3), np.int32))
    with pytest.raises(jfsf.MeshError, match="symmetry: mesh has 162 vertices and no"):
        jfsf.symmetry(cloud, cache=False)


def test_one_landmark_decides_a_flip():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    points, opposite = template()
    hand = points[:, 0].argmax()
    for truth, way in ((gt_y, 1), (gt_y[opposite], -1)):
        known = np.array([[gt_x[hand], truth[hand]]])
        found = jfsf.match(
            mesh_x, mesh_y, orientation="any", landmarks=known, cache=False
        )
        assert way * found.certificate.orientation > 0.8
        at = slice(None, None, 20)
        assert geodesic_error(found.T_xy, mesh_y, gt_x[at], truth[at]).mean() < 0.05


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


def test_point_clouds_are_not_mirrored():
    # Of 500 points, neighbours are on several limbs.
    (mesh_x, gt_x), (mesh_y, gt_y) = (small(n, 4000) for n in ("man_walk", "man_up"))
    cloud_x, cloud_y = (m._replace(faces=m.faces[:0]) for m in (mesh_x, mesh_y))
    found = jfsf.match(cloud_x, cloud_y, cache=False)
    assert found.T_xy.shape == (len(mesh_x.vertices),)
    assert found.certificate.orientation > 0.8 and found.certificate.finite
    at = slice(None, None, 20)
    assert geodesic_error(found.T_xy, mesh_y, gt_x[at], gt_y[at]).mean() < 0.06


def test_a_cloud_without_an_outside_is_matched_up_to_its_mirror_image(monkeypatch):
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    _, opposite = template()
    cloud = mesh_x._replace(faces=np.zeros((0, 3), np.int32))
    monkeypatch.setattr(_match, "reconstruct", lambda mesh: (mesh, mesh))
    found = jfsf.match(cloud, mesh_y, cache=False)
    assert found.T_xy.shape == (len(mesh_x.vertices),)
    assert np.isnan(found.certificate.orientation) and found.certificate.finite
    at = slice(None, None, 20)
    errors = [
        geodesic_error(found.T_xy, mesh_y, gt_x[at], truth[at]).mean()
        for truth in (gt_y, gt_y[opposite])
    ]
    assert min(errors) < 0.06
    (said,) = (w for w in warnings_of(found.certificate, "preserve") if "left" in w)
    assert "cannot be told" in said
    assert not any("left" in w for w in warnings_of(found.certificate, "any"))


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
        (np.zeros((0, 2), int), r"landmarks have shape \(0, 2\)"),
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


def ten_lines(emb_x, emb_y, marginal_x, marginal_y):
    """A converter of a user's: nearest neighbour by a dense table, no tiles."""
    square = jnp.sum((emb_x[:, None] - emb_y[None]) ** 2, 2)
    far_x, far_y = (jnp.where(m > 0, 0, jnp.inf) for m in (marginal_x, marginal_y))
    T_xy = jnp.argmin(square + far_y[None, :], 1)
    return Maps(T_xy, jnp.argmin(square + far_x[:, None], 0))


def test_settings_change_any_stage():
    (mesh_x, _), (mesh_y, _) = shapes()
    mine = jfsf.Settings(
        k=150,
        ks=(30, 60, 100, 150),
        refine_converter=ten_lines,
        converter=partial(sinkhorn, k0=40),
        bend_rounds=0,
    )
    found = jfsf.match(mesh_x, mesh_y, settings=mine, cache=False)
    k = len(mesh_y.vertices) // 4  # a quarter of the vertices of the smaller
    assert found.C_yx.shape == (k, k)
    assert error(found) < 0.06 and 0 < found.certificate.nn_agreement <= 1


def test_a_converter_without_a_plan_has_a_certificate():
    (mesh_x, _), (mesh_y, _) = shapes()
    mine = jfsf.Settings(converter=ten_lines, bend_converter=ten_lines, bend_rounds=1)
    start = plain().C_yx
    found = jfsf.match(mesh_x, mesh_y, initial=start, settings=mine, cache=False)
    evidence = found.certificate
    assert error(found) < 0.05 and evidence.finite and evidence.coverage_xy > 0.6
    assert np.isnan(evidence.marginal_error) and np.isnan(evidence.nn_agreement)


def test_descriptors_replace_the_wave_kernel_signature():
    # Given the default's own, the map is the default's.
    (mesh_x, _), (mesh_y, _) = shapes()
    step = Settings().features.wks_step
    given = tuple(np.asarray(wks(spec))[:, ::step] for spec in specs())
    found = jfsf.match(mesh_x, mesh_y, descriptors=given, cache=False)
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
def searched():
    """The stages up to the search's candidates, apart from `match`."""
    x, y = (features(spec) for spec in specs())
    found = candidates(search_samples(x), search_samples(y))
    return x, y, found


def test_the_searchs_own_map_as_initial_gives_the_default():
    (mesh_x, _), (mesh_y, _) = shapes()
    best = []

    def run(stage, *args):
        result = _running.run_stage(stage, *args, keep=False)
        if stage.func is pipeline.best_candidate:
            best.append(np.asarray(result.C_yx))
        return result

    as_match_does(*specs(), run=run)
    found = jfsf.match(mesh_x, mesh_y, initial=best[0], cache=False)
    same(found)
    assert np.isnan(found.certificate.gap)  # no search, no second candidate


def test_maps_of_anyone_are_refined():
    (mesh_x, _), (mesh_y, _) = shapes()
    # A record with T_xy, or T_xy alone.
    for initial in (plain(), np.asarray(plain().T_xy)):
        found = jfsf.match(mesh_x, mesh_y, initial=initial, cache=False)
        assert error(found) < 1.1 * error(plain())


def test_a_refinement_that_begins_above_the_search_needs_an_initial_map():
    settings = Settings(ks=(50, 60))
    with pytest.raises(ValueError, match="ks begins at 50, .* finds maps of 40"):
        jfsf.match_spectra(*specs(), settings=settings)


def test_a_small_initial_map_grows():
    x, y, _ = searched()
    T_xy = jnp.asarray(plain().T_xy)
    small = functional_map(T_xy, truncate(x.spec, 12), truncate(y.spec, 12))
    settings = Settings(ks=(30, 40))
    C_yx = pipeline.refine(x, y, small, settings=settings)
    assert C_yx.shape == (40, 40)
    truth = functional_map(T_xy, truncate(x.spec, 40), truncate(y.spec, 40))
    gap = jnp.linalg.norm(C_yx - truth) / jnp.linalg.norm(truth)
    assert gap < 0.5


def test_stage_by_stage_is_match():
    spec_x, spec_y = specs()
    x, y, found = searched()
    assert found.energy[0] <= found.energy[1]
    start = pipeline.given_map(spec_x, spec_y, found.C_yx[0])
    assert start.sign == 1
    np.testing.assert_allclose(start.orientation, found.orientation[0], atol=1e-6)
    few = map(pipeline.refinement_samples, (x, y))
    C_yx = pipeline.refine(*few, start.C_yx, start.sign)
    tiles = pipeline.pair_tiles(spec_x, spec_y)
    embs = pipeline.bend(spec_x, spec_y, C_yx, start.sign, tiles)
    maps = pipeline.convert(*embs, spec_x, spec_y, tiles)
    nearly_same(maps_of(maps))
    C_yx = functional_map(maps.T_xy, spec_x, spec_y)
    evidence = certify(maps, *embs, C_yx, spec_x, spec_y)
    assert evidence.orientation > 0.8 and evidence.finite


def test_rows_of_zeros_are_left_out_of_a_map():
    C_yx = jnp.asarray(np.random.default_rng(0).normal(size=(20, 20)))
    embed = partial(pipeline.bend, *specs(), settings=Settings(bend_rounds=0))
    for ours, truth in zip(embed(jnp.pad(C_yx, (0, 10))), embed(C_yx), strict=True):
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
    search = SearchSettings(
        fit_size=20,
        flip_range=(6, 16),
        flip_ks=(16, 20),
        final_ks=(18, 20),
        assignment_ks=(8, 20),
    )
    assert Settings(search=search, ks=(20, 30), k=30).min_vertices == 80
