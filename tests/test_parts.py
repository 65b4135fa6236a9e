"""Parts of shapes: the laws of `match(..., partial=True)`, and its stages."""

import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.stats import spearmanr
from shapes import SMALL, small

import jfsf
from jfsf import data, testing
from jfsf.apps.mapfiles import MapFileError, read_match, write_match
from jfsf.geometry import GeodesicSolver, geodesics, pair_distances
from jfsf.learned._inputs import EIGENPAIRS
from jfsf.matching import _partial
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._confidence import region_confidence
from jfsf.matching._kept_landmarks import MISSED
from jfsf.matching._people import places_of_parts
from jfsf.matching.parts import PartSettings, _region, _register, _starts, cut
from jfsf.matching.parts import _match as parts_match
from jfsf.matching.parts._beam import Assigned, anchors_of, assign
from jfsf.matching.parts._match import Parts, match_parts
from jfsf.matching.parts._region import (
    covered_by,
    draw_onto,
    membership,
    nearest,
    target,
)
from jfsf.matching.parts._register import register, whole_at_rest
from jfsf.matching.parts._samples import (
    ball_descriptors,
    ball_difference,
    descriptor_difference,
    part_samples,
)
from jfsf.matching.parts._sides import both_sides, mirrored
from jfsf.matching.parts._starts import (
    WEIGHTS,
    RankWeights,
    cost_of,
    first_starts,
    scale_of,
    start_from,
    start_of,
    starts,
)
from jfsf.matching.parts._surfaces import (
    from_rim,
    inverse_map,
    likely_part,
    longest_loop,
    outward,
    scaled,
)
from jfsf.mesh import MeshError, decimate, surface_area
from jfsf.mesh._closest import nearest_vertices
from jfsf.mesh._geometry import (
    boundary_edges,
    farthest_vertices,
    vertex_areas,
    vertex_normals,
)
from jfsf.runtime._runners import OneByOne
from jfsf.types import Mesh

# One that differs in all directions, and fine enough that half of it can be matched.
WHOLE = testing.blob(3, subdivisions=3)
AREA = surface_area(WHOLE)
UP = np.array([0.2, 0.3, 0.93])
HEIGHT = WHOLE.vertices @ UP
PART = cut(WHOLE, HEIGHT < np.quantile(HEIGHT, 0.7))
N = len(WHOLE.vertices)


def partial_match(mesh_x, mesh_y, **options):
    options |= {"settings": SMALL, "cache": False}
    return jfsf.match(mesh_x, mesh_y, partial=True, **options)


def turned(mesh: Mesh, seed: int = 0) -> Mesh:
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return testing.move(mesh, (turn * np.sign(np.linalg.det(turn)), rng.normal(size=3)))


@pytest.fixture(scope="module")
def steps():
    """Names of those of `found`."""
    return []


@pytest.fixture(scope="module")
def found(steps, all_run_once):
    """The part, turned, matched with the whole."""
    return partial_match(turned(PART.mesh), WHOLE, progress=steps.append)


def test_each_step_says_its_name(found, steps):
    parts = SMALL.parts
    drawn = [name for name in steps if name.startswith("registration")]
    again = sum("again" in name for name in drawn)
    assert 0 < again <= parts.registered_again
    assert len(drawn) <= parts.assignments + parts.alignments + again
    assert {"spectra", "refinement of a region"} <= set(steps)


def error(T, wanted) -> float:
    return float(pair_distances(WHOLE, np.asarray(T), wanted).mean() / np.sqrt(AREA))


def overlap(found, wanted) -> float:
    found = np.asarray(found)
    mass = vertex_areas(*WHOLE)
    return mass[found & wanted].sum() / mass[found | wanted].sum()


def test_a_cut_of_a_mesh_recovers_the_identity_and_its_region(found):
    inside = np.zeros(len(WHOLE.vertices), bool)
    inside[PART.index] = True
    # Less than an edge: they are cut in other places, so vertices may slide.
    assert error(found.T_xy, PART.index) < 0.03
    assert np.asarray(found.matched_x).mean() > 0.98
    # One ring of vertices along the cut is a tenth of so coarse a part.
    assert overlap(found.matched_y, inside) > 0.8
    assert found.matched_y.shape == found.T_yx.shape == (len(WHOLE.vertices),)
    evidence, wanted = (
        found.certificate,
        region_confidence(found.certificate),
    )
    assert evidence.confidence == wanted > 0.9
    assert evidence.region_cost < 0
    assert found.confidence_x is None
    for side, mesh in (("x", turned(PART.mesh)), ("y", WHOLE)):
        member = np.asarray(getattr(found, f"membership_{side}"))
        matched = np.asarray(getattr(found, f"matched_{side}"))
        assert member.min() >= 0 and member.max() <= 1
        np.testing.assert_array_equal(matched, member > 0.5)
        mass = vertex_areas(*mesh)
        share = getattr(found, f"overlap_{side}")
        assert share == pytest.approx(mass[matched].sum() / mass.sum(), rel=1e-5)


def test_there_is_no_confidence_where_units_may_differ(found, monkeypatch):
    unknown = found.certificate._replace(confidence=np.float32(np.nan))
    members = np.asarray(found.membership_x), np.asarray(found.membership_y)
    parts = Parts(np.asarray(found.T_xy), np.asarray(found.T_yx), *members, unknown, 1)
    monkeypatch.setattr(_partial, "match_parts", lambda *_, **__: parts)
    for same_unit in (True, False):
        again = partial_match(turned(PART.mesh), WHOLE, same_unit=same_unit)
        assert np.isnan(again.certificate.confidence) != same_unit
        assert again.certificate.region_cost == unknown.region_cost


