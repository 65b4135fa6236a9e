"""The steps of a collection, from sketches to the template on every shape.

Here is decided which pairs are matched, which shapes join, which are mirrored back, and
which ways lead from the template to each. The work itself is that of a `Runner`: on
meshes in memory (`collection`), or on files (`jfsf collection`).

`reason` says why a shape was left out.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from jaxtyping import Int

from jfsf.apps.collections._cycles import Edge, Sketch
from jfsf.apps.collections._grow import PAIRS_A_SHAPE, Graph, Matched, map_along
from jfsf.apps.collections._mirror import MatchPairs, Mirror, grow_with_mirrors
from jfsf.initial._search import Orientation
from jfsf.types import ArrayLike


def reason(graph: Graph, names: Sequence[str], shape: int) -> str:
    """Why a shape was left out, in a sentence.

    Args:
        graph: the graph of the collection.
        names: the names of its shapes.
        shape: the number, from 0, of a shape that was left out.
    """
    tests = [test for test in graph.tests if test.shape == shape]
    if shape in graph.mirrored:
        said = mirrored(graph, names, shape)
        return f"it is {said}; mirror='auto' (--mirror auto) mirrors it back"
    own = {edge: p for edge, p in graph.right.items() if shape in edge}
    if not own:
        return "no pair with it could be matched"
    tried = ", ".join(
        f"{names[a + b - shape]} ({p:.2f})" for (a, b), p in sorted(own.items())
    )
    mirror = ", nor to its mirror image" if tests else ""
    return (
        f"no trusted map leads to it{mirror}; the probability of its maps, with the "
        f"shapes that were tried: {tried}"
    )


def mirrored(graph: Graph, names: Sequence[str], shape: int) -> str:
    """That a shape is a mirror image, and how that is known: not a whole sentence.

    Args:
        graph, names: as `reason`.
        shape: one of `Graph.mirrored`.
    """
    tests = [t for t in graph.tests if t.shape == shape and t.mirrors]
    if not tests:
        return "a mirror image of the others, joined by way of another mirror image"
    best = max(tests, key=lambda test: test.turned)
    return (
        f"a mirror image of the others: mirrored, it fits {names[best.partner]} with "
        f"confidence {best.turned:.2f}; as it is, with {best.straight:.2f} and "
        f"{best.energy_gap:.2f} more energy"
    )


class Runner(Protocol):
    """Does the work of a collection. Shapes are named by their numbers."""

    def match(self, edges: list[Edge], turned: bool) -> Sequence[Matched | None]:
        """Match pairs of shapes.

        Args:
            edges: the pairs, each of them new.
            turned: whether X of each pair is mirrored first.

        Returns:
            In the order of the pairs; None for one that cannot be matched.
        """
        ...

    def place(
        self, graph: Graph, ways: Mapping[int, Int[ArrayLike, " n"]]
    ) -> dict[int, str]:
        """Put the template on each joined shape.

        Args:
            graph: has the template, and the shapes whose meshes are mirrored before
                (`mirrored_back`).
            ways: the vertex of the shape for each vertex of the template; the identity
                for the template itself.

        Returns:
            Why it cannot be put on some shapes.
        """
        ...

    def agree(
        self,
        graph: Graph,
        maps: Mapping[int, Sequence[tuple[int, Int[ArrayLike, " m"]]]],
    ) -> dict[int, str]:
        """Put the template on each shape once more, by way of other shapes too.

        Args:
            graph: that `place` was called with.
            maps: of each shape on which the template was placed, other such shapes and
                the trusted maps from these to it; none for the template itself.

        Returns:
            Why it cannot be put on some shapes.
        """
        ...


def join_shapes(
    sketches: Sequence[Sketch],
    runner: Runner,
    *,
    template: int | None = None,
    orientation: Orientation = "preserve",
    mirror: Mirror = "name",
    pairs_a_shape: float = PAIRS_A_SHAPE,
    frozen: Sequence[Matched] | None = None,
) -> tuple[Graph, dict[int, str]]:
    """Match pairs of shapes, and put one of them, the template, onto all others.

    Args:
        sketches: of each shape.
        runner: does the work, and keeps or writes what it makes.
        template, orientation, mirror: as `collection`.
        pairs_a_shape: as `CollectionSettings`.
        frozen: as `grow`: of the template and these shapes nothing is made, and the
            runner has the template on them.

    Returns:
        The graph, and why the template could not be put on some joined shapes.

    Raises:
        ValueError: as `grow_with_mirrors`.
    """
    graph = grow_with_mirrors(
        sketches,
        _each_once(runner),
        mirror=mirror if orientation == "preserve" else None,
        template=template,
        pairs_a_shape=pairs_a_shape,
        frozen=frozen,
    )
    old = 0 if frozen is None else len(frozen) + 1
    return graph, put_on_all(sketches, graph, runner, old=old)


def put_on_all(
    sketches: Sequence[Sketch], graph: Graph, runner: Runner, *, old: int = 0
) -> dict[int, str]:
    """Put the template of a graph onto all joined shapes.

    Args:
        sketches, runner: as `join_shapes`.
        graph: of these shapes.
        old: so many of them, the first, have it already.

    Returns:
        Why it could not be put on some of them.
    """
    base = graph.paths.template
    joined = np.flatnonzero(graph.joined).tolist()
    itself, maps = np.arange(len(sketches[base].mass)), graph.maps
    way = lambda i: itself if i == base else map_along(maps, graph.paths.way(i))
    failed = runner.place(graph, {i: way(i) for i in joined if i >= old})
    placed = set(joined) - set(failed)
    others = lambda i: [(j, T) for j, T in graph.trusted_maps(i) if j in placed]
    new = sorted(placed - set(range(old)))
    known = {i: [] if i == base else others(i) for i in new}
    return failed | runner.agree(graph, known)


def _each_once(runner: Runner) -> MatchPairs:
    """What matches the pairs that were not matched before."""
    known: dict[tuple[Edge, bool], Matched | None] = {}

    def match_pairs(edges, turned):
        pairs = list(zip(edges, turned, strict=True))
        for turn in (False, True):
            new = [e for e, own in pairs if own == turn and (e, own) not in known]
            if new:
                outcomes = zip(new, runner.match(new, turn), strict=True)
                known.update(((edge, turn), one) for edge, one in outcomes)
        return [known[pair] for pair in pairs]

    return match_pairs
