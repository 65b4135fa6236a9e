"""Mesh -> Mesh of fewer vertices, a surface like it (numpy)."""

import fast_simplification
import numpy as np

from jfsf.mesh._edit import largest_component
from jfsf.types import Mesh


def decimate(mesh: Mesh, num: int) -> Mesh:
    """About `num` vertices, by quadric error metrics.

    Edges are contracted where the surface changes least (Garland and Heckbert, SIGGRAPH
    1997). So sheets that lie close stay apart, unlike those of `coarsen`, and a closed
    surface stays one.

    Args:
        mesh: with faces.
        num: 4 or more.

    Returns:
        The largest component. A mesh of `num` vertices or fewer comes back whole.

    Raises:
        ValueError: num is below 4, or the mesh has no faces.
    """
    n, m = len(mesh.vertices), len(mesh.faces)
    if num < 4 or m == 0:
        raise ValueError(
            f"decimate: num is {num} and the mesh has {m} faces; give 4 or more, and a "
            "mesh with faces"
        )
    if n <= num:
        return mesh
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    size = (high - low).max() or 1
    # In float32, so near the origin.
    simplified = fast_simplification.simplify(
        ((mesh.vertices - low) / size).astype(np.float32),
        np.asarray(mesh.faces, np.int32),
        target_count=m * num // n,
    )
    moved = np.asarray(simplified[0], float) * size + low
    return largest_component(Mesh(moved, np.asarray(simplified[1], np.int32))).mesh