@pytest.mark.slow
def test_a_swap_of_the_shapes_swaps_the_maps(found):
    other = partial_match(WHOLE, turned(PART.mesh))
    np.testing.assert_array_equal(other.T_yx, found.T_xy)
    np.testing.assert_array_equal(other.matched_x, found.matched_y)
    np.testing.assert_array_equal(other.matched_y, found.matched_x)
    np.testing.assert_array_equal(other.membership_x, found.membership_y)
    assert other.overlap_x == found.overlap_y
    named = "coverage_xy", "bijectivity_x"
    for a, b in zip(named, ("coverage_yx", "bijectivity_y"), strict=True):
        assert getattr(other.certificate, a) == getattr(found.certificate, b)


# Of the whole to the part; of what the part lacks, to any vertex.
TO_PART = np.full(N, 3, np.int32)
TO_PART[PART.index] = np.arange(len(PART.index))


def test_a_given_map_is_the_only_start_and_landmarks_are_judged(
    found, monkeypatch, quick
):
    """The map between the regions is kept as it is: its refinement is tested above."""
    seen, steps = [], []

    def keep(shapes, inputs, settings, host):
        seen.append((inputs, settings.retry_below))
        _, part_y = shapes.values()
        T_yx = inverse_map(inputs.initial, part_y.surface)
        return found._replace(T_xy=inputs.initial, T_yx=T_yx)

    monkeypatch.setattr(_partial, "match_shapes", keep)
    at = PART.index[[5, 200, 300]]
    rows = np.stack([at, [5, 200, 40]], 1)  # the last is wrong
    given = jfsf.match(
        *(WHOLE, turned(PART.mesh)),
        partial=True,
        initial=TO_PART,
        landmarks=rows,
        orientation="reverse",  # the map knows better
        settings=replace(SMALL, parts=QUICK),
        cache=False,
        progress=steps.append,
    )
    assert error(given.T_yx, PART.index) < 0.03
    assert np.asarray(given.matched_y).mean() > 0.98
    missed = np.asarray(given.certificate.landmarks)
    assert missed.shape == (3,) and missed[:2].max() < MISSED < missed[2]
    (inputs, retry_below), _ = seen  # what is refined is refined once more
    assert retry_below == 0 and len(inputs.landmarks[0]) == 3 and inputs.sign == -1
    names = ["spectra", *["registration of the initial map"] * 2]
    assert steps == [*names, *["refinement of a region"] * 2]


def test_a_functional_map_is_turned_into_a_map_of_points(found, monkeypatch):
    class SeenError(Exception):
        pass

    def see(*meshes, T_xy, T_yx, **_):
        raise SeenError(np.asarray(T_xy), T_yx)

    monkeypatch.setattr(_partial, "match_parts", see)
    options = {"partial": True, "settings": SMALL, "cache": False}
    pair = turned(PART.mesh), WHOLE
    with pytest.raises(SeenError) as seen:
        jfsf.match(*pair, initial=found.C_yx, **options)
    T_xy, T_yx = seen.value.args
    assert T_yx is None and error(T_xy, PART.index) < 0.1
    with pytest.raises(SeenError) as seen:
        jfsf.match(*pair, initial=found, **options)
    np.testing.assert_array_equal(seen.value.args[0], found.T_xy)
    np.testing.assert_array_equal(seen.value.args[1], found.T_yx)


@pytest.mark.slow
def test_units_do_not_matter_if_both_have_them(found):
    other = partial_match(*(scaled(m, 1000) for m in (turned(PART.mesh), WHOLE)))
    assert error(other.T_xy, PART.index) < 0.03
    agree = np.asarray(other.matched_y) == np.asarray(found.matched_y)
    assert agree.mean() > 0.98


def test_two_closed_shapes_share_all(found, monkeypatch):
    n = len(WHOLE.vertices)
    whole = found._replace(T_xy=found.T_yx, matched_x=None, matched_y=None)
    monkeypatch.setattr(_partial, "match_shapes", lambda *args, **options: whole)
    closed, same = partial_match(WHOLE, WHOLE), whole
    np.testing.assert_array_equal(closed.T_xy, same.T_xy)
    np.testing.assert_array_equal(closed.matched_x, np.ones(n, bool))
    np.testing.assert_array_equal(closed.matched_y, np.ones(n, bool))
    np.testing.assert_array_equal(closed.membership_x, np.ones(n))
    assert closed.overlap_x == 1


def test_a_match_file_keeps_what_is_matched(found, tmp_path):
    path = tmp_path / "part.npz"
    write_match(path, found)
    read = read_match(path)
    np.testing.assert_array_equal(read.matched_x, found.matched_x)
    np.testing.assert_array_equal(read.matched_y, found.matched_y)
    write_match(path, found._replace(matched_x=None, matched_y=None))
    assert read_match(path).matched_x is None
    write_match(path, found._replace(matched_x=found.matched_x[1:]))
    with pytest.raises(MapFileError, match="matched_x"):
        read_match(path)


