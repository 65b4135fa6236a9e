"""What a collection asks of a runner: each pair once, ways, and trusted maps."""

from types import SimpleNamespace

import numpy as np
import pytest

from jfsf.apps.cli import _collection_onto
from jfsf.apps.cli._collection_runner import OnFiles
from jfsf.apps.cli._collection_templates import put_others
from jfsf.apps.collections._cycles import Sketch
from jfsf.apps.collections._engine import join_shapes, mirrored, put_on_all
from jfsf.apps.collections._grow import Matched, MirrorTest, best_paths
from jfsf.types import Maps

N = 40


class Recorder:
    """Shapes of one cloud, those of side -1 mirrored; maps between others are wrong.

    asked: the pairs, and whether they were turned.
    broken: shapes on which the template cannot be put.
    """

    def __init__(self, sides, broken=()):
        self.rng, self.sides, self.broken = np.random.default_rng(0), sides, broken
        self.asked, self.ways, self.maps, self.graphs = [], {}, {}, []
        points, mass = self.rng.normal(size=(N, 60)) / 11, np.full(N, 1 / N)
        signatures = self.rng.uniform(size=(len(sides), 30))
        self.sketches = [Sketch(own, points, mass) for own in signatures]

    def match(self, edges, turned):
        self.asked += [(edge, turned) for edge in edges]
        found = []
        for a, b in edges:
            good = self.sides[a] * self.sides[b] == (-1 if turned else 1)
            T = np.arange(N) if good else self.rng.permutation(N)
            figures = (0.99, 0.1) if good else (0.2, 0.5)
            found.append(Matched(Maps(T, np.argsort(T)), *figures))
        found[0] = None if edges[0] == (0, 1) else found[0]  # it cannot be matched
        return found

    def place(self, graph, ways):
        self.ways = ways
        self.graphs.append(graph)
        return {i: "it is broken" for i in self.broken}

    def agree(self, graph, maps):
        self.maps = maps
        self.graphs.append(graph)
        return {}


def test_each_pair_is_matched_once_and_ways_lead_to_all_that_joined():
    runner = Recorder([1, 1, -1, 1, -1, 1])
    graph, failed = join_shapes(runner.sketches, runner, template=0, mirror="auto")
    assert len(runner.asked) == len(set(runner.asked))
    assert any(turned for _, turned in runner.asked)
    assert graph.mirrored_back == graph.mirrored == {2, 4}
    assert graph.joined.all() and failed == {} and (0, 1) not in graph.matched
    assert list(runner.ways) == list(runner.maps) == list(range(6))
    for T in runner.ways.values():
        np.testing.assert_array_equal(T, np.arange(N))
    assert all(own is graph for own in runner.graphs)
    assert runner.maps[0] == []
    for i in range(1, 6):
        assert [j for j, _ in runner.maps[i]] == [j for j, _ in graph.trusted_maps(i)]


def test_what_failed_is_no_way_to_others():
    runner = Recorder([1] * 5, broken=[3])
    graph, failed = join_shapes(runner.sketches, runner, template=0)
    assert failed == {3: "it is broken"} and graph.joined.all()
    assert list(runner.maps) == [0, 1, 2, 4]
    known = {i: [j for j, _ in graph.trusted_maps(i)] for i in runner.maps}
    assert any(3 in near for near in known.values())
    for i in (1, 2, 4):
        assert [j for j, _ in runner.maps[i]] == [j for j in known[i] if j != 3]


@pytest.mark.parametrize(
    ("options", "left_out", "turned"),
    [
        ({}, {2}, True),  # named
        ({"orientation": "any", "mirror": "auto"}, {2}, False),  # not looked for
    ],
)
def test_mirror_images_that_do_not_join_stay_as_they_are(options, left_out, turned):
    runner = Recorder([1, 1, -1, 1, 1])
    graph, _ = join_shapes(runner.sketches, runner, template=0, **options)
    assert graph.mirrored_back == frozenset()
    assert set(range(5)) - set(runner.ways) == left_out
    assert any(turn for _, turn in runner.asked) == turned


def test_other_templates_are_the_most_central_shapes_that_joined():
    runner = Recorder([1, 1, -1, 1, 1])
    graph, _ = join_shapes(runner.sketches, runner, template=0)
    assert graph.mirrored == {2} and sorted(graph.central) == [0, 1, 3, 4]
    assert graph.central[0] == best_paths(graph.right, 5).template
    for i in graph.central:
        own = graph.with_template(i)
        assert own.paths.template == i and own.matched is graph.matched
        assert np.flatnonzero(own.joined).tolist() == [0, 1, 3, 4]
        assert put_on_all(runner.sketches, own, runner) == {}
        assert sorted(runner.ways) == [0, 1, 3, 4] and runner.maps[i] == []
        np.testing.assert_array_equal(runner.ways[i], np.arange(N))


