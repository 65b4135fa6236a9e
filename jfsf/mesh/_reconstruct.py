"""Point cloud -> the surface of the solid that its points bound, wound outward.

1. Triangles: each point's neighbours, in its tangent plane, have a Delaunay
   triangulation (Sharp and Crane, 2020). A triangle has as many votes as it has corners
   that agree on it.
2. Seeds: triangles with all three votes fit together, but for gaps. The largest piece
   is wound outward by the sign of its volume, as `orient` does.
3. Solid: the tetrahedra of the 3D Delaunay triangulation (Boissonnat, 1984) are told
   inside from outside by a watershed cut (Cousty et al., 2009) from both sides of the
   seeds. It floods through facets without votes first, and of these through wide ones.
   So the cut follows the triangles that were voted for, and closes their gaps.

The boundary of a solid is wound consistently, whatever the points are.
"""

from typing import NamedTuple

import numpy as np
import potpourri3d as pp3d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError

from jfsf.mesh._geometry import (
    components,
    face_areas,
    face_normals,
    in_unit_box,
    pair_half_edges,
    vertex_components,
)
from jfsf.mesh._values import mesh_arrays
from jfsf.mesh._winding import orient
from jfsf.types import ArrayLike, Mesh

NEIGHBOURS = 30  # of each point, as the Laplacian of clouds has
# Share of the surface's area that nobody voted for, and of the points that it leaves
# out, at most. Bodies of 5000 points, FAUST and TOSCA have up to 0.12 and 0.28, a body
# cut at the waist 0.11 and 0.04; a hemisphere has 0.39 of area, a sheet 0.5 or more,
# and points in a volume or under noise of the size of their spacing leave out 0.9.
MAX_UNVOTED = 0.3
MAX_LEFT_OUT = 0.3
# Above, the Laplacian of the points is better than that of the surface, filled up: so
# under noise of 0.5 % of sqrt(area), where 0.07 to 0.13 are left out, and 0.03 without.
MAX_FILLED = 0.05
# Triangles without votes, and wider than this times the median, are lids over openings.
LID = 3.0
# The facet of a tetrahedron that is opposite to each corner.
_FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


class Reconstruction(NamedTuple):
    """The surface that a cloud was sampled from; both meshes have the cloud's vertices.

    surface: wound outward, closed but for the cloud's own openings. A few vertices may
        be left out. Without faces if no surface with an outside was found.
    whole: the surface, and triangles in any winding for the vertices it leaves out:
        one component, for `laplacian="robust"`. Without faces too if these are many;
        then the Laplacian of the points is better.
    """

    surface: Mesh
    whole: Mesh


def reconstruct(cloud: Mesh) -> Reconstruction:
    """The oriented surface of a point cloud, or none if it has no clear outside.

    There is none for sheets with borders, for points that fill a volume, and where
    noise reaches the distance of neighbours. Parts that lie closer to each other than
    their points do may be joined, and inner surfaces, such as a mouth's, left out.

    Args:
        cloud: n points in any unit; faces are not read.

    Returns:
        The surface, the same under rigid motion, scaling and relabelling but for ties.
    """
    points = mesh_arrays(cloud, "cloud")[0].astype(np.float64)
    none = np.zeros((0, 3), np.int32)
    surface, whole = _faces(points) or (none, none)
    return Reconstruction(Mesh(cloud.vertices, surface), Mesh(cloud.vertices, whole))


def _faces(points):
    """Faces of the surface and of the whole; None if there is no surface."""
    n = len(points)
    if n <= NEIGHBOURS:
        return None
    points = in_unit_box(points)
    near, votes = _voted(points)
    seeds = _largest_piece(points, near[votes == 3])
    if len(seeds) == 0:
        return None
    try:
        solid = Delaunay(points)
    except QhullError:  # the points lie in a plane
        return None
    faces, supported = _boundary(points, solid, seeds, near, votes)
    area, left_out = face_areas(points, faces), ~_used(n, faces)
    if not area[~supported].sum() <= MAX_UNVOTED * area.sum():
        return None
    if left_out.mean() > MAX_LEFT_OUT:
        return None
    width = _circumradius(points, faces)
    surface = faces[supported | (width <= LID * np.median(width))]
    # The better triangles first: few vertices need the others.
    whole = _joined(n, _joined(n, surface, near[votes > 1]), near)
    if left_out.mean() > MAX_FILLED or vertex_components(whole, n).any():
        whole = whole[:0]
    return surface, whole


def _voted(points):
    """Triangles (m, 3), corners ascending, and how many corners agree on each."""
    try:
        local = pp3d.PointCloudLocalTriangulation(points).get_local_triangulation()
    except ValueError:  # of points on a line it has no triangle
        local = np.zeros((0, 3), np.int32)
    triangles = np.asarray(local).reshape(-1, 3)
    triangles = triangles[((triangles >= 0) & (triangles < len(points))).all(1)]
    triangles, votes = np.unique(np.sort(triangles, 1), axis=0, return_counts=True)
    return triangles.astype(np.int32), np.minimum(votes, 3)


