"""Mirror images in a collection: left and right bones in one folder.

Pairs whose map is not trusted are matched again with one shape mirrored. So are shapes
that no trusted map reaches, or that are on the other side by the votes of all pairs
(`sides`), with shapes on the side of the template. Where such a map is trusted, and has
far less energy, it votes for the other side.

Of shapes that are symmetric, such as bodies, none is a mirror image: the mirror image
of the template fits the template, so nothing else is tried.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from jfsf.apps.collections._cycles import Edge, Sketch, edge_of, unlikeness
from jfsf.apps.collections._grow import (
    PAIRS_A_SHAPE,
    TRUSTED,
    Graph,
    Matched,
    MirrorTest,
    grow,
)
from jfsf.apps.collections._sides import sides, votes
from jfsf.types import ArrayLike

Mirror = Literal["name", "auto"]
# Matches pairs; of each a truth value says whether X is to be mirrored first.
MatchPairs = Callable[[list[Edge], list[bool]], Iterable[Matched | None]]
PARTNERS = 2  # of each shape that is tried
# Energy below which a shape and its mirror image are the same. By hand: templates of
# bodies have 0.1 to 0.2 (FAUST, `bench_collection`), molars and heel bones 0.39 to
# 0.74.
SYMMETRIC = 0.25


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
    old = range(0 if frozen is None else len(frozen) + 1)
    doubt = _doubtful(graph, old)
    if (not doubt and graph.joined.all()) or _is_symmetric(graph.paths.template, match):
        return graph
    graph = graph._replace(tests=_tested(graph, doubt, match))
    unlike = unlikeness([one.signature for one in sketches])
    while new := [
        pair
        for pair in suspects(graph, unlike)
        if pair[0] not in {*old, *(test.shape for test in graph.tests)}
    ]:
        tests = _tested(graph, new, match)
        if not tests:
            break
        graph = graph._replace(tests=graph.tests + tests)
    found = mirror_images(graph) - set(old)
    if not found:
        return graph
    tests = graph.tests
    one_of = lambda edges: [(a in found) != (b in found) for a, b in edges]
    graph = grow(
        sketches,
        lambda edges: match(edges, one_of(edges)),
        template=graph.paths.template,
        **options,
    )
    found = found & frozenset(np.flatnonzero(graph.joined).tolist())
    if mirror == "name":
        graph = graph._replace(joined=graph.joined & ~_mask(found, len(sketches)))
    return graph._replace(tests=tests, mirrored=found)


def _doubtful(graph: Graph, old: Collection[int]) -> list[tuple[int, int]]:
    """Pairs whose map is not trusted, the shape that is less sure first.

    None of two old shapes, and of old ones none is first.
    """
    less_sure = lambda i: (i in old, graph.paths.trust[i], -i)
    return [
        (min(edge, key=less_sure), max(edge, key=less_sure))
        for edge, one in sorted(graph.matched.items())
        if not (one.confidence >= TRUSTED or set(edge) <= set(old))
    ]


def _is_symmetric(shape: int, match: MatchPairs) -> bool:
    """Whether the mirror image of a shape is the same shape, as that of a body."""
    known = _known([(shape, shape)], True, match)
    return any(one.energy < SYMMETRIC for one in known.values())


def suspects(graph: Graph, unlike: Float[ArrayLike, "s s"]) -> list[tuple[int, int]]:
    """Shapes whose mirror images are to be tried, each with `PARTNERS` others.

    Those that are on the other side by the votes, and those that are not joined. The
    partners are joined and on the side of the template: first those that vote for the
    other side, then the most alike.

    Args:
        graph: of `grow`.
        unlike: symmetric, see `unlikeness`.
    """
    vote = votes(graph.matched, graph.tests)
    other, unlike = _other_side(graph), np.asarray(unlike)
    inside = np.flatnonzero(graph.joined & ~other).tolist()
    found = []
    for i in np.flatnonzero(~graph.joined | other).tolist():
        near = sorted(
            inside, key=lambda j: (min(vote.get(edge_of(i, j), 0), 0), unlike[i, j], j)
        )
        found += [(i, j) for j in near[:PARTNERS]]
    return found


def check_mirror(mirror: Mirror) -> None:
    """ValueError for another word."""
    if mirror not in get_args(Mirror):
        raise ValueError(f"collection: mirror is {mirror!r}; it is 'name' or 'auto'")


def mirror_images(graph: Graph) -> frozenset[int]:
    """Numbers of the shapes that are mirror images of the template, see `sides`."""
    return frozenset(np.flatnonzero(_other_side(graph)).tolist())


def _other_side(graph: Graph) -> np.ndarray:
    vote = votes(graph.matched, graph.tests)
    return sides(vote, len(graph.joined), graph.paths.template) < 0


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
