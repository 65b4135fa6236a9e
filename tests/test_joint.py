"""Which pairs are matched, which maps are right, and the maps of a collection."""

from itertools import combinations, product

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from jfsf import testing
from jfsf.apps.collections import (
    Collection,
    collection,
    grow,
    reason,
    trust,
    unlikeness,
)
from jfsf.apps.collections._cycles import (
    AGREE,
    Sketch,
    Triangle,
    distance,
    first_pairs,
    more_pairs,
    sketch,
    triangles,
)
from jfsf.apps.collections._grow import (
    Graph,
    Matched,
    best_paths,
    map_along,
)
from jfsf.apps.collections._member import Member
from jfsf.apps.collections._mirror import grow_with_mirrors
from jfsf.apps.registration import Registration
from jfsf.mesh import MeshError
from jfsf.spectral import spectrum
from jfsf.types import Maps, Mesh


def symmetric(rng, s):
    half = np.triu(rng.uniform(0.1, 1, (s, s)), 1)
    return half + half.T


def closed(edges):
    """Triangles of which all sides are among the edges."""
    return [
        (a, b, c)
        for a, b, c in combinations(sorted({v for edge in edges for v in edge}), 3)
        if {(a, b), (b, c), (a, c)} <= set(edges)
    ]


def test_a_sketch_tells_shapes_apart_and_not_their_sizes():
    sphere = trimesh.creation.icosphere(subdivisions=2)
    ball = Mesh(np.asarray(sphere.vertices), np.asarray(sphere.faces, np.int32))
    large = ball._replace(vertices=7 * ball.vertices)
    egg = ball._replace(vertices=ball.vertices * [1, 1, 2])
    of_ball, of_large, of_egg = (sketch(spectrum(m, 40)) for m in (ball, large, egg))
    apart = unlikeness([s.signature for s in (of_ball, of_large, of_egg)])
    assert apart[0, 1] < 1e-3 < 0.02 < apart[0, 2]
    # Weyl's law: the first mode of the sphere is 2 of 4 pi, the thirtieth near 30.
    assert of_ball.signature[0] == pytest.approx(np.sqrt(2 / 30), rel=0.02)
    centre = of_ball.mass @ of_ball.points
    spread = of_ball.mass @ np.sum((of_ball.points - centre) ** 2, 1)
    assert 2 * spread == pytest.approx(1, rel=1e-4)


@given(st.integers(0, 50), st.integers(2, 12))
def test_first_pairs_reach_all_shapes_and_close_triangles(seed, s):
    unlike = symmetric(np.random.default_rng(seed), s)
    edges = first_pairs(unlike)
    assert edges == sorted(set(edges)) and all(a < b for a, b in edges)
    assert len(edges) <= 2 * (s - 1)
    paths = best_paths(dict.fromkeys(edges, 0.9), s)
    assert (paths.trust > 0).all()
    if s > 2:  # every shape is a corner of some triangle
        assert {v for corners in closed(edges) for v in corners} == set(range(s))


def test_more_pairs_are_new_and_lead_to_joined_shapes():
    unlike = symmetric(np.random.default_rng(0), 6)
    tried = {(0, 4), (1, 4), (0, 5)}
    found = more_pairs(unlike, tried, [0, 1, 2, 3], most=10, most_of_one=9)
    assert not set(found) & tried
    assert {b for _, b in found} == {4, 5} and all(a < 4 for a, _ in found)
    assert len(more_pairs(unlike, tried, [0, 1, 2, 3], most=1, most_of_one=9)) == 1
    assert more_pairs(unlike, tried, range(6), most=10, most_of_one=9) == []
    # Shape 4 has two pairs, shape 5 one.
    few = more_pairs(unlike, tried, [0, 1, 2, 3], most=10, most_of_one=2)
    assert len(few) == 1 and few[0][1] == 5


def test_of_a_way_the_first_shape_in_doubt_gets_more_pairs():
    unlike = symmetric(np.random.default_rng(0), 6)
    tried = {(0, 1), (0, 2), (2, 3), (3, 4), (4, 5)}
    some = {"before": np.array([-1, 0, 0, 2, 3, 4]), "most": 10, "most_of_one": 9}
    first = more_pairs(unlike, tried, [0, 1, 2], **some)
    assert first == [(0, 3), (1, 3)]
    # It has pairs with all of the sure ones now: the next one gets some.
    after = more_pairs(unlike, tried | {*first}, [0, 1, 2], **some)
    assert len(after) == 2 and {b for _, b in after} == {4}