def test_those_that_are_named_come_first_and_mirror_images_not_at_all(tmp_path):
    runner = Recorder([1, 1, -1, 1, 1, 1])
    graph, _ = join_shapes(runner.sketches, runner, template=0, mirror="auto")
    sketches = zip("abcdef", runner.sketches, strict=True)
    shapes = {name: SimpleNamespace(sketch=own) for name, own in sketches}
    folders = []

    def run(jobs, *, label, **_):
        folders.append((label, jobs[0].out.parent.parent.name))
        assert all((tmp_path / "shapes") in path.parents for path in jobs[0].inputs[:2])
        failed = {job.out: job.out.parts[-2:] == ("placed", "e.npz") for job in jobs}
        return {path: "it is broken" if bad else None for path, bad in failed.items()}

    on_files = OnFiles(tmp_path, list("abcdef"), "preserve", True, run)
    put = lambda most, named=(): put_others(shapes, graph, on_files, most, named)
    names = [on_files.names[i] for i in graph.central if i not in (0, 2)]
    assert put(0) == [] and not folders
    earlier = [tmp_path / f"templates/b/registered/{name}.npz" for name in "ef"]
    earlier[0].parent.mkdir(parents=True)
    for path in earlier:
        path.touch()
    assert put(2) == names[:2] and put(9) == names
    assert set(folders) == {("other templates", name) for name in names}
    assert [path.exists() for path in earlier] == [False, True]
    assert put(1, ["a", "c", *names[-2:]]) == names[-2:]
    assert put(3, names[-1:]) == [names[-1], *names[:2]]


@pytest.mark.parametrize(
    ("side", "mirror", "mirrored"), [(1, "auto", False), (-1, "auto", True)]
)
def test_a_new_shape_joins_a_frozen_collection_and_nothing_else_is_made(
    side, mirror, mirrored
):
    own = np.arange(N)
    # The second map is in doubt, as that of a mirror image: it is not looked at again.
    frozen = [Matched(Maps(own, own), sure) for sure in (0.98, 0.8, 0.98)]
    runner = Recorder([1, 1, 1, 1, side])
    graph, failed = join_shapes(runner.sketches, runner, mirror=mirror, frozen=frozen)
    assert failed == {} and graph.paths.template == 0
    # The template with its own mirror image, and pairs of the new one.
    asked = [(edge, turn) for edge, turn in runner.asked if edge != (0, 0)]
    assert all(b == 4 for (_, b), _ in asked) and ((0, 4), False) in asked
    assert list(runner.ways) == list(runner.maps) == [4]
    assert graph.mirrored_back == ({4} if mirrored else set())
    np.testing.assert_array_equal(runner.ways[4], own)
    assert {0} < {j for j, _ in runner.maps[4]} <= {0, 1, 2, 3}


def test_a_mirror_image_does_not_join_a_frozen_collection_as_it_is():
    own = np.arange(N)
    runner = Recorder([1, 1, 1, -1])
    frozen = [Matched(Maps(own, own), 0.98)] * 2
    graph, _ = join_shapes(runner.sketches, runner, frozen=frozen)
    assert runner.ways == {} and graph.mirrored == {3}
    assert graph.joined.tolist() == [True, True, True, False]


def test_what_was_tried_of_a_new_shape_beside_its_pairs_is_told(monkeypatch):
    monkeypatch.setattr(_collection_onto, "kept", lambda path: "template")
    trust = {"a": 1.0, "b": 0.9, "c": 0.9}
    frozen = SimpleNamespace(template="a", trust=trust, kept_template=None)
    test = ["c", 0.1, 0.98, 0.3]  # no pair of the new one
    own = {"trust": 0.9, "joined": True, "mirrored": True, "failed": None}
    own |= {"before": "a", "pairs": [["a", 0.2, 0.3]], "triangles": [], "tests": [test]}
    shapes, graph, _ = _collection_onto._together(
        frozen, {"new": None}, {"new": own}, {}
    )
    names = ["new", "a", "c"]
    assert set(shapes) == set(names) and graph.paths.template == 1
    assert graph.tests == (MirrorTest(0, 2, 0.1, 0.98, 0.3),)
    assert "mirrored, it fits c with confidence 0.98" in mirrored(graph, names, 0)
