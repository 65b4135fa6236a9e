"""Which part of a shape another covers: one is drawn onto the other.

A vertex whose nearest vertex of the other surface lies on its boundary, on the outer
side, is not covered. So a part covers of the whole what lies below it, and the whole
covers all of the part.
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from jfsf.geometry._surface import surface
from jfsf.matching.parts._hint import longest_loop
from jfsf.matching.parts._settings import PartSettings
from jfsf.mesh import largest_component, surface_area, vertex_areas, vertex_normals
from jfsf.mesh._edit import Submesh
from jfsf.mesh._geometry import boundary_edges
from jfsf.mesh._paths import edge_graph
from jfsf.refine import deform
from jfsf.runtime._sizes import padded_shapes, with_rows
from jfsf.types import Mesh

TINY = 1e-6  # of the mean pull


class Target(NamedTuple):
    """A surface, and what finds its nearest vertices.

    outward: (n, 3) out of the surface, for vertices on its boundary; else 0.
    tree: of positions and weighted normals.
    settings: that it was made with.
    curvature: (n, c), see `jfsf.matching.parts._curvature`; (n, 0) where none is
    compared.
    """

    mesh: Mesh
    normal: np.ndarray
    outward: np.ndarray
    tree: KDTree
    settings: PartSettings
    curvature: np.ndarray


class Drawn(NamedTuple):
    """A shape Y drawn onto X.

    moved: (n_y, 3) positions.
    T_xy: (n_x,) the nearest vertex of Y to each of X.
    matched_x: (n_x,) whether Y covers it.
    """

    moved: np.ndarray
    T_xy: np.ndarray
    matched_x: np.ndarray


def target(
    mesh: Mesh,
    settings: PartSettings = PartSettings(),
    curvature: np.ndarray | None = None,
) -> Target:
    """A surface whose nearest vertices are asked for."""
    normal = vertex_normals(*mesh)
    points = np.concatenate([mesh.vertices, settings.bend.normal_weight * normal], 1)
    out = outward(mesh, normal)
    curved = np.zeros((len(points), 0)) if curvature is None else curvature
    return Target(mesh, normal, out, KDTree(points), settings, curved)


def outward(mesh: Mesh, normal: np.ndarray) -> np.ndarray:
    """(n, 3) tangents out of the surface, for vertices on its boundary; else 0."""
    out = np.zeros_like(normal)
    ends = boundary_edges(mesh.faces)
    along = mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]
    # The face lies to the left of its edge, seen against the normal.
    for end in ends.T:
        np.add.at(out, end, np.cross(along, normal[end]))
    return out


def nearest(onto: Target, points, normal) -> tuple[np.ndarray, np.ndarray]:
    """The nearest vertex to each point, and whether the surface covers the point."""
    settings = onto.settings
    query = np.concatenate([points, settings.bend.normal_weight * normal], 1)
    away, near = onto.tree.query(query)
    step = points - onto.mesh.vertices[near]
    beyond = np.sum(step * onto.outward[near], 1) > 0
    return near, (away < settings.cover_distance) & ~beyond


def alike(bent: Target, x: Target, weight: float) -> np.ndarray:
    """T_xy: the nearest vertex to each of X by position, normal and curvature.

    Args:
        bent: Y drawn onto X.
        x: the other surface.
        weight: of the curvature.
    """
    columns = (
        (
            t.mesh.vertices,
            t.settings.bend.normal_weight * t.normal,
            weight * t.curvature,
        )
        for t in (bent, x)
    )
    points, queries = (np.concatenate(own, 1) for own in columns)
    return np.asarray(KDTree(points).query(queries)[1])


def draw_onto(
    y: Mesh,
    x: Target,
    moved,
    T_xy,
    sign: int = 1,
    curvature: np.ndarray | None = None,
) -> Drawn:
    """Y deformed onto X as rigidly as possible, again and again.

    What lies beyond the boundary of Y does not draw it.

    Args:
        y: at rest, in the unit of X, wound outward.
        x: `target`.
        moved: positions of Y to begin with.
        T_xy: the start.
        sign: -1 for a map that mirrors.
        curvature: of Y; None where `x` has none.
    """
    settings = x.settings
    n, mass = len(y.vertices), vertex_areas(*x.mesh)
    side = _padded_surface(y, sign, settings)
    size = len(side.mass)
    options = replace(settings.bend, max_steps=settings.draw_steps)
    T_near, matched = T_xy, np.ones(len(mass), bool)
    for curvature_weight in settings.drawn_curvature_weights:
        weight = mass * np.where(matched, 1, settings.uncovered_weight)
        pull = np.bincount(T_xy, weight, n)
        goal = np.zeros((n, 3))
        np.add.at(goal, T_xy, weight[:, None] * x.mesh.vertices)
        drawn_to = goal / np.maximum(pull, 1e-30)[:, None]
        goal = np.where(pull[:, None] > 0, drawn_to, moved)
        # A mass of 0 would be padding.
        pull += TINY * mass.sum() / n
        pulled = side._replace(mass=jnp.asarray(with_rows(pull, size)))
        rows = _rows(goal, size), _rows(moved, size)
        moved = np.asarray(deform(pulled, *rows, settings=options))[:n].astype(float)
        bent = target(wound(Mesh(moved, y.faces), sign), settings, curvature)
        T_near, matched = nearest(bent, x.mesh.vertices, x.normal)
        T_xy = alike(bent, x, curvature_weight) if curvature_weight else T_near
    return Drawn(moved, T_near, matched)


def covered_by(x: Target, y: Mesh, drawn: Drawn, sign: int = 1):
    """The nearest vertex of X to each of Y drawn onto it, and whether X covers that."""
    normal = sign * vertex_normals(drawn.moved, y.faces)
    return nearest(x, drawn.moved, normal)


def cut(mesh: Mesh, keep: np.ndarray) -> Submesh:
    """The largest piece of the faces whose corners are all kept; empty without any."""
    faces = np.asarray(mesh.faces)
    kept = faces[keep[faces].all(1)]
    if len(kept) == 0:  # it would be a cloud of all vertices
        return Submesh(Mesh(np.zeros((0, 3)), kept), np.zeros(0, np.int32))
    return largest_component(Mesh(mesh.vertices, kept))


def turned_round(T_xy: np.ndarray, mesh_y: Mesh) -> np.ndarray:
    """T_yx: for each vertex of Y a vertex of X whose image is the nearest on Y.

    Args:
        T_xy: the vertex of Y for each vertex of X.
        mesh_y: in one piece; distances are along its edges.
    """
    images, of_image = np.unique(T_xy, return_index=True)
    graph, options = edge_graph(mesh_y), {"directed": False, "min_only": True}
    near = dijkstra(graph, indices=images, return_predecessors=True, **options)[2]
    return of_image[np.searchsorted(images, near)]


def openness(mesh: Mesh, same_unit: bool = True) -> tuple[bool, float]:
    """Greater for a shape with a boundary, and for a smaller one.

    Where units may differ sizes say nothing: there a long boundary counts.
    """
    small = -surface_area(mesh) if same_unit else longest_loop(mesh)
    return len(boundary_edges(mesh.faces)) > 0, small


def near_vertices(points: Mesh, queries: Mesh) -> np.ndarray:
    """The vertex of `points` nearest to each of `queries`."""
    return np.asarray(KDTree(points.vertices).query(queries.vertices)[1])


def wound(mesh: Mesh, sign: int) -> Mesh:
    """Wound the other way where `sign` is -1."""
    return mesh if sign > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def scaled(mesh: Mesh, scale: float) -> Mesh:
    """`scale` times as large."""
    return Mesh(mesh.vertices * scale, mesh.faces)


def _padded_surface(x: Mesh, sign: int, settings: PartSettings):
    """At a common size, so that few programs serve all cuts."""
    (size,) = padded_shapes(1, [(len(x.vertices), len(x.faces))])
    at, faces = with_rows(x.vertices, size.vertices), with_rows(x.faces, size.faces)
    mass = jnp.zeros(size.vertices)
    return surface(
        jnp.asarray(at),
        jnp.asarray(faces),
        mass,
        float(sign),
        stiffness_range=settings.bend.stiffness_range,
    )


def _rows(values, size: int):
    return jnp.asarray(with_rows(np.asarray(values, float), size))
