"""Mesh -> Mesh of fewer vertices, a surface like it (numpy)."""

import fast_simplification
import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh._edit import largest_component, split_components
from jfsf.mesh._geometry import surface_area
from jfsf.types import Mesh

CRUMB = 0.005  # of the area: smaller pieces that come off are dropped


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
    n, m = len(mesh.vertices), len(mesh.faces)
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
