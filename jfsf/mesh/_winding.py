"""Which way the faces of a mesh are wound: outward, and where that is unclear (numpy).

Faces that share an edge of two faces are neighbours, and so are two faces in the fan
around an edge of three faces or more if one continues the other. Faces are wound so
that neighbours agree; then each surface is wound so that its volume is positive.

Where neighbours contradict each other, each face gets a number u whose sign says
whether it is turned over: the smoothest one, the lowest eigenvector of the Laplacian in
which neighbours that clash count with the other sign. A few wrong faces leave u nearly
constant, and small only beside them. On a one-sided surface it passes through 0 slowly.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jfsf.mesh._faces import (
    Links,
    across_edges,
    between_nodes,
    doubled_faces,
    in_fans,
    joined,
    two_sheets,
)
from jfsf.mesh._geometry import (
    component_volumes,
    edge_keys,
    face_areas,
    pair_half_edges,
    repeats_vertex,
)
from jfsf.mesh._values import mesh_arrays
from jfsf.types import ArrayLike, Mesh

# Share of the area with unclear winding above which left and right are in doubt.
MAX_UNCLEAR = 0.01
# Part of the median of |u| below which the winding is unclear, of a face of a one-sided
# surface. A strip of two faces that changes sides makes 0.1 % of a body of 10 000 faces
# unclear at most, of a hand as well, and 5 % with 0.3; of a Moebius strip, Klein bottle
# and figure of eight 4 to 5 % are.
WEAK = 0.1
# The same of a piece between others: the edges that speak for its winding are twice as
# long as those against it.
UNDECIDED = 1 / 3
# Volume over area^1.5 below which an open surface is flat; of a dome on a circle it is
# 0.19 times its height over the radius of the circle. Of 30 cameras' views of bodies
# and animals 29 have 3e-3 to 7e-2 with the right sign, one 1.5e-3 with the wrong
# one, whose file is right; 51 other parts and teeth have more than 2e-2, with the right
# sign.
FLAT = 2e-3
NO_VOLUME = 1e-9  # the same for a closed surface: there is rounding only
POWER_STEPS = 20  # of the inverse iteration for u
RESTARTS = 10  # of this iteration, at most


class _Winding(NamedTuple):
    """turn: (m,) whether to turn each face over. clear: (m,) whether that is sure."""

    turn: ArrayLike
    clear: ArrayLike


def orient(mesh: Mesh) -> Mesh:
    """Wind the faces consistently and outward; vertices and face order stay.

    Faces that share an edge are wound alike, then each surface is turned over as a
    whole if its signed volume is negative. For the volume, an open surface is closed by
    a cone to its centroid. A surface without volume keeps the winding of its first
    face, and so does an open one that is so flat that the sign of its volume is an
    accident (`unclear_winding`). The surface of a cavity is a surface of its own: it
    comes out wound like any closed one, with its normals away from the cavity.

    Around an edge with three faces or more, those that continue each other are wound
    alike; where that decides nothing, a piece goes by its own volume. Copies of a face
    are wound as the face; two faces back to back that form a flap are wound against
    each other. Where neighbours contradict each other, as if a few faces are wrong, the
    faces are wound so that this happens along short lines.

    Args:
        mesh: n vertices, m faces; indices in range, coordinates finite.

    Returns:
        The mesh, wound. `unclear_winding` says how much of it could not be.
    """
    vertices, faces = mesh_arrays(mesh)
    turn = _winding(vertices, faces).turn
    return Mesh(vertices, np.where(turn[:, None], faces[:, [0, 2, 1]], faces))


def unclear_winding(mesh: Mesh) -> float:
    """The share of the area whose winding is unclear after `orient`, in [0, 1].

    It is the area of

    - faces whose neighbours contradict each other, directly or through others: most of
      the faces beside a few wrong ones agree and are clear, while of a Moebius strip or
      a Klein bottle some hundredths are unclear, wherever the seam is laid;
    - surfaces without a clear outside: closed ones around no volume, and open ones so
      flat that the sign of their volume is an accident, such as a dome on a circle with
      1 % of its radius as height. Most cameras' views of a body are far from flat.

    The shares of single faces that are doubled, of fins and of flaps are small. Above
    `MAX_UNCLEAR`, 1 %, left and right may be swapped.

    Args:
        mesh: n vertices, m faces, as `orient` takes it, wound or not.

    Returns:
        The share; 0 for a mesh without area and for a point cloud.
    """
    vertices, faces = mesh_arrays(mesh)
    area = face_areas(vertices, faces)
    clear = _winding(vertices, faces).clear
    return float(area[~clear].sum() / area.sum()) if area.sum() > 0 else 0.0


def _winding(vertices, faces) -> _Winding:
    """As `orient` winds, and what is clear."""
    turn, clear = np.zeros(len(faces), bool), np.ones(len(faces), bool)
    solid = np.flatnonzero(~repeats_vertex(faces))
    if len(solid) == 0:
        return _Winding(turn, clear)
    given = faces[solid]
    copies = doubled_faces(vertices, given)
    # Two faces back to back by themselves are an ordinary closed surface.
    kept = copies.keep | ~copies.crowded
    if kept.any():
        turn[solid[kept]], clear[solid[kept]] = _wind(vertices, given[kept])
    late = np.flatnonzero(copies.crowded & (copies.rank > 0))
    first = copies.first[late]
    # Copies of a face as the face is; those of a flap one this way, one that.
    against = _same_way(given[late], given[first]) == (
        ~copies.keep[first] & (copies.rank[late] % 2 == 1)
    )
    turn[solid[late]] = turn[solid[first]] ^ against
    clear[solid[late]] = clear[solid[first]]
    return _Winding(turn, clear)


def _wind(vertices, faces) -> _Winding:
    """The same for faces that are there once and repeat no vertex."""
    m = len(faces)
    pairs = pair_half_edges(faces, len(vertices))
    near = across_edges(vertices, faces, pairs)
    # Two-sided pieces, connected through edges with two faces, are wound as a whole. In
    # others each face is a node of its own.
    label, other = two_sheets(m, near)
    _, first, piece = np.unique(
        np.minimum(label, other), return_index=True, return_inverse=True
    )
    one_sided = (label == other)[first]
    turn = ~one_sided[piece] & (label != label[first][piece])
    own = np.where(one_sided[piece], np.arange(m), first[piece])
    node = np.unique(own, return_inverse=True)[1]
    links = between_nodes(joined(near, in_fans(vertices, faces, pairs)), node, turn)
    num = node.max() + 1
    area = face_areas(vertices, faces)
    over, group, strength = _nodes_wound(links, np.bincount(node, area, num), num)
    turn ^= over[node]
    single = np.bincount(node, one_sided[piece], num) > 0
    weak = strength < np.where(single, WEAK, UNDECIDED)
    # Pieces whose neighbours are undecided go by their own volume, if they have one.
    if weak.any():
        volume, least = _volumes(vertices, _flip(faces, turn), node)
        alone = weak & ~single & (np.abs(volume) > least)
        group = np.where(alone, group.max() + 1 + np.arange(num), group)
        group = np.unique(group, return_inverse=True)[1]
        weak = weak & ~alone
    surface = group[node]
    volume, least = _volumes(vertices, _flip(faces, turn), surface)
    turn ^= (volume < -least)[surface]
    return _Winding(turn, (np.abs(volume) > least)[surface] & ~weak[node])


def _nodes_wound(links: Links, area, num: int) -> tuple[Any, Any, Any]:
    """Whether to turn each node over, its group, and |u| over its median there."""
    strength = np.ones(num)
    if not len(links.left):
        return np.zeros(num, bool), np.arange(num), strength
    label, other = two_sheets(num, links)
    _, first, group = np.unique(
        np.minimum(label, other), return_index=True, return_inverse=True
    )
    over = label != label[first][group]
    contrary = label == other
    if contrary.any():
        number = np.cumsum(contrary) - 1
        here = contrary[links.left]
        inner = Links(
            number[links.left[here]],
            number[links.right[here]],
            links.clash[here],
            links.weight[here],
        )
        some = np.unique(group[contrary], return_inverse=True)[1]
        over[contrary], strength[contrary] = _smoothest(inner, area[contrary], some)
    return over, group, strength


def _smoothest(links: Links, area, group) -> tuple[Any, Any]:
    """Whether u < 0 at nodes whose neighbours contradict each other; |u| over median.

    Args:
        links: between the nodes.
        area: (p,) of the nodes.
        group: (p,) connected nodes, counted from 0.
    """
    num, many = len(area), group.max() + 1
    # Nodes without area would make the matrix of areas singular.
    mass = area / np.bincount(group, area)[group] + 1e-6 / np.bincount(group)[group]
    scale = np.zeros(many)
    np.maximum.at(scale, group[links.left], links.weight)
    weight = links.weight / np.where(scale > 0, scale, 1)[group[links.left]] + 1e-12
    sign = np.where(links.clash, -1.0, 1.0)
    ends = np.stack([links.left, links.right]), np.stack([links.right, links.left])
    ends = tuple(np.concatenate(both) for both in ends)
    signed = sp.csc_array((np.tile(sign * weight, 2), ends), (num, num))
    degree = np.bincount(ends[0], np.tile(weight, 2), num)
    # A little mass keeps the matrix regular where the contradiction is tiny.
    matrix = sp.csc_array(sp.diags_array(degree + 1e-9 * mass) - signed)
    solver = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    start = 1 + 0.1 * np.random.default_rng(0).normal(size=num)
    cost = lambda over: np.bincount(
        group[links.left],
        (links.clash ^ over[links.left] ^ over[links.right]) * weight,
        many,
    )
    # From the winding as given, until no other clashes less: then `orient` changes
    # nothing when it is called again.
    over, strength = np.zeros(num, bool), np.ones(num)
    for _ in range(RESTARTS):
        u = np.where(over, -start, start)
        for _ in range(POWER_STEPS):
            u = solver.solve(mass * u)
            u /= np.sqrt(np.bincount(group, mass * u**2))[group]
        size = np.abs(u)
        middle = _medians(size, mass, group, many)[group]
        strength = size / np.where(middle > 0, middle, 1)
        other = np.where(size > 1e-6 * middle, u < 0, over)
        better = (cost(other) < cost(over) * (1 - 1e-9))[group]
        if not better.any():
            break
        over = np.where(better, other, over)
    return over, strength


def _medians(values, weight, group, many):
    """The weighted median (many,) of the values of each group."""
    order = np.lexsort((values, group))
    total = np.cumsum(weight[order])
    end = np.cumsum(np.bincount(group, minlength=many))
    begin = np.append(0, total[end[:-1] - 1])
    half = (begin + total[end - 1]) / 2
    return values[order][np.searchsorted(total, half)]


def _volumes(vertices, faces, surface) -> tuple[Any, Any]:
    """The volume of each surface, and the least that tells its outside."""
    volume, area = component_volumes(vertices, faces, surface)
    n = len(vertices)
    key, at = np.unique(edge_keys(faces, n), return_inverse=True)
    pair = at * len(area) + np.repeat(surface, 3)
    odd, counts = np.unique(pair, return_counts=True)
    odd = odd[counts % 2 == 1]
    ends = key[odd // len(area)]
    length = np.linalg.norm(vertices[ends // n] - vertices[ends % n], axis=1)
    rim = np.bincount(odd % len(area), length, len(area))
    # No hole is larger than a disk with this rim.
    hole = np.minimum(1, rim**2 / (4 * np.pi * np.where(area > 0, area, 1)))
    return volume, (NO_VOLUME + FLAT * hole) * area**1.5


def _same_way(faces, others):
    """Whether faces run through the same vertices in the same order."""
    start = (others == faces[:, :1]).argmax(axis=1)
    after = np.take_along_axis(others, ((start + 1) % 3)[:, None], axis=1)
    return after[:, 0] == faces[:, 1]


def _flip(faces, which):
    return np.where(which[:, None], faces[:, [0, 2, 1]], faces)