def test_more_pairs_close_triangles_before_they_join_shapes_alike():
    unlike = np.ones((5, 5)) - np.eye(5)
    unlike[4, :4] = unlike[:4, 4] = 0.4, 0.3, 0.2, 0.1
    tried = {(0, 1), (1, 2), (2, 3), (0, 4)}
    options = {"most": 9, "most_of_one": 9, "each": 1}
    assert more_pairs(unlike, tried, range(4), **options) == [(1, 4)]
    assert more_pairs(unlike, tried - {(0, 4)}, range(4), **options) == [(3, 4)]


def enumerated(confidence, found, limit):
    """The definition: the sum over all ways to be right or wrong."""
    edges = sorted(confidence)
    total = np.zeros(len(edges))
    whole = 0.0
    for state in product((0, 1), repeat=len(edges)):
        right = dict(zip(edges, state, strict=True))
        chance = np.prod([p if right[e] else 1 - p for e, p in confidence.items()])
        for one in found:
            agree = AGREE[3 - sum(right[e] for e in one.edges)]
            chance *= agree if one.apart < limit else 1 - agree
        whole += chance
        total += chance * np.array(state)
    return dict(zip(edges, (total / whole).tolist(), strict=True))


@given(
    st.lists(st.floats(0.05, 0.95), min_size=7, max_size=7),
    st.booleans(),
    st.booleans(),
)
def test_trust_is_the_sum_over_all_states_where_triangles_form_a_tree(p, one, two):
    edges = [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3), (2, 4), (3, 4)]
    confidence = dict(zip(edges, p, strict=True))
    apart = {True: 0.0, False: 1.0}
    found = [
        Triangle((0, 1, 2), apart[one]),
        Triangle((1, 2, 3), apart[two]),
        Triangle((2, 3, 4), apart[one]),
    ]
    ours, oracle = (
        trust(confidence, found, limit=0.2),
        enumerated(confidence, found, 0.2),
    )
    assert ours == pytest.approx(oracle, abs=1e-6)


def test_a_wrong_map_is_found_by_its_triangles():
    shapes = range(4)
    confidence = {edge: 0.9 for edge in combinations(shapes, 2)}
    wrong = (1, 2)
    corners = combinations(shapes, 3)
    found = [Triangle(c, 0.0) for c in corners]
    found = [t._replace(apart=1.0) if wrong in t.edges else t for t in found]
    right = trust(confidence, found, limit=0.2)
    assert right[wrong] < 0.1
    assert min(p for edge, p in right.items() if edge != wrong) > 0.95


def test_without_a_confidence_triangles_decide():
    confidence = {edge: float("nan") for edge in combinations(range(4), 2)}
    found = [Triangle(c, 0.0) for c in combinations(range(4), 3)]
    assert min(trust(confidence, found, limit=0.2).values()) > 0.7
    assert set(trust(confidence, [], limit=0.2).values()) == {0.5}


def test_ways_are_the_most_probable_and_maps_compose():
    right = {(0, 1): 0.9, (1, 2): 0.9, (0, 2): 0.5, (2, 3): 0.8}
    paths = best_paths(right, 5, template=0)
    assert paths.way(2) == [0, 1, 2] and paths.way(3) == [0, 1, 2, 3]
    np.testing.assert_allclose(paths.trust, [1, 0.9, 0.81, 0.648, 0], atol=1e-6)
    assert paths.way(4) == [4] and paths.before[4] == -1
    # The middle of the chain, not the shape that nothing reaches.
    assert best_paths(right, 5).template in (1, 2)
    rng = np.random.default_rng(0)
    turn = [rng.permutation(7) for _ in range(4)]  # shape i's vertex of each label
    maps = {
        (a, b): Maps(turn[b][np.argsort(turn[a])], turn[a][np.argsort(turn[b])])
        for a, b in right
    }
    for way in ([0, 1, 2, 3], [3, 2, 0]):
        a, b = way[0], way[-1]
        assert (map_along(maps, way)[turn[a]] == turn[b]).all()


def clouds(rng, s, n=40):
    """Shapes of one cloud, in other orders, and the true maps."""
    points = rng.normal(size=(n, 3))
    order = [rng.permutation(n) for _ in range(s)]
    sketches = [Sketch(np.ones(30), points[own], np.full(n, 1 / n)) for own in order]
    maps = {
        (a, b): Maps(np.argsort(order[b])[order[a]], np.argsort(order[a])[order[b]])
        for a, b in combinations(range(s), 2)
    }
    return sketches, maps


def test_triangles_measure_the_disagreement_of_their_maps():
    rng = np.random.default_rng(0)
    sketches, maps = clouds(rng, 4)
    assert max(one.apart for one in triangles(maps, sketches)) == 0
    maps[1, 2] = maps[1, 2]._replace(T_xy=rng.permutation(40))
    for one in triangles(maps, sketches):
        a, b, c = one.corners
        over = maps[b, c].T_xy[maps[a, b].T_xy]
        points = sketches[c].points
        apart = np.linalg.norm(points[over] - points[maps[a, c].T_xy], axis=1).mean()
        assert one.apart == pytest.approx(apart)
        assert (one.apart > 0.3) == ((1, 2) in one.edges)
    straight = distance(maps[0, 1].T_xy, maps[0, 1].T_xy, sketches[0], sketches[1])
    assert straight == 0