def test_what_cannot_be_partial_is_refused():
    cloud = WHOLE._replace(faces=WHOLE.faces[:0])
    with pytest.raises(MeshError, match="mesh_y: has no faces"):
        jfsf.match(WHOLE, cloud, partial=True)
    with pytest.raises(ValueError, match=f"mesh_x, which has vertices 0 to {N - 1}"):
        jfsf.match(WHOLE, WHOLE, partial=True, landmarks=np.array([[N, 0]]))
    with pytest.raises(ValueError, match="initial is a map of 3 vertices"):
        jfsf.match(WHOLE, PART.mesh, partial=True, initial=np.arange(3))


def test_a_long_boundary_is_a_hint():
    assert likely_part(PART.mesh, WHOLE) == "x"
    assert likely_part(WHOLE, PART.mesh) == "y"
    assert likely_part(WHOLE, WHOLE) is likely_part(PART.mesh, PART.mesh) is None
    assert longest_loop(WHOLE) == 0
    square = Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    )
    assert longest_loop(square) == pytest.approx(4)


def test_samples_of_a_part_see_what_they_see_in_the_whole():
    whole, part = part_samples(WHOLE, 60), part_samples(PART.mesh, 60)
    inner = part.to_boundary[part.at] > 0.35
    seen = ball_descriptors(part, np.flatnonzero(inner))
    at = PART.index[part.at[inner]]
    same = part_samples(WHOLE, 60)._replace(at=at, distance=geodesics(WHOLE, at))
    # Heat geodesics near a cut differ a little.
    away = np.abs(seen - ball_descriptors(same, np.arange(len(at))))
    assert away.mean() < 0.02
    assert np.isinf(whole.to_boundary).all()
    edge = np.unique(boundary_edges(PART.mesh.faces))
    assert (part.to_boundary[edge] == 0).all() and len(edge) > 10


def test_directions_turn_with_the_shape_and_flip_in_a_mirror():
    samples = part_samples(WHOLE, 12)
    relative = lambda s: np.conj(s.direction[:, :1]) * s.direction[:, 1:2]
    moved = part_samples(turned(WHOLE), 12)
    mirrored = part_samples(testing.mirror(WHOLE), 12)
    np.testing.assert_array_equal(moved.at, samples.at)
    at = slice(2, None)
    np.testing.assert_allclose(relative(moved)[at], relative(samples)[at], atol=1e-6)
    flipped = np.conj(relative(mirrored))[at]
    np.testing.assert_allclose(flipped, relative(samples)[at], atol=1e-6)


def test_the_beam_finds_the_scale():
    unit = np.sqrt(AREA)
    small = Mesh(PART.mesh.vertices / unit / 1.25, PART.mesh.faces)
    x = part_samples(small, 60)
    y = part_samples(Mesh(WHOLE.vertices / unit, WHOLE.faces), 150)
    best = assign(x, y, settings=PartSettings(anchors=10, beam=400))
    assert abs(np.log(best.scale[0] / 1.25)) < 0.11
    assert (np.diff(best.cost) >= 0).all()


@pytest.mark.parametrize("initial", [None, PART.index])
def test_two_units_are_named_with_a_map_and_without(initial):
    large = Mesh(PART.mesh.vertices * 1000, PART.mesh.faces)
    with pytest.raises(ValueError, match="or give same_unit=False"):
        partial_match(large, WHOLE, initial=initial)


def test_a_scale_far_from_one_is_found_where_units_may_differ(quick):
    small = Mesh(PART.mesh.vertices / 2.2, PART.mesh.faces)
    settings = PartSettings(
        anchors=10, beam=400, samples_of_part=60, samples_of_whole=150
    )
    sides = both_sides(small, WHOLE, same_unit=False, settings=settings)
    found = assign(sides.x, sides.y, same_unit=False, settings=sides.settings)
    assert abs(np.log(found.scale[0] * sides.factor / 2.2)) < 0.11
    assert (np.diff(found.cost) >= 0).all()
    # Each band of scales keeps its share.
    bands = np.digitize(np.log(found.scale), (-0.25, 0.35))
    assert set(bands) == {0, 1, 2}
    more = sides.settings
    assert more.assignments == 1.5 * settings.assignments
    assert np.bincount(bands).max() <= more.assignments // 3
    start = start_of(sides, PART.index)
    narrow = start_of(sides._replace(same_unit=True), PART.index)
    size = WEIGHTS.size * np.log(start.scale)
    assert start.rank == pytest.approx(narrow.rank + size, abs=0.2)
    tried = [start.scale for start in starts(sides)]
    assert len(tried) == len(found.scale) + more.alignments
    assert set(tried) > set(found.scale)


@pytest.mark.parametrize("larger", (1 / 50, 20))
def test_where_units_may_differ_the_size_of_a_shape_is_not_read(larger):
    settings = PartSettings(samples_of_part=20, samples_of_whole=30)
    as_it_is, other = (
        both_sides(scaled(PART.mesh, s), WHOLE, same_unit=False, settings=settings)
        for s in (1.0, larger)
    )
    assert other.factor == pytest.approx(as_it_is.factor / larger, rel=1e-6)
    np.testing.assert_allclose(other.x.distance, as_it_is.x.distance, rtol=1e-4)
    # Both are as long, as the samples see it: this blob has no ends that stick out.
    longest = [side.distance.max() for side in (other.x, other.y)]
    assert longest[0] == pytest.approx(longest[1], rel=0.04)
    size = surface_area(other.x.mesh) / surface_area(other.y.mesh)
    mine = surface_area(PART.mesh) / surface_area(WHOLE)
    assert size == pytest.approx(mine * as_it_is.factor**2, rel=1e-6)


