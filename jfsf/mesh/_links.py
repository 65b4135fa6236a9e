"""Pairs of neighbouring faces, and the pieces that they make (numpy).

Neighbours share an edge of two faces, or lie beside each other in the fan around an
edge of three faces or more and continue each other.
"""

from typing import Any, NamedTuple

import numpy as np

from jfsf.mesh._geometry import HalfEdgePairs, components

# Two faces of a fan continue each other if the cosine of the angle by which the second
# leaves the plane of the first is above this. Three faces at 120 degrees have 0.5.
CONTINUES = 0.6


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