def test_more_pairs_are_matched_where_maps_are_wrong():
    rng = np.random.default_rng(0)
    points, mass = rng.normal(size=(40, 60)) / 11, np.full(40, 1 / 40)
    sketches = [Sketch(rng.uniform(size=30), points, mass) for _ in range(6)]
    own = np.arange(40)
    asked = []

    def match(edges):
        asked.extend(edges)
        # The first maps of shape 5 are wrong; the others know each other.
        seen = sum(5 in edge for edge in asked)
        for edge in edges:
            bad = 5 in edge and seen <= 2
            T = rng.permutation(40) if bad else own
            yield Matched(Maps(T, np.argsort(T)), 0.7)

    graph = grow(sketches, match)
    assert graph.joined.all()
    assert len(asked) == len(set(asked)) <= 18
    bad = {e for e, one in graph.matched.items() if (one.maps.T_xy != own).any()}
    assert bad and max(graph.right[e] for e in bad) < 0.5
    few = grow(sketches, match, pairs_a_shape=0)
    assert len(few.matched) <= 10
    with pytest.raises(ValueError, match="has 1 shapes; give two or more"):
        grow(sketches[:1], match)


def test_a_long_way_of_right_maps_asks_for_no_more_pairs():
    """As those of a thousand shapes: from the middle of a row to its ends."""
    points = np.random.default_rng(0).normal(size=(40, 60)) / 11
    own, mass = np.arange(40), np.full(40, 1 / 40)
    sketches = [Sketch(np.full(30, 0.01 * i), points, mass) for i in range(50)]
    rounds = []

    def match(edges):
        rounds.append(edges)
        return [Matched(Maps(own, own), 0.999) for _ in edges]

    graph = grow(sketches, match)
    assert len(rounds) == 1 and graph.joined.all()
    assert max(len(graph.paths.way(i)) for i in range(50)) > 12


def test_a_wrong_map_of_high_confidence_is_outvoted():
    """Two groups of shapes; the first map between them is wrong, and the second right.

    There is one triangle with both, which disagrees: the less confident one is blamed.
    """
    rng, own = np.random.default_rng(0), np.arange(40)
    points, mass = rng.normal(size=(40, 60)) / 11, np.full(40, 1 / 40)
    places = 0.0, 0.1, 0.21, 0.9, 1.0, 1.11
    sketches = [Sketch(np.full(30, at), points, mass) for at in places]

    def match(edges):
        for a, b in edges:
            between = (a < 3) != (b < 3)
            T = rng.permutation(40) if (a, b) == (2, 3) else own
            sure = 0.97 if (a, b) == (2, 3) or not between else 0.67
            yield Matched(Maps(T, np.argsort(T)), sure)

    graph = grow(sketches, match)
    assert (2, 3) in graph.matched and len(graph.matched) <= 18
    assert graph.joined.all()
    for shape in set(range(6)) - {graph.paths.template}:
        assert (map_along(graph.maps, graph.paths.way(shape)) == own).all()


def handed(rng, sides, doubt=()):
    """Shapes of one cloud, those of side -1 mirrored, and what matches them.

    Maps of shapes in doubt are not trusted, however they are turned.
    """
    points, mass = rng.normal(size=(40, 60)) / 11, np.full(40, 1 / 40)
    sketches = [Sketch(rng.uniform(size=30), points, mass) for _ in sides]
    own = np.arange(40)
    asked = []

    def match(edges, turned):
        for (a, b), turn in zip(edges, turned, strict=True):
            asked.append(((a, b), turn))
            good = sides[a] * sides[b] == (-1 if turn else 1)
            good = good and not {a, b} & set(doubt)
            T = own if good else rng.permutation(40)
            yield Matched(
                Maps(T, np.argsort(T)), *((0.99, 0.1) if good else (0.2, 0.5))
            )

    return sketches, match, asked