LANDMARKS = np.stack([PART.index, np.arange(len(PART.index))], 1)[[7, 90, 240], ::-1]


@pytest.fixture(scope="module")
def sides():
    """The part at 1 / 1.2 of its size and the whole, with landmarks."""
    small = Mesh(PART.mesh.vertices / 1.2, PART.mesh.faces)
    return both_sides(small, WHOLE, landmarks=LANDMARKS, settings=QUICK)


def test_landmarks_are_samples_whose_partner_is_given(sides):
    x, y = sides.x, sides.y
    for own, at in ((x, LANDMARKS[:, 0]), (y, LANDMARKS[:, 1])):
        np.testing.assert_array_equal(own.at[own.landmarks], at)
    found = assign(x, y, settings=QUICK)
    at = np.flatnonzero(np.isin(found.which, x.landmarks))
    np.testing.assert_array_equal(at, [1, 2, 3])
    partner_of = dict(zip(x.landmarks, y.landmarks, strict=True))
    wanted = [partner_of[sample] for sample in found.which[at]]
    np.testing.assert_array_equal(found.partner[0, at], wanted)
    assert set(found.partner[:, at].ravel()) <= {-1, *wanted}
    assert abs(np.log(found.scale[0] / 1.2)) < 0.11


def test_a_landmark_that_contradicts_the_others_has_no_partner():
    far = int(np.argmax(geodesics(WHOLE, LANDMARKS[:1, 1])[0]))
    rows = np.concatenate([LANDMARKS, [[LANDMARKS[0, 0], far]]])
    # The first and the last are one vertex of X.
    wrong = both_sides(PART.mesh, WHOLE, landmarks=rows, settings=QUICK)
    x, best = wrong.x, assign(wrong.x, wrong.y, settings=QUICK)
    np.testing.assert_array_equal(x.direction[-1], x.direction[-4])
    column = {sample: m for m, sample in enumerate(best.which)}
    partners = [best.partner[0, column[sample]] for sample in x.landmarks]
    assert partners[:3] == list(wrong.y.landmarks[:3]) and partners[3] == -1


def test_a_start_far_from_the_landmarks_misses_them(sides, quick):
    start = start_of(sides, PART.index)
    assert start.missed == 0
    assert start.scale == pytest.approx(1.2, rel=0.03)
    assert start_of(sides, PART.index, 1.2).missed == 0
    mirrored = KDTree(-WHOLE.vertices).query(PART.mesh.vertices)[1]
    assert start_of(sides, mirrored).missed == 3
    # All in one place: no scale can be read.
    assert scale_of(sides, np.zeros_like(PART.index)) == 1


def test_a_given_map_tells_the_scale_of_a_small_part_where_units_may_differ():
    cap = cut(WHOLE, HEIGHT > np.quantile(HEIGHT, 0.92))
    larger = scaled(cap.mesh, 7)
    sides = both_sides(larger, WHOLE, same_unit=False, settings=QUICK)
    found = scale_of(sides, cap.index)
    assert found < min(sides.settings.scales)  # no search would find it
    assert found * sides.factor == pytest.approx(1 / 7, rel=0.1)


def test_a_map_is_inverse_map():
    back = inverse_map(np.asarray(PART.index), WHOLE)
    np.testing.assert_array_equal(back[PART.index], np.arange(len(PART.index)))
    images = WHOLE.vertices[PART.index[back]]
    lost = np.setdiff1d(np.arange(N), PART.index)
    nearest_image = KDTree(PART.mesh.vertices).query(WHOLE.vertices[lost])[0]
    # Along edges, not as the crow flies.
    assert away(images[lost], WHOLE.vertices[lost]) < 1.5 * nearest_image.mean()


def test_given_descriptors_are_compared_at_the_samples():
    unit = np.sqrt(AREA)
    values = np.stack([HEIGHT, WHOLE.vertices[:, 0], np.full(N, 2.0)], 1)
    own = values[PART.index], values
    sides = both_sides(PART.mesh, WHOLE, descriptors=own, settings=QUICK)
    best = assign(sides.x, sides.y, settings=QUICK)
    there = best.partner[0] >= 0
    at_x = PART.index[sides.x.at[best.which[there]]]
    at_y = sides.y.at[best.partner[0, there]]
    assert away(WHOLE.vertices[at_y], WHOLE.vertices[at_x]) / unit < 0.12
    some = values[:5]
    unlike = descriptor_difference(some, 1 + some)
    by_hand = np.abs(some[:, None] - 1 - some) / (some.std(0) + (some.std(0) == 0))
    by_hand = np.mean((np.minimum(by_hand, 3) / 1.5) ** 2, 2)
    np.testing.assert_allclose(unlike, by_hand)
    assert np.diag(descriptor_difference(some, some)).max() == 0


def test_a_radius_at_which_no_ball_is_read_is_left_out():
    """Without a warning of numpy, which a user would see."""
    rng = np.random.default_rng(0)
    balls_x, balls_y = rng.normal(size=(3, 4, 5)), rng.normal(size=(6, 4, 5))
    less = ball_difference(balls_x[:, :3], balls_y[:, :3])
    balls_y[:, 3] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(ball_difference(balls_x, balls_y), less)


