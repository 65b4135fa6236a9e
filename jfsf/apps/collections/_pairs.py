"""What is kept of each shape, and which pairs are matched: a sparse graph.

Pairs are chosen from the spectra alone. A tree reaches all shapes. Further pairs close
triangles, because a wrong map shows itself where the maps round a triangle disagree
(`_cycles`).
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from jfsf.spectral._sampling import biharmonic, rms_distance
from jfsf.types import ArrayLike, Spectrum

SIGNATURE = 30  # eigenvalues: how a shape differs from others as a whole
_GROWTH = 4 * np.pi * SIGNATURE


class Sketch(NamedTuple):
    """What tells a shape from others, and how far apart its vertices are.

    signature: square roots of eigenvalues, in units of their mean growth (Weyl's law).
        The shape has area 1, so size plays no part; nor does the pose (Reuter et al.
        2006, "Laplace-Beltrami spectra as Shape-DNA").
    points: their Euclidean distance is the biharmonic one; that of two random vertices
        has root mean square 1.
    mass: of the vertices, sums to 1.
    """

    signature: Float[ArrayLike, " f"]
    points: Float[ArrayLike, "n d"]
    mass: Float[ArrayLike, " n"]


def sketch(spec: Spectrum) -> Sketch:
    """Of a spectrum without padding, from `jfsf.basis`. In float32."""
    points = biharmonic(spec)
    unit = float(rms_distance(points, spec.mass))
    evals = np.maximum(np.asarray(spec.evals)[1 : SIGNATURE + 1], 0)
    numbers = (
        np.sqrt(evals / _GROWTH),
        np.asarray(points) / unit,
        np.asarray(spec.mass),
    )
    return Sketch(*(np.asarray(values, np.float32) for values in numbers))


def evals_of(
    signature: Float[ArrayLike, " f"],
) -> Float[np.ndarray, " f"]:
    """The eigenvalues of a signature, from the first that is not 0 on, at area 1."""
    return _GROWTH * np.asarray(signature, float) ** 2


Edge = tuple[int, int]  # numbers of two shapes, the smaller one first


def unlikeness(
    signatures: Sequence[Float[ArrayLike, " f"]],
) -> Float[np.ndarray, "s s"]:
    """Unlikeness of each two shapes: root mean square difference of signatures."""
    rows = np.stack([np.asarray(row) for row in signatures])
    return cdist(rows, rows) / np.sqrt(rows.shape[1])


def first_pairs(unlike: Float[ArrayLike, "s s"]) -> list[Edge]:
    """A tree of the most alike pairs, and a triangle on each of its branches.

    Args:
        unlike: symmetric, see `unlikeness`.

    Returns:
        Sorted; s - 1 pairs of the tree, and at most as many again.
    """
    unlike = np.asarray(unlike, float)
    # A zero would be no edge to scipy.
    tree = minimum_spanning_tree(unlike + 1e-12).tocoo()
    branches = [edge_of(a, b) for a, b in zip(tree.row, tree.col, strict=True)]
    found: set[Edge] = set()
    near: dict[int, set[int]] = {i: set() for i in range(len(unlike))}

    def add(edge: Edge):
        a, b = edge
        found.add(edge)
        near[a].add(b)
        near[b].add(a)

    for branch in branches:
        add(branch)
    for a, b in sorted(branches):
        # Pairs that make a triangle of the branch and a pair next to it.
        closing = {edge_of(c, b) for c in near[a] - {b}}
        closing |= {edge_of(c, a) for c in near[b] - {a}}
        if closing and not found & closing:
            add(min(closing, key=lambda edge: (unlike[edge], edge)))
    return sorted(found)


def more_pairs(
    unlike: Float[ArrayLike, "s s"],
    tried: Collection[Edge],
    sure: Collection[int],
    *,
    most: int,
    most_of_one: int,
    each: int = 2,
) -> list[Edge]:
    """Pairs for the shapes that no sure map has reached yet.

    Args:
        unlike: symmetric, see `unlikeness`.
        tried: pairs that were matched.
        sure: shapes that sure maps reach.
        most: pairs in all.
        most_of_one: a shape of so many tried pairs gets no more: it may fit none.
        each: pairs for each of the other shapes: with those of the sure ones that close
            the most triangles with pairs that were tried, and of these the most alike.

    Returns:
        Sorted; empty when no shape is left that may get more.
    """
    unlike, found = np.asarray(unlike, float), {}
    near: dict[int, set[int]] = {i: {i} for i in range(len(unlike))}
    for a, b in tried:
        near[a].add(b)
        near[b].add(a)
    for a in sorted(set(range(len(unlike))) - set(sure)):
        left = [b for b in sure if b not in near[a]]
        left.sort(key=lambda b: (-len(near[a] & near[b]), unlike[a, b], b))
        number = min(each, most_of_one + 1 - len(near[a]))  # it is near to itself
        for b in left[: max(number, 0)]:
            found[edge_of(a, b)] = unlike[a, b]
    return sorted(sorted(found, key=lambda edge: (found[edge], edge))[:most])


def edge_of(a, b) -> Edge:
    """The edge between two shapes."""
    return (int(min(a, b)), int(max(a, b)))