def test_mirror_images_are_named_or_mirrored_back():
    rng = np.random.default_rng(0)
    sides = np.array([1, 1, -1, 1, -1, 1, 1])
    sketches, match, asked = handed(rng, sides, doubt=[6])
    names = tuple("abcdefg")
    named = grow_with_mirrors(sketches, match, template=0)
    assert named.mirrored == {2, 4}
    assert np.flatnonzero(named.joined).tolist() == [0, 1, 3, 5]
    said = reason(named, names, 2)
    assert "a mirror image of the others: mirrored, it fits" in said and "0.99" in said
    assert "nor to its mirror image" in reason(named, names, 6)
    # No pair is tried twice.
    assert len({test[:2] for test in named.tests}) == len(named.tests)
    sketches, match, asked = handed(rng, sides, doubt=[6])
    back = grow_with_mirrors(sketches, match, template=0, mirror="auto")
    assert back.mirrored == {2, 4}
    assert np.flatnonzero(back.joined).tolist() == [0, 1, 2, 3, 4, 5]
    assert ((0, 0), True) in asked
    plain = grow_with_mirrors(sketches, match, template=0, mirror=None)
    assert not plain.mirrored and not plain.tests
    with pytest.raises(ValueError, match="mirror is 'back'; it is 'name' or 'auto'"):
        grow_with_mirrors(sketches, match, mirror="back")


def test_symmetric_shapes_have_no_mirror_images():
    """The mirror image of the template fits it, so nothing else is mirrored."""
    sides = np.array([1, 1, -1, 1, 1])
    sketches, match, asked = handed(np.random.default_rng(0), sides)

    def of_bodies(edges, turned):
        for (a, b), one in zip(edges, match(edges, turned), strict=True):
            yield one._replace(energy=0.2) if a == b else one

    graph = grow_with_mirrors(sketches, of_bodies, template=0)
    assert [edge for edge, turn in asked if turn] == [(0, 0)]
    assert not graph.mirrored and not graph.tests
    assert np.flatnonzero(~graph.joined).tolist() == [2]


def cubes(rng, s=3):
    """A collection of one box in other places, with its vertices in other orders."""
    box = trimesh.creation.box()
    points, faces = np.asarray(box.vertices), np.asarray(box.faces, np.int32)
    order = [np.arange(8), *(rng.permutation(8) for _ in range(s - 1))]
    meshes, members = [], []
    for i, own in enumerate(order):
        place = np.argsort(own)  # shape i's vertex of each of the template's
        meshes.append(Mesh(points[own] + i, place[faces].astype(np.int32)))
        fields = dict.fromkeys(Registration._fields) | {"vertices": points + i}
        members.append(Member(Maps(place, own), None, Registration(**fields)))
    right = {(0, i): 0.9 for i in range(1, s)}
    graph = Graph({}, [], right, best_paths(right, s, template=0), np.ones(s, bool))
    names = tuple("abcdef"[:s])
    return Collection(names, tuple(meshes), graph, tuple(members))


def test_maps_by_way_of_the_template_agree_round_all_cycles():
    found = cubes(np.random.default_rng(0))
    assert found.joined == [0, 1, 2] and found.registered.shape == (3, 8, 3)
    for x, y, z in product(range(3), repeat=3):
        onward = found.map_between(y, z)[found.map_between(x, y)]
        assert (onward == found.map_between(x, z)).all()
    x, y = found.meshes[1:]
    offset = y.vertices[found.map_between(1, 2)] - x.vertices
    np.testing.assert_allclose(offset, 1, atol=1e-12)
    np.testing.assert_allclose(found.points_between(1, 2), x.vertices + 1, atol=1e-12)
    # Boxes that differ by a shift alone do not vary.
    assert float(found.model().total_variance) < 1e-12


def test_what_was_left_out_is_named():
    found = cubes(np.random.default_rng(0))
    members = (*found.members[:2], None)
    graph = found.graph._replace(joined=np.array([True, True, False]))
    found = found._replace(members=members, graph=graph)
    assert found.joined == [0, 1]
    with pytest.raises(
        ValueError, match=r"c was left out: no trusted map .* a \(0.90\)"
    ):
        found.map_between(0, 2)
    with pytest.raises(ValueError, match="points_between: c was left out"):
        found.points_between(2, 0)
    bare = graph._replace(right={(0, 1): 0.9})
    assert reason(bare, found.names, 2) == "no pair with it could be matched"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["a"]}, "1 names for 2 shapes"),
        ({"names": ["a", "a"]}, "two shapes are named 'a'"),
        ({"template": 2}, "template is 2; it is the number of a shape, from 0 to 1"),
        ({"names": ["ball", "b"]}, "ball: has 8 vertices"),
    ],
)
def test_bad_collections_are_errors(options, message):
    box = trimesh.creation.box()
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces, np.int32))
    with pytest.raises(ValueError, match=message):
        collection([mesh, mesh], **options)
    with pytest.raises(ValueError, match="has 1 shapes; give two or more"):
        collection([mesh])
    with pytest.raises(MeshError, match="1: has no faces, and a collection registers"):
        collection([testing.blob(0), mesh._replace(faces=mesh.faces[:0])])
