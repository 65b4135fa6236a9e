"""Mesh -> Mesh of fewer vertices, which are some of its own (numpy)."""

import numpy as np

from jfsf.mesh._edit import Submesh
from jfsf.types import Mesh

# A surface passes through about this many cells a vertex asked for, at the first try.
_CELLS = 1.5


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
    points, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
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
