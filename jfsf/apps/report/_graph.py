"""Where the shapes of a graph of pairs are drawn, so that matched pairs lie near.

The places minimise the stress sum_ij (|p_i - p_j| - d_ij)^2 / d_ij^2 over the plane,
d_ij being the number of pairs on the shortest way from i to j, by majorisation
(Gansner, Koren and North 2004, "Graph drawing by stress majorization").
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

STEPS = 200


def places(
    edges: Sequence[tuple[int, int]], num_shapes: int
) -> Float[np.ndarray, "s 2"]:
    """A place of each shape in the unit square; the same in every run.

    Args:
        edges: numbers of the two shapes of each pair. What they do not connect is drawn
            apart.
        num_shapes: s, one or more.
    """
    s = num_shapes
    rows = np.array(list(edges), int).reshape(-1, 2)
    near = coo_matrix((np.ones(len(rows)), rows.T), (s, s)).tocsr()
    steps = dijkstra(near, directed=False, unweighted=True)
    far = steps[np.isfinite(steps)].max(initial=1)
    steps = np.where(np.isfinite(steps), steps, far + 1)
    weight = 1 / np.maximum(steps, 1) ** 2
    np.fill_diagonal(weight, 0)
    # On a circle first: no two shapes begin at one place.
    angle = 2 * np.pi * np.arange(s) / s
    points = far / 2 * np.stack([np.cos(angle), np.sin(angle)], 1)
    total = np.maximum(weight.sum(1), 1e-12)[:, None]
    for _ in range(STEPS if s > 1 else 0):
        offset = points[:, None] - points[None]
        away = np.maximum(np.linalg.norm(offset, axis=2), 1e-9)
        pulled = points[None] + offset * (steps / away)[..., None]
        points = np.einsum("ij,ijd->id", weight, pulled) / total
    # The longer side across.
    points = points - points.mean(0)
    across = np.linalg.eigh(points.T @ points)[1][:, ::-1]
    points = points @ (across * np.sign(across.sum(0) + 1e-12))
    points = points - points.min(0)
    return points / max(points.max(), 1e-9)
