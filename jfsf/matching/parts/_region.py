"""Which part of a shape another covers: one is drawn onto the other.

A vertex whose nearest vertex of the other surface lies on its boundary, on the outer
side, is not covered. So a part covers of the whole what lies below it, and the whole
covers all of the part. How clearly a vertex is covered is read from how far it is from
the other surface, normals counted, and how far inside that surface's rim it lies.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from jfsf.geometry._surface import surface
from jfsf.matching.parts._register import UNCOVERED_WEIGHT
from jfsf.matching.parts._surfaces import from_rim, outward, wound
from jfsf.mesh._geometry import vertex_areas, vertex_normals
from jfsf.refine import ArapSettings, deform
from jfsf.runtime._sizes import padded_shapes, with_rows
from jfsf.types import Mesh

# How the whole is deformed, and the weight of normals in the search for the nearest
# vertices.
BEND = ArapSettings(max_steps=150)
# One a deformation, each with such a search: the length in sqrt(area of the whole) that
# a difference of curvature of one standard deviation counts as.
CURVATURE_WEIGHTS = *(0.1,) * 6, *(0.03,) * 3, 0.0
COVER_DISTANCE = (
    0.1  # in sqrt(area of the whole): a surface farther away covers nothing
)
# Length in sqrt(area of the whole), about an edge, over which a surface ceases to cover
# at its rim.
RIM_WIDTH = 0.02
TINY = 1e-6  # of the mean pull


class Target(NamedTuple):
    """A surface, and what finds its nearest vertices.

    outward: (n, 3) out of the surface, for vertices on its boundary; else 0.
    tree: of positions and weighted normals.
    curvature: (n, c) standard values of `curvature`; (n, 0) where none is compared.
    """

    mesh: Mesh
    normal: np.ndarray
    outward: np.ndarray
    tree: KDTree
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


def target(mesh: Mesh, curvature: np.ndarray | None = None) -> Target:
    """A surface whose nearest vertices are asked for."""
    normal = vertex_normals(*mesh)
    points = _with_normals(mesh.vertices, normal)
    out = outward(mesh, normal)
    curved = np.zeros((len(points), 0)) if curvature is None else curvature
    return Target(mesh, normal, out, KDTree(points), curved)


def nearest(onto: Target, points, normal) -> tuple[np.ndarray, np.ndarray]:
    """The nearest vertex to each point, and whether the surface covers the point."""
    away, near = onto.tree.query(_with_normals(points, normal))
    step = points - onto.mesh.vertices[near]
    beyond = np.sum(step * onto.outward[near], 1) > 0
    return near, (away < COVER_DISTANCE) & ~beyond


def nearest_by_curvature(bent: Target, x: Target, weight: float) -> np.ndarray:
    """T_xy: the nearest vertex to each of X by position, normal and curvature.

    Args:
        bent: Y drawn onto X.
        x: the other surface.
        weight: of the curvature.
    """
    points, queries = (
        np.concatenate([t.tree.data, weight * t.curvature], 1) for t in (bent, x)
    )
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
    n, mass = len(y.vertices), vertex_areas(*x.mesh)
    side = _padded_surface(y, sign)
    size = len(side.mass)
    T_near, matched = T_xy, np.ones(len(mass), bool)
    for curvature_weight in CURVATURE_WEIGHTS:
        weight = mass * np.where(matched, 1, UNCOVERED_WEIGHT)
        pull = np.bincount(T_xy, weight, n)
        goal = np.zeros((n, 3))
        np.add.at(goal, T_xy, weight[:, None] * x.mesh.vertices)
        drawn_to = goal / np.maximum(pull, 1e-30)[:, None]
        goal = np.where(pull[:, None] > 0, drawn_to, moved)
        # A mass of 0 would be padding.
        pull += TINY * mass.sum() / n
        pulled = side._replace(mass=jnp.asarray(with_rows(pull, size)))
        rows = _rows(goal, size), _rows(moved, size)
        moved = np.asarray(deform(pulled, *rows, settings=BEND))[:n].astype(float)
        bent = target(wound(Mesh(moved, y.faces), sign), curvature)
        T_near, matched = nearest(bent, x.mesh.vertices, x.normal)
        T_xy = (
            nearest_by_curvature(bent, x, curvature_weight)
            if curvature_weight
            else T_near
        )
    return Drawn(moved, T_near, matched)


def covered_by(x: Target, y: Mesh, drawn: Drawn, sign: int = 1):
    """The nearest vertex of X to each of Y drawn onto it, and whether X covers that."""
    normal = sign * vertex_normals(drawn.moved, y.faces)
    return nearest(x, drawn.moved, normal)


def membership(
    onto: Target,
    points: np.ndarray,
    normal: np.ndarray,
    inside: np.ndarray,
) -> np.ndarray:
    """In [0, 1] for each point, above one half where the surface has it too.

    With r the distance to the nearest vertex, by position and normal as in the search
    for it, and d how far the point lies beyond the rim, below 0 inside, it is

        1 / (1 + (r / COVER_DISTANCE)^4 + exp(d / RIM_WIDTH)).

    Args:
        onto: a surface.
        points: (n, 3) vertices of the other surface, laid on this one.
        normal: (n, 3) unit normals of the other surface at these.
        inside: (m,) distance of each vertex of `onto` from its rim (`from_rim`).
    """
    away, near = map(np.asarray, onto.tree.query(_with_normals(points, normal)))
    out = onto.outward[near]
    size = np.linalg.norm(out, axis=1)
    step = np.sum((points - onto.mesh.vertices[near]) * out, 1)
    # Of one whose nearest vertex is not on the rim, that vertex's distance from it.
    beyond = np.where(size > 0, step / np.where(size > 0, size, 1), -inside[near])
    odds = (away / COVER_DISTANCE) ** 4 + np.exp(np.minimum(beyond / RIM_WIDTH, 50))
    return 1 / (1 + odds)


def memberships(
    x: Target, y: Mesh, moved: np.ndarray, sign: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """`membership` of the vertices of X, and of those of Y.

    Args:
        x: one surface.
        y: the other at rest.
        moved: positions of Y, drawn onto X.
        sign: -1 for a map that mirrors.
    """
    bent = target(wound(Mesh(moved, y.faces), sign))
    return (
        membership(bent, x.mesh.vertices, x.normal, from_rim(y)),
        membership(x, moved, bent.normal, from_rim(x.mesh)),
    )


def _with_normals(points, normal) -> np.ndarray:
    """(n, 6): points are near that face alike, too."""
    return np.concatenate([points, BEND.normal_weight * normal], 1)


def _padded_surface(x: Mesh, sign: int):
    """At a common size, so that few programs serve all cuts."""
    (size,) = padded_shapes(1, [(len(x.vertices), len(x.faces))])
    at, faces = with_rows(x.vertices, size.vertices), with_rows(x.faces, size.faces)
    mass = jnp.zeros(size.vertices)
    return surface(jnp.asarray(at), jnp.asarray(faces), mass, float(sign))


def _rows(values, size: int):
    return jnp.asarray(with_rows(np.asarray(values, float), size))
