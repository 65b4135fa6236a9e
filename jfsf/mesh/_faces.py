"""Pairs of neighbouring faces, the pieces they make, and faces that are there twice.

Neighbours share an edge of two faces, or lie beside each other in the fan around an
edge of three faces or more and continue each other.

Of a face that is there twice by mistake one belongs to the surface. Two faces that lie
back to back as a flap on a closed surface both go: one alone would be a fin, whose
edge has three faces. Edges tell which is which.
"""

from typing import Any, NamedTuple

import numpy as np

from jfsf.mesh._geometry import HalfEdgePairs, components, edge_keys, face_areas
from jfsf.types import ArrayLike

# Two faces of a fan continue each other if the cosine of the angle by which the second
# leaves the plane of the first is above this. Three faces at 120 degrees have 0.5.
CONTINUES = 0.6
# Share of the area that neighbouring pairs of faces back to back have at most. More is
# no flaw but a membrane that was meant, and one face of each pair is kept.
LARGEST_FLAP = 0.01


class Links(NamedTuple):
    """Pairs of neighbouring nodes: their numbers, whether they clash, the weight."""

    left: Any
    right: Any
    clash: Any
    weight: Any


def across_edges(vertices, faces, pairs: HalfEdgePairs) -> Links:
    """Faces that share an edge with two faces, weighted by its length."""
    left, right = pairs.left[pairs.manifold], pairs.right[pairs.manifold]
    tail, head = faces.ravel()[left], np.roll(faces, -1, axis=1).ravel()[left]
    length = np.linalg.norm(vertices[head] - vertices[tail], axis=1)
    return Links(left // 3, right // 3, pairs.clash[pairs.manifold], length)


def in_fans(vertices, faces, pairs: HalfEdgePairs) -> Links:
    """Neighbours in the fan around an edge of three faces or more that continue."""
    chain = ~pairs.manifold
    half = np.unique(np.concatenate([pairs.left[chain], pairs.right[chain]]))
    if not len(half):
        none = np.zeros(0, np.int64)
        return Links(none, none, none.astype(bool), none.astype(float))
    tail, head, apex = (
        np.roll(faces, -i, axis=1).ravel()[half].astype(np.int64) for i in range(3)
    )
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    edge = np.unique(low * len(vertices) + high, return_inverse=True)[1]
    along = vertices[high] - vertices[low]
    length = np.linalg.norm(along, axis=1)
    along = along / np.where(length > 0, length, 1)[:, None]
    out = vertices[apex] - vertices[low]
    out = out - (out * along).sum(1, keepdims=True) * along
    size = np.linalg.norm(out, axis=1, keepdims=True)
    out = out / np.where(size > 0, size, 1)
    # Angles from the first face of each fan on.
    start = out[np.unique(edge, return_index=True)[1]][edge]
    angle = np.arctan2((np.cross(along, start) * out).sum(1), (start * out).sum(1))
    order = np.lexsort((half, angle, edge))
    edge, half, out = edge[order], half[order], out[order]
    # The next face around; the last one's is the first.
    begin = np.flatnonzero(np.diff(edge, prepend=-1))
    following = np.arange(1, len(edge) + 1)
    following[np.append(begin[1:], len(edge)) - 1] = begin
    flat = -(out * out[following]).sum(axis=1)
    pair = flat > CONTINUES
    clash = tail[order] == tail[order][following]
    weight = length[order] * flat
    return Links(half[pair] // 3, half[following][pair] // 3, clash[pair], weight[pair])


def joined(one: Links, two: Links) -> Links:
    """All links of both."""
    return Links(*(np.concatenate(both) for both in zip(one, two, strict=True)))


def two_sheets(num: int, links: Links) -> tuple[Any, Any]:
    """Components of a graph with two nodes each: as it is, and turned over.

    It joins neighbours that are wound alike. A two-sided piece gives two components,
    each the other turned over; a one-sided piece gives one.
    """
    left, right, clash = links.left, links.right, links.clash
    fits = right + num * clash, right + num * ~clash
    both = components(2 * num, np.concatenate([left, left + num]), np.concatenate(fits))
    return both[:num], both[num:]


def between_nodes(links: Links, node, turn) -> Links:
    """The links of faces that are not of one node, when some of them are turned."""
    left, right = node[links.left], node[links.right]
    clash = links.clash ^ turn[links.left] ^ turn[links.right]
    apart = left != right
    return Links(left[apart], right[apart], clash[apart], links.weight[apart])


class Doubled(NamedTuple):
    """Which faces have the vertices of others, and which are kept.

    first: (m,) the lowest face with the same vertices.
    rank: (m,) how many of those are before this face.
    keep: (m,) whether the surface is better with this face than without it. Faces that
        are there once are kept; of others one or none, or the odd one out.
    crowded: (m,) whether the face has copies, and one of its edges, or of the
        neighbouring copies', has three faces or more.
    """

    first: Any
    rank: Any
    keep: Any
    crowded: Any


def doubled_faces(vertices: ArrayLike, faces: ArrayLike) -> Doubled:
    """Find the faces that are there more than once, and decide which to keep.

    Neighbouring ones are decided together. One of each is kept, unless without them the
    edges that have one face, or three and more, are shorter in sum.

    Args:
        vertices: (n, 3).
        faces: (m, 3), none of which repeats a vertex.
    """
    m = len(faces)
    ordered = np.sort(faces, axis=1)
    order = np.lexsort(ordered.T[::-1])
    ordered = ordered[order]
    new = np.ones(m, bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    start = np.flatnonzero(new)
    group = np.cumsum(new) - 1
    first, rank = np.empty(m, np.int64), np.empty(m, np.int64)
    first[order] = order[start][group]
    rank[order] = np.arange(m) - start[group]
    copies = np.bincount(first, minlength=m)
    lowest = np.flatnonzero(copies > 1)
    if not len(lowest):
        return Doubled(first, rank, np.ones(m, bool), np.zeros(m, bool))
    edge = np.unique(edge_keys(faces, len(vertices)), return_inverse=True)[1]
    edge = edge.reshape(m, 3)
    counts = np.bincount(edge.ravel())
    # Neighbours among the lowest copies: a graph of these faces and of the edges.
    node = np.arange(len(lowest))
    sides = edge[lowest]
    patch = components(
        len(node) + len(counts), np.repeat(node, 3), len(node) + sides.ravel()
    )
    patch = np.unique(patch[node], return_inverse=True)[1]
    num = patch.max() + 1
    # Each edge of a patch, its length, and its faces under either choice.
    at, back = np.unique(sides.ravel(), return_index=True)
    owner = patch[back // 3]
    tail = faces[lowest].ravel()[back]
    head = np.roll(faces[lowest], -1, axis=1).ravel()[back]
    length = np.linalg.norm(vertices[tail] - vertices[head], axis=1)
    flaw = lambda left: length * np.where(left == 0, 0, np.abs(left - 2))
    many = copies[lowest]

    def flaws(kept):
        lost = np.bincount(sides.ravel(), np.repeat(many - kept, 3), len(counts))
        return np.bincount(owner, flaw(counts[at] - lost[at]), num)

    area = np.bincount(patch, face_areas(vertices, faces[lowest]), num)
    total = face_areas(vertices, faces[rank == 0]).sum()
    fewer = flaws(many % 2) < flaws(np.ones_like(many)) * (1 - 1e-9)
    fewer &= area <= LARGEST_FLAP * total
    left = np.ones(m, np.int64)
    left[lowest] = np.where(fewer[patch], many % 2, 1)
    crowded = np.zeros(m, bool)
    crowded[lowest] = (np.bincount(owner, counts[at] > 2, num) > 0)[patch]
    return Doubled(first, rank, rank < left[first], crowded[first])