def test_a_part_in_place_covers_its_region(monkeypatch):
    onto = target(PART.mesh)
    monkeypatch.setattr(_region, "CURVATURE_WEIGHTS", (0.0, 0.0))
    drawn = draw_onto(WHOLE, onto, WHOLE.vertices, PART.index)
    np.testing.assert_allclose(drawn.moved, WHOLE.vertices, atol=0.02)
    assert drawn.matched_x.all()
    np.testing.assert_array_equal(drawn.T_xy, PART.index)
    _, inside = covered_by(onto, WHOLE, drawn)
    wanted = np.zeros(len(WHOLE.vertices), bool)
    wanted[PART.index] = True
    assert overlap(inside, wanted) > 0.97
    # The other way round the whole covers all of the part.
    _, matched = nearest(target(WHOLE), PART.mesh.vertices, onto.normal)
    assert matched.all()


def test_membership_falls_across_a_rim_and_away_from_the_surface():
    part = in_unit(PART.mesh)
    onto, inside = target(part), from_rim(part)
    assert (inside[np.unique(boundary_edges(part.faces))] == 0).all()
    at_rim = inside == 0
    own = membership(onto, part.vertices, onto.normal, inside)
    np.testing.assert_allclose(own[at_rim], 0.5)
    assert own[inside > 5 * _region.RIM_WIDTH].min() > 0.99
    whole = in_unit(WHOLE)
    normal = vertex_normals(*whole)
    found = membership(onto, whole.vertices, normal, inside)
    # What the part lacks is beyond its rim.
    lost = np.setdiff1d(np.arange(N), PART.index)
    assert found[lost].max() < 0.5
    height = np.linspace(0, 0.3, 20)
    top = int(np.argmax(inside))
    up = part.vertices[top] + height[:, None] * onto.normal[top]
    above = membership(onto, up, np.repeat(onto.normal[top : top + 1], 20, 0), inside)
    assert (np.diff(above) <= 0).all()
    reached = height[above > 0.5].max()
    assert reached == pytest.approx(_region.COVER_DISTANCE, abs=0.03)
    # A closed surface has no rim.
    assert np.isinf(from_rim(whole)).all()
    np.testing.assert_allclose(
        membership(target(whole), whole.vertices, normal, from_rim(whole)), 1
    )


def in_unit(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices / np.sqrt(AREA), mesh.faces)


def at_rest(mesh: Mesh, sign: int = 1):
    return whole_at_rest(mesh, outward(mesh, vertex_normals(*mesh)), sign)


def away(moved, wanted) -> float:
    return float(np.linalg.norm(moved - wanted, axis=1).mean())


def shifted(by: float) -> np.ndarray:
    """A start that is off: the vertices nearest to places beside those of the part."""
    whole = in_unit(WHOLE)
    beside = in_unit(PART.mesh).vertices + by * np.array([0.6, -0.8, 0])
    return np.asarray(KDTree(whole.vertices).query(beside)[1])


def test_a_whole_slides_to_its_place_on_the_part():
    whole, part = in_unit(WHOLE), in_unit(PART.mesh)
    start = shifted(0.1)
    before = away(whole.vertices[start], part.vertices)
    found = register(at_rest(whole), part, start)
    after = away(whole.vertices[found.T], part.vertices)
    assert before > 0.07 and after < before / 4
    assert found.share == pytest.approx(1)
    assert found.scale == pytest.approx(1, abs=0.03)
    # A start far off leaves more apart, or bends more.
    wrong = register(
        at_rest(whole), part, KDTree(-whole.vertices).query(part.vertices)[1]
    )
    assert wrong.residual * wrong.energy > 2 * found.residual * found.energy


def test_a_whole_in_place_stays_there_and_costs_nothing():
    whole, part = in_unit(WHOLE), in_unit(PART.mesh)
    found = register(at_rest(whole), part, PART.index)
    np.testing.assert_allclose(found.moved, whole.vertices, atol=2e-3)
    assert found.residual < 3e-3 and found.energy < 1e-4
    assert np.abs(found.rotation - np.eye(3)).max() < 0.05


def test_a_whole_is_registered_in_any_pose_and_size():
    whole, part = in_unit(WHOLE), in_unit(PART.mesh)
    found = register(at_rest(whole), part, shifted(0.05))
    moved = turned(part, 4)
    other = register(at_rest(whole), moved, shifted(0.05))
    np.testing.assert_array_equal(other.T, found.T)
    assert other.energy == pytest.approx(found.energy, rel=1e-6, abs=1e-9)
    larger = Mesh(1.2 * part.vertices, part.faces)
    assert register(at_rest(whole), larger, PART.index).scale == pytest.approx(
        1.2, 0.03
    )


def test_a_mirrored_whole_is_registered_on_a_mirrored_part():
    whole, part = in_unit(WHOLE), in_unit(PART.mesh)
    flipped = Mesh(part.vertices * [-1, 1, 1], part.faces[:, ::-1])
    found = register(at_rest(whole, -1), flipped, PART.index)
    assert away(whole.vertices[found.T], part.vertices) < 0.01
    kept = register(at_rest(whole), flipped, PART.index)
    assert kept.energy > 10 * found.energy


