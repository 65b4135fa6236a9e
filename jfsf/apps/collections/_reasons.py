"""Why a shape does not belong to a collection, in a sentence."""

from collections.abc import Sequence

from jfsf.apps.collections._grow import Graph


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
        f"confidence {best.turned:.2f}; as it is, with {best.straight:.2f}, sheared "
        f"{best.ratio:.1f} times as much"
    )