def _largest_piece(points, faces):
    """The piece, connected through edges with two faces, with most faces; outward."""
    if len(faces) == 0:
        return faces
    pairs = pair_half_edges(faces, len(points))
    left, right = pairs.left[pairs.manifold] // 3, pairs.right[pairs.manifold] // 3
    piece = components(len(faces), left, right)
    largest = faces[piece == np.bincount(piece).argmax()]
    return orient(Mesh(points, largest)).faces


def _boundary(points, solid, seeds, near, votes):
    """Facets between inside and outside, and whether each has votes."""
    count, n = len(solid.simplices), len(points)
    outside, inside = count, count + 1  # nodes beside the tetrahedra
    facets = _outward_facets(points, solid.simplices)
    here = np.repeat(np.arange(count), 4)
    there = np.where(solid.neighbors < 0, outside, solid.neighbors).ravel()
    keys = _keys(facets, n)
    place, known = _find(_keys(near, n), keys)
    support = np.where(known, votes[place], 0)
    place, known = _find(_keys(seeds, n), keys)
    # A tetrahedron whose facet is wound as the seed lies under it.
    same = known & (_is_even(facets) == _is_even(seeds[place]))
    under = np.bincount(here[same], minlength=count) > 0
    above = np.bincount(here[known & ~same], minlength=count) > 0
    sure_in, sure_out = (
        np.flatnonzero(a & ~b) for a, b in ((under, above), (above, under))
    )
    width = _circumradius(points, facets)
    rank = np.empty(len(facets))
    rank[np.lexsort((-width, support))] = np.arange(len(facets)) + 3
    # Either side is one node, by links that nothing precedes; and both are linked first
    # of all, so that the tree falls into two when this link is cut.
    once = here < there
    ends = (
        np.concatenate([here[once], sure_in, sure_out, [outside]]),
        np.concatenate(
            [
                there[once],
                np.full(len(sure_in), inside),
                np.full(len(sure_out), outside),
                [inside],
            ]
        ),
    )
    sure = len(sure_in) + len(sure_out)
    order = np.concatenate([rank[once], np.full(sure, 2.0), [1.0]])
    label = _cut(ends, order, count + 2)
    is_in = label == label[inside]
    at = is_in[here] & ~is_in[there]
    return facets[at], support[at] > 0


def _cut(ends, order, count):
    """Label of each node: the first link's ends fall apart, all else stays together."""
    low, high = np.minimum(*ends), np.maximum(*ends)
    # Of parallel links the first counts; a sparse matrix would add them up.
    sort = np.lexsort((order, high, low))
    low, high, order = low[sort], high[sort], order[sort]
    first = np.r_[True, (np.diff(low) != 0) | (np.diff(high) != 0)]
    links = (order[first], (low[first], high[first]))
    tree = minimum_spanning_tree(coo_array(links, shape=(count, count)).tocsr()).tocoo()
    kept = tree.data > 1
    graph = coo_array(
        (tree.data[kept], (tree.row[kept], tree.col[kept])), shape=(count, count)
    )
    return connected_components(graph, directed=False)[1]


def _outward_facets(points, tetrahedra):
    """The four facets (4 m, 3) of each tetrahedron, wound away from it."""
    facets = tetrahedra[:, _FACETS].reshape(-1, 3)
    opposite = points[tetrahedra].reshape(-1, 3)
    away = points[facets[:, 0]] - opposite
    inward = (face_normals(points, facets) * away).sum(1) < 0
    return np.where(inward[:, None], facets[:, [0, 2, 1]], facets).astype(np.int32)


def _joined(n, faces, others):
    """The faces, and those of the others that touch a vertex without one."""
    return np.concatenate([faces, others[~_used(n, faces)[others].all(1)]])


def _used(n, faces):
    used = np.zeros(n, bool)
    used[faces] = True
    return used


def _circumradius(points, faces) -> ArrayLike:
    sides = points[faces] - points[np.roll(faces, -1, axis=1)]
    lengths = np.linalg.norm(sides, axis=2).prod(1)
    area = face_areas(points, faces)
    return lengths / np.maximum(4 * area, np.finfo(float).tiny)


def _keys(faces, n):
    """A number for the three vertices of each face, in any order."""
    a, b, c = np.sort(faces, axis=1).astype(np.int64).T
    # Below 2^63 up to two million points.
    return (a * n + b) * n + c


def _find(keys, wanted):
    """Where each wanted key is among the keys, and whether it is there."""
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)
    return order[place], keys[order][place] == wanted


def _is_even(faces):
    """Whether the corners of each face ascend, up to a rotation."""
    a, b, c = faces.T
    return ((a < b) & (b < c)) | ((b < c) & (c < a)) | ((c < a) & (a < b))