def test_what_an_open_whole_lacks_does_not_draw_it():
    """Two parts that overlap: each lacks what the other has at its end."""
    low, high = (np.quantile(HEIGHT, q) for q in (0.25, 0.75))
    x, y = cut(WHOLE, HEIGHT < high), cut(WHOLE, HEIGHT > low)
    part, whole = in_unit(x.mesh), in_unit(y.mesh)
    start = KDTree(whole.vertices).query(part.vertices)[1]
    found = register(at_rest(whole), part, start)
    both = HEIGHT[x.index] > low
    mass = vertex_areas(*part)
    assert found.share == pytest.approx(mass[both].sum() / mass.sum(), abs=0.08)
    at = whole.vertices[found.T]
    assert away(at[both], part.vertices[both]) < 0.035


def test_where_the_start_is_unknown_it_does_not_draw_an_open_whole():
    low, high = (np.quantile(HEIGHT, q) for q in (0.25, 0.75))
    x, y = cut(WHOLE, HEIGHT < high), cut(WHOLE, HEIGHT > low)
    part, whole = in_unit(x.mesh), in_unit(y.mesh)
    known = HEIGHT[x.index] > low
    start = np.asarray(KDTree(whole.vertices).query(part.vertices)[1])
    start[~known] = HEIGHT[y.index].argmax()  # at the wrong end
    at = lambda found: away(whole.vertices[found.T][known], part.vertices[known])
    found = register(at_rest(whole), part, start, known)
    assert at(found) < 0.03 and found.share < 0.75
    drawn = register(at_rest(whole), part, start)
    assert drawn.energy > 2 * found.energy and drawn.residual > 1.5 * found.residual
    # All of a part has its place on a whole that is closed.
    closed = in_unit(WHOLE)
    some = np.arange(len(PART.index)) % 2 == 0
    one = register(at_rest(closed), in_unit(PART.mesh), PART.index, some)
    other = register(at_rest(closed), in_unit(PART.mesh), PART.index)
    np.testing.assert_array_equal(one.T, other.T)


def test_points_near_an_anchor_without_a_partner_are_unknown(monkeypatch):
    sides = both_sides(PART.mesh, WHOLE, settings=QUICK)
    partner = np.full((1, QUICK.anchors), -1)
    partner[0, 0] = 0
    kept = Assigned(
        partner, anchors_of(sides.x, QUICK.anchors), np.ones(1), np.zeros(1)
    )
    monkeypatch.setattr(_starts, "assign", lambda *_, **__: kept)
    [(_, _, known)] = _starts._assigned(sides)
    apart = sides.x.distance[np.ix_(kept.which, sides.on_x)]
    np.testing.assert_array_equal(known, apart.argmin(0) == 0)
    assert known.any() and not known.all()


# With the fixture `quick`: neither the region nor the maps need be right.
QUICK = PartSettings(
    anchors=6,
    beam=60,
    samples_of_part=40,
    samples_of_whole=80,
    assignments=4,
    alignments=2,
)


@pytest.fixture
def quick(monkeypatch):
    """Few steps of the registrations, and one of the last drawing."""
    monkeypatch.setattr(_starts, "REACHES", (0.2, 0.1))
    monkeypatch.setattr(_register, "FIRST_UPDATES", 5)
    monkeypatch.setattr(_region, "CURVATURE_WEIGHTS", (0.0,))


@pytest.fixture(scope="module")
def matched_with(found):
    """Maps of the part and the whole with some settings; regions are not refined."""

    def refine(part_x, part_y, T_xy):
        T_yx = np.zeros(len(part_y.vertices), np.int32)
        return found._replace(T_xy=T_xy, T_yx=T_yx)

    def matched(settings, meshes=(turned(PART.mesh), WHOLE)):
        return match_parts(*meshes, refine, settings=settings)

    return matched


def test_a_limb_that_the_whole_lacks_is_not_covered_by_its_other_limb(monkeypatch):
    """One body without its left leg, and the same without its right leg."""
    body = decimate(data.load("man_t").mesh, 1500)
    across, height, _ = (body.vertices - body.vertices.mean(0)).T
    leg = height < np.quantile(height, 0.3)
    x, y = (cut(body, ~leg | side) for side in (across > 0, across < 0))
    unit = np.sqrt(surface_area(y.mesh))
    part, whole = (Mesh(c.mesh.vertices / unit, c.mesh.faces) for c in (x, y))
    both = np.isin(x.index, y.index)
    # What is missing goes to the nearest that is there.
    nearest_kept = KDTree(part.vertices[both]).query(part.vertices)[1]
    start = np.searchsorted(y.index, x.index[both])[nearest_kept]
    mass = vertex_areas(*part)
    found = register(at_rest(whole), part, start)
    assert found.share == pytest.approx(mass[both].sum() / mass.sum(), abs=0.02)
    assert away(whole.vertices[found.T][both], part.vertices[both]) < 0.01
    monkeypatch.setattr(_register, "COVERED_DISTANCE", 0.25)
    monkeypatch.setattr(_register, "COVERED_REACH", 1.0)
    drawn = register(at_rest(whole), part, start)
    assert drawn.share > 0.95 and drawn.energy > 5 * found.energy


def test_landmarks_in_both_parts_reach_the_refinement(found, quick):
    seen, said = [], []

    def refine(part_x, part_y, T_xy, landmarks):
        seen.append((part_x, part_y, landmarks))
        return found._replace(T_xy=T_xy, T_yx=np.zeros(len(part_y.vertices), np.int32))

    other = int(np.argmax(HEIGHT))  # the part lacks it
    rows = np.concatenate([LANDMARKS[:, ::-1], [[other, 0]]])
    parts = match_parts(
        *(WHOLE, PART.mesh, refine),
        T_xy=TO_PART,
        landmarks=rows,
        settings=QUICK,
        progress=said.append,
    )
    assert said == ["registration of the initial map"] * 2
    # The part is called X within.
    for part_x, part_y, inside in seen:
        check_inside(parts, part_x, part_y, inside)


