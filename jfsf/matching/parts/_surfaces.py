"""Surfaces with a boundary: cuts, rims, and which shape of a pair looks like a part."""

from typing import Literal

import numpy as np
from scipy.sparse.csgraph import dijkstra

from jfsf.mesh import largest_component, surface_area
from jfsf.mesh._edit import Submesh
from jfsf.mesh._geometry import boundary_edges, components, edge_graph
from jfsf.types import Mesh

# In sqrt(area): a neck or an upper arm that was cut through has about 0.35.
LONG_LOOP = 0.3


def likely_part(mesh_x: Mesh, mesh_y: Mesh) -> Literal["x", "y"] | None:
    """The shape whose longest boundary loop is longer than the other's, by far.

    Args:
        mesh_x, mesh_y: a point cloud has no boundary.
    """
    more = longest_loop(mesh_x) - longest_loop(mesh_y)
    if abs(more) <= LONG_LOOP:
        return None
    return "x" if more > 0 else "y"


def longest_loop(mesh: Mesh) -> float:
    """Length of the longest piece of the boundary, in sqrt(area)."""
    ends = boundary_edges(mesh.faces)
    if len(ends) == 0:
        return 0.0
    vertices = np.asarray(mesh.vertices, float)
    piece = components(len(vertices), ends[:, 0], ends[:, 1])[ends[:, 0]]
    length = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    area = surface_area(mesh)
    return float(np.bincount(piece, length).max() / np.sqrt(area)) if area > 0 else 0.0


def openness(mesh: Mesh, same_unit: bool = True) -> tuple[bool, float]:
    """Greater for a shape with a boundary, and for a smaller one.

    Where units may differ sizes say nothing: there a long boundary counts.
    """
    small = -surface_area(mesh) if same_unit else longest_loop(mesh)
    return len(boundary_edges(mesh.faces)) > 0, small


def cut(mesh: Mesh, keep: np.ndarray) -> Submesh:
    """The largest piece of the faces whose corners are all kept; empty without any."""
    faces = np.asarray(mesh.faces)
    kept = faces[keep[faces].all(1)]
    if len(kept) == 0:  # it would be a cloud of all vertices
        return Submesh(Mesh(np.zeros((0, 3)), kept), np.zeros(0, np.int32))
    return largest_component(Mesh(mesh.vertices, kept))


def outward(mesh: Mesh, normal: np.ndarray) -> np.ndarray:
    """(n, 3) tangents out of the surface, for vertices on its boundary; else 0."""
    out = np.zeros_like(normal)
    ends = boundary_edges(mesh.faces)
    along = mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]
    # The face lies to the left of its edge, seen against the normal.
    for end in ends.T:
        np.add.at(out, end, np.cross(along, normal[end]))
    return out


def from_rim(mesh: Mesh) -> np.ndarray:
    """(n,) distance to the boundary along edges; inf where there is none."""
    edge = np.unique(boundary_edges(mesh.faces))
    if not len(edge):
        return np.full(len(mesh.vertices), np.inf)
    options = {"directed": False, "min_only": True}
    return np.asarray(dijkstra(edge_graph(mesh), indices=edge, **options))


def inverse_map(T_xy: np.ndarray, mesh_y: Mesh) -> np.ndarray:
    """T_yx: the vertex of X whose image is nearest to each vertex of Y.

    Args:
        T_xy: the vertex of Y for each vertex of X.
        mesh_y: in one piece; distances are along its edges.
    """
    images, of_image = np.unique(T_xy, return_index=True)
    graph, options = edge_graph(mesh_y), {"directed": False, "min_only": True}
    near = dijkstra(graph, indices=images, return_predecessors=True, **options)[2]
    return of_image[np.searchsorted(images, near)]


def wound(mesh: Mesh, sign: int) -> Mesh:
    """Wound the other way where `sign` is -1."""
    return mesh if sign > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def scaled(mesh: Mesh, scale: float) -> Mesh:
    """`scale` times as large."""
    return Mesh(mesh.vertices * scale, mesh.faces)
