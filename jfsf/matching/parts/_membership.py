"""How clearly each vertex is in the region that two shapes share. Host side.

It is read where one shape has been drawn onto the other: from how far a vertex is from
the other surface, normals counted, and how far inside that surface's rim it lies.
"""

import numpy as np
from scipy.sparse.csgraph import dijkstra

from jfsf.matching.parts._region import Target, target, wound
from jfsf.mesh._geometry import boundary_edges
from jfsf.mesh._paths import edge_graph
from jfsf.types import Mesh


def membership(
    onto: Target,
    points: np.ndarray,
    normal: np.ndarray,
    inside: np.ndarray,
) -> np.ndarray:
    """In [0, 1] for each point, above one half where the surface has it too.

    With r the distance to the nearest vertex, by position and normal as in the search
    for it, and d how far the point lies beyond the rim, below 0 inside, it is

        1 / (1 + (r / cover_distance)^4 + exp(d / rim_width)).

    Args:
        onto: a surface, with the settings.
        points: (n, 3) of the other surface, on this one.
        normal: (n, 3) there.
        inside: (m,) distance of each vertex of `onto` from its rim (`from_rim`).
    """
    settings = onto.settings
    query = np.concatenate([points, settings.bend.normal_weight * normal], 1)
    away, near = map(np.asarray, onto.tree.query(query))
    out = onto.outward[near]
    size = np.linalg.norm(out, axis=1)
    step = np.sum((points - onto.mesh.vertices[near]) * out, 1)
    # Of one whose nearest vertex is not on the rim, that vertex's distance from it.
    beyond = np.where(size > 0, step / np.where(size > 0, size, 1), -inside[near])
    width, reach = settings.rim_width, settings.cover_distance
    odds = (away / reach) ** 4 + np.exp(np.minimum(beyond / width, 50))
    return 1 / (1 + odds)


def memberships(
    x: Target, y: Mesh, moved: np.ndarray, sign: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Of the vertices of X, and of those of Y.

    Args:
        x: one surface, with the settings.
        y: the other at rest.
        moved: positions of Y, drawn onto X.
        sign: -1 for a map that mirrors.
    """
    bent = target(wound(Mesh(moved, y.faces), sign), x.settings)
    return (
        membership(bent, x.mesh.vertices, x.normal, from_rim(y)),
        membership(x, moved, bent.normal, from_rim(x.mesh)),
    )


def from_rim(mesh: Mesh) -> np.ndarray:
    """(n,) distance to the boundary along edges; inf where there is none."""
    edge = np.unique(boundary_edges(mesh.faces))
    if not len(edge):
        return np.full(len(mesh.vertices), np.inf)
    options = {"directed": False, "min_only": True}
    return np.asarray(dijkstra(edge_graph(mesh), indices=edge, **options))