def check_inside(parts, part_x, part_y, inside):
    """The landmarks, numbered in the parts, are those points of the wholes."""
    np.testing.assert_allclose(
        part_x.vertices[inside[:, 0]] * np.sqrt(AREA) / part_x_scale(parts),
        PART.mesh.vertices[LANDMARKS[:, 0]],
    )
    np.testing.assert_allclose(
        part_y.vertices[inside[:, 1]] * np.sqrt(AREA), WHOLE.vertices[LANDMARKS[:, 1]]
    )


def part_x_scale(parts) -> float:
    """Of the part, where it was given as Y."""
    return 1 / parts.scale


def same_maps(parts, others) -> bool:
    pairs = zip(parts[:4], others[:4], strict=True)
    return all(np.array_equal(a, b) for a, b in pairs) and parts.scale == others.scale


def test_places_on_a_person_are_one_more_start_and_rank_them_all(quick):
    at = farthest_vertices(WHOLE, 40)
    far = GeodesicSolver(WHOLE).rows(at).T / np.sqrt(AREA)
    there = np.exp(-((far / 0.1) ** 2))
    there /= there.sum(1, keepdims=True)
    places = there[PART.index], there
    sides = both_sides(PART.mesh, WHOLE, places=places, settings=QUICK)
    found = list(starts(sides))
    assert len(found) == QUICK.assignments + QUICK.alignments + 1
    near = nearest_vertices(sides.coarse_x, PART.mesh)
    errors = [
        error(sides.on_y[start.registered.T[near]], PART.index) for start in found
    ]
    agreed = [start.agreement for start in found]
    # The last start is theirs, and the nearer a start is the better do they agree.
    assert errors[-1] == min(errors) and agreed[-1] == max(agreed) > 0.99
    assert spearmanr(errors, agreed).statistic < -0.8
    for start in found:
        assert start.cost == cost_of(start.registered)
        more = WEIGHTS.agreement * start.agreement
        assert start.rank == pytest.approx(start.cost + more)
    assert mirrored(sides).places is None
    without = both_sides(PART.mesh, WHOLE, settings=QUICK)
    for start in starts(without):
        assert np.isnan(start.agreement) and start.rank == start.cost


@pytest.fixture(scope="module")
def people():
    """A part of one body, and another body."""
    body, _ = small("man_walk", 2000)
    height = body.vertices[:, 1]
    part = cut(body, height > np.quantile(height, 0.3)).mesh
    return part, small("woman_up", 2000)[0]


def test_parts_of_people_are_asked_about_unless_settings_say_no(people):
    spectra = tuple(jfsf.spectrum(mesh, EIGENPAIRS, cache=False) for mesh in people)

    def asked(sign=1, **options):
        settings = jfsf.Settings(**options)
        return places_of_parts(spectra, MatchInputs(sign=sign), OneByOne(), settings)

    sizes = [len(mesh.vertices) for mesh in people]
    assert [len(places) for places in asked() or ()] == sizes
    assert asked(people=False) is asked(sign=-1) is None


@pytest.mark.slow
def test_a_map_of_parts_of_people_agrees_with_the_network(people, quick):
    settings = replace(SMALL, k=EIGENPAIRS, parts=QUICK)
    found = jfsf.match(*people, partial=True, settings=settings, cache=False)
    assert 0.5 < found.certificate.person_agreement <= 1


def test_equal_settings_find_equal_regions(matched_with, quick):
    first, second = matched_with(QUICK), matched_with(replace(QUICK))
    assert same_maps(first, second)
    other = matched_with(QUICK, (WHOLE, turned(PART.mesh)))
    swapped = (other.T_yx, other.T_xy, other.membership_y, other.membership_x)
    assert all(np.array_equal(a, b) for a, b in zip(first[:4], swapped, strict=True))
    assert other.scale == 1 / first.scale


@pytest.mark.parametrize(
    "changed",
    [{"samples_of_whole": 60}, {"scales": (1.2,)}],
)
def test_settings_change_what_is_found(changed, matched_with, quick):
    first, other = matched_with(QUICK), matched_with(replace(QUICK, **changed))
    assert not same_maps(first, other)


def test_a_refined_map_that_is_not_sure_is_not_kept(found, quick):
    """Its evidence is, and decides between maps."""
    said = []

    def refine(part_x, part_y, T_xy):
        # All in one place, the worst map there is.
        ends = (np.zeros(len(p.vertices), np.int32) for p in (part_x, part_y))
        own = found.certificate._replace(log_odds=said[-1])
        return found._replace(T_xy=next(ends), T_yx=next(ends), certificate=own)

    def images(log_odds) -> int:
        said.append(np.float32(log_odds))
        parts = match_parts(turned(PART.mesh), WHOLE, refine, settings=QUICK)
        assert parts.certificate.log_odds == said[-1]
        return len(np.unique(parts.T_xy))

    assert images(QUICK.sure - 0.1) > len(PART.index) / 3
    assert images(QUICK.sure) < len(PART.index) / 3


