"""Faces with the same vertices as others: how many of each are to be kept (numpy).

Of a face that is there twice by mistake one belongs to the surface. Two faces that lie
back to back as a flap on a closed surface both go: one alone would be a fin, whose
edge has three faces. Edges tell which is which.
"""

from typing import Any, NamedTuple

import numpy as np

from jfsf.mesh._geometry import components, edge_keys, face_areas
from jfsf.types import ArrayLike

# Share of the area that neighbouring pairs of faces back to back have at most. More is
# no flaw but a membrane that was meant, and one face of each pair is kept.
LARGEST_FLAP = 0.01


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
