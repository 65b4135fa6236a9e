"""Mesh -> Mesh of fewer vertices: some of its own, or a surface like it."""

import fast_simplification
import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh._edit import Submesh, largest_component, split_components
from jfsf.mesh._geometry import surface_area
from jfsf.mesh._values import mesh_arrays
from jfsf.types import Mesh

# A surface passes through about this many cells a vertex asked for, at the first try.
_CELLS = 1.5
CRUMB = 0.005  # of the area: smaller pieces that come off are dropped


def coarsen(mesh: Mesh, num: int) -> Submesh:
    """Keep at most `num` vertices, one in each cell of a grid; for display.

    The vertex kept is the one nearest to the mean of its cell (Rossignac and Borrel,
    1993). Sheets in one cell merge, so the result need not be a manifold.

    Args:
        mesh: n vertices, m faces; a point cloud has no faces.
        num: 1 or more.

    Returns:
        The mesh, and the number in `mesh` of each vertex that was kept. A mesh of `num`
        vertices or fewer comes back whole.

    Raises:
        ValueError: num is below 1.
    """
    if num < 1:
        raise ValueError(f"coarsen: num is {num}, it must be 1 or more")
    points, faces = mesh_arrays(mesh)
    points = points.astype(float)
    n = len(points)
    if n <= num:
        return Submesh(mesh, np.arange(n, dtype=np.int32))
    low = points.min(0)
    cells = _CELLS * num
    side = np.ptp(points, axis=0).max() / cells**0.5
    while True:
        place = np.floor((points - low) / (side or 1)).astype(np.int64)
        place = np.ravel_multi_index(place.T, place.max(0) + 1)
        _, cell = np.unique(place, return_inverse=True)
        if (count := int(cell.max()) + 1) <= num:
            break
        side *= max((count / num) ** 0.5, 1.02)
    total = np.bincount(cell)
    mean = np.stack([np.bincount(cell, x) / total for x in points.T], 1)
    away = ((points - mean[cell]) ** 2).sum(1)
    order = np.lexsort((away, cell))
    index = np.sort(order[np.r_[True, np.diff(cell[order]) > 0]]).astype(np.int32)
    kept = np.empty(count, np.int32)
    kept[cell[index]] = np.arange(count, dtype=np.int32)
    coarse = kept[cell][faces].reshape(-1, 3)
    a, b, c = coarse.T
    coarse = coarse[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(coarse, axis=1), axis=0, return_index=True)
    return Submesh(Mesh(points[index], coarse[np.sort(first)]), index)


def decimate(mesh: Mesh, num: int) -> Mesh:
    """About `num` vertices, by quadric error metrics.

    Edges are contracted where the surface changes least (Garland and Heckbert, SIGGRAPH
    1997). So sheets that lie close stay apart, unlike those of `coarsen`, and a closed
    surface stays one. Where a limb hangs on by a neck of a few edges, or by a vertex,
    contraction may part it: then it is joined again at the vertices that are nearest.

    Args:
        mesh: with faces.
        num: 4 or more.

    Returns:
        The largest component, in one piece. A mesh of `num` vertices or fewer comes
        back whole.

    Raises:
        ValueError: num is below 4, or the mesh has no faces.
    """
    n, m = map(len, mesh_arrays(mesh))
    if num < 4 or m == 0:
        raise ValueError(
            f"decimate: num is {num} and the mesh has {m} faces; give 4 or more, and a "
            "mesh with faces"
        )
    if n <= num:
        return mesh
    whole = largest_component(mesh).mesh
    if len(whole.vertices) <= num:
        return whole
    low, high = whole.vertices.min(0), whole.vertices.max(0)
    size = (high - low).max() or 1
    # In float32, so near the origin.
    simplified = fast_simplification.simplify(
        ((whole.vertices - low) / size).astype(np.float32),
        np.asarray(whole.faces, np.int32),
        target_count=len(whole.faces) * num // len(whole.vertices),
    )
    moved = np.asarray(simplified[0], float) * size + low
    return _in_one_piece(Mesh(moved, np.asarray(simplified[1], np.int32)))


def _in_one_piece(mesh: Mesh) -> Mesh:
    """Its components joined, the nearest first, each by the vertex that is nearest."""
    pieces = [piece.mesh for piece in split_components(mesh)]
    pieces.sort(key=surface_area, reverse=True)
    least = CRUMB * surface_area(mesh)
    joined, *rest = [pieces[0], *(p for p in pieces[1:] if surface_area(p) >= least)]
    while rest:
        tree = KDTree(joined.vertices)
        found = [np.asarray(tree.query(piece.vertices)) for piece in rest]
        first = int(np.argmin([away.min() for away, _ in found]))
        piece, (away, near) = rest.pop(first), found[first]
        at = int(np.argmin(away))
        number = len(joined.vertices) + np.arange(len(piece.vertices), dtype=np.int32)
        number[at:] -= 1
        number[at] = int(near[at])
        joined = Mesh(
            np.concatenate([joined.vertices, np.delete(piece.vertices, at, 0)]),
            np.concatenate([joined.faces, number[piece.faces]]),
        )
    return joined