def test_weights_change_the_choice(quick):
    sides = both_sides(PART.mesh, WHOLE, settings=QUICK)
    found = [start.registered for start in starts(sides)]
    assert len(found) == QUICK.assignments + QUICK.alignments
    for one in found:
        assert cost_of(one, RankWeights(0, 0, 1)) == pytest.approx(np.log(one.share))
        assert cost_of(one, RankWeights(1, 0, 0)) == pytest.approx(np.log(one.residual))


def test_the_best_starts_are_drawn_once_more_and_the_better_is_kept(quick, monkeypatch):
    sides = both_sides(PART.mesh, WHOLE, settings=replace(QUICK, registered_again=2))
    said = []
    once = sorted(starts(sides, said.append), key=lambda start: start.rank)
    num, said = len(once), []
    found = first_starts(sides, 1, progress=said.append)
    assert said == [
        "assignments",
        "rigid motions",
        *(f"registration {i + 1} of {num}" for i in range(num)),
        *(f"registration {i + 1} of 2 again" for i in range(2)),
    ]
    better = [min(one.rank, start_from(sides, one).rank) for one in once[:2]]
    wanted = [*better, *(one.rank for one in once[2:])]
    assert [start.rank for _, start in found] == pytest.approx(sorted(wanted))
    assert all(own is sides for own, _ in found)
    # A start is not left for one that misses more landmarks.
    monkeypatch.setattr(_starts, "MAX_LANDMARK_DISTANCE", 1e-9)
    known = both_sides(PART.mesh, WHOLE, landmarks=LANDMARKS, settings=QUICK)
    least = min(start.missed for start in starts(known))
    assert all(start.missed <= least for _, start in first_starts(known, 1))


def test_all_starts_are_drawn_in_every_second_step_and_the_best_in_all(
    quick, monkeypatch
):
    reaches = []

    def noted(*args, **kwargs):
        reaches.append(kwargs["reaches"])
        return register(*args, **kwargs)

    monkeypatch.setattr(_starts, "register", noted)
    monkeypatch.setattr(_starts, "REACHES", (0.3, 0.2, 0.1))
    steps = replace(QUICK, registered_again=2)
    found = first_starts(both_sides(PART.mesh, WHOLE, settings=steps), 1)
    assert reaches == [(0.3, 0.1)] * len(found) + [(0.3, 0.2, 0.1)] * 2


@pytest.mark.parametrize("way", [(0.6, -0.8, 0), (0, 1, 0), (0, -1, 0)])
def test_a_start_that_is_off_comes_nearer_when_it_is_drawn_again(way, quick):
    sides = both_sides(PART.mesh, WHOLE, settings=QUICK)
    beside = PART.mesh.vertices + 0.25 * np.sqrt(AREA) * np.array(way)
    start = start_of(sides, KDTree(WHOLE.vertices).query(beside)[1], 1.0)
    wanted = in_unit(WHOLE).vertices[PART.index[sides.on_x]]

    def off(one):
        return away(sides.whole.mesh.vertices[one.registered.T], wanted)

    again = start_from(sides, start)
    assert off(start) > 0.05 and off(again) < off(start) / 2
    assert again.rank < start.rank
    assert again.scale == pytest.approx(1 / start.registered.scale)


def test_what_a_start_did_not_cover_does_not_draw_it_again(quick):
    low, high = (np.quantile(HEIGHT, q) for q in (0.25, 0.75))
    x, y = cut(WHOLE, HEIGHT < high), cut(WHOLE, HEIGHT > low)
    sides = both_sides(x.mesh, y.mesh, settings=QUICK)
    start = start_of(sides, KDTree(y.mesh.vertices).query(x.mesh.vertices)[1], 1.0)
    both = HEIGHT[x.index[sides.on_x]] > low
    covered = start.registered.covered
    assert covered[both].mean() > 0.9 and covered[~both].mean() < 0.3
    # What Y lacks goes to its wrong end.
    T = np.where(covered, start.registered.T, HEIGHT[y.index[sides.on_y]].argmax())

    def again(covered):
        found = start.registered._replace(T=T, covered=covered)
        return start_from(sides, start._replace(registered=found))

    assert again(covered).rank < again(np.ones(len(T), bool)).rank - 1


def test_a_region_of_too_few_vertices_is_an_error(matched_with, quick, monkeypatch):
    monkeypatch.setattr(parts_match, "MIN_VERTICES", 10_000)
    with pytest.raises(ValueError, match="no region of 10000 vertices"):
        matched_with(QUICK)


def test_every_number_is_read():
    room = Path(parts_match.__file__).parent
    text = "".join(
        path.read_text() for path in room.glob("_*.py") if path.stem != "_settings"
    )
    for f in fields(PartSettings):
        assert f"settings.{f.name}" in text, f.name


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"refined": 0}, "refined is 0; give 1 or more"),
        ({"scales": ()}, r"scales is \(\); give one or more above 0"),
        ({"anchors": 2}, "anchors is 2, samples_of_part 80"),
        ({"samples_of_part": 12}, "anchors is 16, samples_of_part 12"),
    ],
)
def test_numbers_that_cannot_work_are_errors(wrong, message):
    with pytest.raises(ValueError, match="PartSettings: " + message):
        PartSettings(**wrong)


def test_where_no_face_is_kept_nothing_is():
    """A cloud of all vertices would be matched as one."""
    none = cut(WHOLE, np.zeros(len(WHOLE.vertices), bool))
    assert len(none.index) == len(none.mesh.vertices) == len(none.mesh.faces) == 0
