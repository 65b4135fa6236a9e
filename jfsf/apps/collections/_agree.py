"""Where the template lies on a shape, by all trusted ways that lead there.

The errors of maps by way of different shapes are partly independent, so their mean is
nearer to the truth than each: a collection gains what a pair alone cannot.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.mesh import closest, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.types import ArrayLike, Mesh

# Of distances from 0.005 to 1 those from 0.01 to 0.04 are equally good
# (experiments/fit/fit_agree.py).
WITHIN = 0.02


class OtherShape(NamedTuple):
    """Another shape of a collection, whose map to this one is trusted.

    mesh: of the other shape.
    template: where the vertices of the template lie on it.
    T: the vertex of this shape for each vertex of the other.
    """

    mesh: Mesh
    template: Float[ArrayLike, "n 3"]
    T: Int[ArrayLike, " m"]


def agreed_map(
    template: Float[ArrayLike, "n 3"],
    others: Sequence[OtherShape],
    mesh: Mesh,
    *,
    within: float = WITHIN,
) -> Int[np.ndarray, " n"]:
    """The vertex of a shape for each vertex of the template, agreed on by all paths.

    Args:
        template: where the template's vertices lie on the shape by its own map.
        others: for each other path, where the template's vertices lie on the shape:
            from the template to another shape, and on by the map of that pair.
        mesh: the shape.
        within: distance from the median of all paths, in sqrt(area) of the shape, from
            which on a path counts little in the mean: weights are those of Geman and
            McClure (1985), 1 / (1 + (d / within)^2)^2.

    Returns:
        The vertex nearest to the mean.
    """
    vertices = np.asarray(mesh.vertices, float)
    ways = np.stack([template, *(_carried(other, vertices) for other in others)])
    apart = np.linalg.norm(ways - np.median(ways, 0), axis=2)
    weight = 1 / (1 + (apart / (within * np.sqrt(surface_area(mesh)))) ** 2) ** 2
    mean = np.einsum("wn,wni->ni", weight / weight.sum(0), ways)
    return np.asarray(KDTree(vertices).query(mean)[1], np.int32)


def _carried(other: OtherShape, vertices: np.ndarray) -> np.ndarray:
    """Points of the template on the other shape, on this one: between its vertices."""
    found = closest(surface_tree(other.mesh), other.template)
    corners = np.asarray(other.T)[np.asarray(other.mesh.faces)[found.face]]
    return np.einsum("nc,nci->ni", found.barycentric, vertices[corners])
