"""Mirror images in a collection: left and right bones in one folder.

Matching keeps left and right, so the map to a mirror image is in doubt, and mostly says
that its own mirror image is likely. The mirror image of such a shape is matched with
the same partner. If that map is trusted, and has far less energy, the shape is a mirror
image of its partner.

A body in a mirrored pose is none: a pose keeps distances, so both maps have nearly the
same energy. A shape that is its own mirror image fits its partner as well either way.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from jfsf.apps.collections._cycles import Edge, Sketch, edge_of, unlikeness
from jfsf.apps.collections._grow import (
    PAIRS_A_SHAPE,
    SURE,
    Graph,
    Matched,
    MirrorTest,
    grow,
)
from jfsf.matching._confidence import MIRRORED
from jfsf.types import ArrayLike

Mirror = Literal["name", "auto"]
# Matches pairs; of each a truth value says whether X is to be mirrored first.
MatchPairs = Callable[[list[Edge], list[bool]], Iterable[Matched | None]]
PARTNERS = 2  # of a shape that is not joined


def grow_with_mirrors(
    sketches: Sequence[Sketch],
    match: MatchPairs,
    *,
    mirror: Mirror | None = "name",
    template: int | None = None,
    pairs_a_shape: float = PAIRS_A_SHAPE,
    frozen: Sequence[Matched] | None = None,
) -> Graph:
    """`grow`, and find the shapes that are mirror images of the others.

    Args:
        sketches, template, pairs_a_shape, frozen: as `grow`.
        match: as that of `grow`, with one truth value more a pair: whether X is to be
            mirrored. To mirror Y in its place makes the same map.
        mirror: what is done with mirror images. "name" leaves them out; "auto" takes
            their mirror images in their place; with None they are not looked for.

    Returns:
        The graph. `mirrored` holds the numbers of the mirror images, and `tests` what
        they were found by. With "auto" its maps are those of shapes mirrored back.

    Raises:
        ValueError: as `grow`, or another word for `mirror`.
    """
    if mirror is not None:
        check_mirror(mirror)
    plain = lambda edges: match(edges, [False] * len(edges))
    options = {"pairs_a_shape": pairs_a_shape, "frozen": frozen}
    graph = grow(sketches, plain, template=template, **options)
    if mirror is None:
        return graph
    unlike = unlikeness([one.signature for one in sketches])
    first = 0 if frozen is None else len(frozen) + 1
    tried = [pair for pair in suspects(graph, unlike) if pair[0] >= first]
    tests = _tested(graph, tried, match)
    found = mirror_images(graph, tests)
    if not found:
        return graph._replace(tests=tests)
    if mirror == "auto":
        one_of = lambda edges: [(a in found) != (b in found) for a, b in edges]
        graph = grow(
            sketches,
            lambda edges: match(edges, one_of(edges)),
            template=graph.paths.template,
            **options,
        )
        found = found & frozenset(np.flatnonzero(graph.joined).tolist())
    else:
        graph = graph._replace(joined=graph.joined & ~_mask(found, len(sketches)))
    return graph._replace(tests=tests, mirrored=found)


def suspects(graph: Graph, unlike: Float[ArrayLike, "s s"]) -> list[tuple[int, int]]:
    """Shapes whose mirror images are to be tried, each with a partner.

    A map between two shapes may say that its mirror image is likely right. Then the one
    whose way is less sure is tried with the other, even if it has joined by another
    map: that may be wrong, unless it is sure. A shape that is not joined is tried with
    `PARTNERS`: first those of such maps, then the most alike.

    Args:
        graph: of `grow`.
        unlike: symmetric, see `unlikeness`.
    """
    inside, unlike = _surest_first(graph), np.asarray(unlike)
    order = {j: n for n, j in enumerate(inside)}
    likely: dict[int, dict[int, float]] = {}
    for pair, one in graph.matched.items():
        partner, i = sorted(pair, key=lambda j: order.get(j, len(order)))
        if one.mirrored > MIRRORED and partner in order:
            likely.setdefault(i, {})[partner] = one.mirrored
    found = []
    for i in np.flatnonzero(~graph.joined | (graph.paths.trust < SURE)).tolist():
        own = likely.get(i, {})
        among = list(own) if graph.joined[i] else inside
        near = sorted(among, key=lambda j: (-own.get(j, 0), unlike[i, j], j))
        found += [(i, j) for j in near[: 1 if graph.joined[i] else PARTNERS]]
    return found


def check_mirror(mirror: Mirror) -> None:
    """ValueError for another word."""
    if mirror not in get_args(Mirror):
        raise ValueError(f"collection: mirror is {mirror!r}; it is 'name' or 'auto'")


def mirror_images(graph: Graph, tests: Sequence[MirrorTest]) -> frozenset[int]:
    """Numbers of the shapes that are mirror images of the template.

    A shape is the mirror image of its partner if the map of its mirror image is
    trusted, and has so much less energy that it is likely right instead
    (`mirror_probability`). Others are as the shape before them on their way.

    Args:
        graph: of `grow`.
        tests: of `suspects`. Of two of one shape the surer counts.
    """
    turned: dict[int, MirrorTest] = {}
    for test in sorted(tests, key=lambda test: test.turned):
        if test.mirrors:
            turned[test.shape] = test
    mirrored = np.zeros(len(graph.joined), bool)
    alone = [i for i in turned if not graph.joined[i]]
    for i in [*_surest_first(graph), *alone]:
        if i in turned:
            mirrored[i] = not mirrored[turned[i].partner]
        elif i != graph.paths.template:
            mirrored[i] = mirrored[graph.paths.before[i]]
    return frozenset(np.flatnonzero(mirrored).tolist())


def _surest_first(graph: Graph) -> list[int]:
    """The joined shapes, each after the one before it on its way."""
    paths, inside = graph.paths, np.flatnonzero(graph.joined).tolist()
    return sorted(inside, key=lambda i: (-paths.trust[i], len(paths.way(i))))


def _tested(graph: Graph, pairs, match: MatchPairs) -> tuple[MirrorTest, ...]:
    """The tests of these pairs, but for those that could not be matched."""
    edges = sorted({edge_of(*pair) for pair in pairs})
    new = [edge for edge in edges if edge not in graph.matched]
    straight = graph.matched | _known(new, False, match)
    turned = _known(edges, True, match)
    found = []
    for shape, partner in pairs:
        one, other = (maps.get(edge_of(shape, partner)) for maps in (straight, turned))
        if one is not None and other is not None:
            sure, gap = (one.confidence, other.confidence), one.energy - other.energy
            found.append(MirrorTest(shape, partner, *sure, gap))
    return tuple(found)


def _known(edges, turned: bool, match: MatchPairs) -> dict[Edge, Matched]:
    if not edges:
        return {}
    outcomes = zip(edges, match(edges, [turned] * len(edges)), strict=True)
    return {edge: one for edge, one in outcomes if one is not None}


def _mask(numbers, s: int) -> np.ndarray:
    return np.isin(np.arange(s), sorted(numbers))
