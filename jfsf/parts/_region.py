"""Which part of a shape another covers: one is bent onto the other as it is.

A vertex whose nearest vertex of the other surface lies on its boundary, on the outer
side, is not covered. So a part covers of the whole what lies below it, and the whole
covers all of the part.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from jfsf.geometry import surface
from jfsf.mesh import (
    Submesh,
    boundary_edges,
    largest_component,
    vertex_areas,
    vertex_normals,
)
from jfsf.parts._settings import PartSettings
from jfsf.parts._shape import PartSamples
from jfsf.refine import deform
from jfsf.runtime import padded_shapes, with_rows
from jfsf.types import Mesh


class Target(NamedTuple):
    """A surface at rest, and what finds its nearest vertices.

    outward: (n, 3) out of the surface, for vertices on its boundary; else 0.
    tree: of positions and weighted normals.
    settings: that it was made with, and that a shape is bent onto it with.
    """

    mesh: Mesh
    normal: np.ndarray
    outward: np.ndarray
    tree: KDTree
    settings: PartSettings


class Bent(NamedTuple):
    """A shape X bent onto Y.

    moved: (n_x, 3) positions.
    T_xy: (n_x,) the nearest vertex of Y to each.
    matched_x: (n_x,) whether Y covers it.
    """

    moved: np.ndarray
    T_xy: np.ndarray
    matched_x: np.ndarray


def target(mesh: Mesh, settings: PartSettings = PartSettings()) -> Target:
    """The surface to bend onto."""
    normal = vertex_normals(*mesh)
    outward = np.zeros_like(normal)
    ends = boundary_edges(mesh.faces)
    along = mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]
    # The face lies to the left of its edge, seen against the normal.
    for end in ends.T:
        np.add.at(outward, end, np.cross(along, normal[end]))
    points = np.concatenate([mesh.vertices, settings.bend.normal_weight * normal], 1)
    return Target(mesh, normal, outward, KDTree(points), settings)


def nearest(onto: Target, points, normal) -> tuple[np.ndarray, np.ndarray]:
    """The nearest vertex to each point, and whether the surface covers the point."""
    settings = onto.settings
    query = np.concatenate([points, settings.bend.normal_weight * normal], 1)
    away, near = onto.tree.query(query)
    step = points - onto.mesh.vertices[near]
    beyond = np.sum(step * onto.outward[near], 1) > 0
    return near, (away < settings.cover_distance) & ~beyond


def bend_onto(
    x: Mesh, y: Target, T_xy, sign: int = 1, *, rounds: int | None = None
) -> Bent:
    """X deformed onto Y as rigidly as possible, again and again.

    What Y does not cover is not drawn to it.

    Args:
        x: in the unit of Y, wound outward.
        y: `target`.
        T_xy: the start.
        sign: -1 for a map that mirrors.
        rounds: deformations, each followed by a search for the nearest vertices; None
            for those of the settings.
    """
    settings = y.settings
    n, mass = len(x.vertices), vertex_areas(*x)
    side = _padded_surface(x, sign, settings)
    size = len(side.mass)
    moved, matched = y.mesh.vertices[T_xy], np.ones(n, bool)
    for _ in range(settings.bend_rounds if rounds is None else rounds):
        pull = np.zeros(size)
        pull[:n] = mass * np.where(matched, 1, settings.uncovered_weight)
        goal, start = (_rows(v, size) for v in (y.mesh.vertices[T_xy], moved))
        pulled = side._replace(mass=jnp.asarray(pull))
        deformed = deform(pulled, goal, start, settings=settings.bend)
        moved = np.asarray(deformed)[:n].astype(float)
        T_xy, matched = nearest(y, moved, sign * vertex_normals(moved, x.faces))
    return Bent(moved, T_xy, matched)


def covered_by(bent: Bent, x: Mesh, y: Target, sign: int = 1):
    """The nearest vertex of the bent X to each of Y, and whether X covers that."""
    faces = x.faces if sign > 0 else x.faces[:, ::-1]
    bent_x = target(Mesh(bent.moved, faces), y.settings)
    return nearest(bent_x, y.mesh.vertices, y.normal)


def cut(mesh: Mesh, keep: np.ndarray) -> Submesh:
    """The largest piece of the faces whose corners are all kept."""
    faces = np.asarray(mesh.faces)
    return largest_component(Mesh(mesh.vertices, faces[keep[faces].all(1)]))


def dense_map(
    x: PartSamples,
    y: PartSamples,
    which,
    partner,
    scale: float,
    *,
    settings: PartSettings = PartSettings(),
) -> np.ndarray:
    """T_xy: the vertex of Y that is as far from the partners as X's from its samples.

    Near samples count most.

    Args:
        x, y: both shapes.
        which: samples of X.
        partner: samples of Y, -1 for none.
        scale: factor of X's lengths.
        settings: how much near samples count.
    """
    there = partner >= 0
    from_x, from_y = scale * x.distance[which[there]], y.distance[partner[there]]
    weight = 1 / (from_x + settings.anchor_radius) ** 2
    weight /= weight.sum(0)
    out, square = np.empty(from_x.shape[1], np.int64), from_y**2
    for rows in np.array_split(np.arange(len(out)), -(-len(out) // 1000)):
        w, d = weight[:, rows].T, from_x[:, rows].T
        out[rows] = (w @ square - 2 * (w * d) @ from_y).argmin(1)
    return out


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
