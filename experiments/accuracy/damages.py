"""Damage to a mesh: noise, spikes, holes, cuts, bad faces, other samplings and sizes.

Each function takes an embedded shape and a random generator, and returns the damaged
mesh with the vertex of it at each old one. The old mesh stays as it is.
"""

from typing import NamedTuple

import fast_simplification
import numpy as np
from scipy.spatial import KDTree

from experiments.bench.upsample import upsample
from jfsf import data
from jfsf.data import Sample
from jfsf.geometry import geodesics
from jfsf.matching.parts import cut
from jfsf.mesh import surface_area
from jfsf.types import Mesh

# Beyond this share of the width of a body in T-pose is arm, measured from the middle.
ARM = 0.36
TEMPLATE_POSE = "man_t"


class Damaged(NamedTuple):
    """A damaged mesh.

    index: (n,) the damaged mesh's vertex at each old one, -1 where none is left.
    """

    mesh: Mesh
    index: np.ndarray  # type: ignore


def clean(sample: Sample, rng: np.random.Generator) -> Damaged:
    """No damage."""
    return Damaged(sample.mesh, np.arange(len(sample.mesh.vertices)))


def noise(sample: Sample, rng: np.random.Generator, *, size: float) -> Damaged:
    """Gaussian noise on each coordinate, of deviation `size` in sqrt(area)."""
    vertices, faces = sample.mesh
    step = rng.normal(size=vertices.shape) * size * np.sqrt(surface_area(sample.mesh))
    return clean(sample, rng)._replace(mesh=Mesh(vertices + step, faces))


def spikes(sample: Sample, rng: np.random.Generator, *, number: int) -> Damaged:
    """Some vertices moved by half of sqrt(area), each in a direction of its own."""
    vertices, faces = sample.mesh
    at = rng.choice(len(vertices), number, replace=False)
    away = rng.normal(size=(number, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    moved = vertices.copy()
    moved[at] += away * np.sqrt(surface_area(sample.mesh)) / 2
    return clean(sample, rng)._replace(mesh=Mesh(moved, faces))


def holes(
    sample: Sample, rng: np.random.Generator, *, number: int, radius: float
) -> Damaged:
    """Geodesic balls cut out, of a radius in sqrt(area)."""
    mesh = sample.mesh
    at = rng.choice(len(mesh.vertices), number, replace=False)
    far = geodesics(mesh, at) > radius * np.sqrt(surface_area(mesh))
    return _kept(mesh, far.all(0))


def one_arm(sample: Sample, rng: np.random.Generator) -> Damaged:
    """The left arm cut off at the shoulder."""
    mesh = sample.mesh
    pose = data.load(TEMPLATE_POSE)
    across = pose.mesh.vertices[pose.template_to_vertex, 0]
    middle = (across.max() + across.min()) / 2
    arm = across - middle > ARM / 2 * np.ptp(across)
    # Three vertices in ten have no template point: that of the nearest with one.
    points = mesh.vertices[sample.template_to_vertex]
    return _kept(mesh, ~arm[KDTree(points).query(mesh.vertices)[1]])


def doubled_face(sample: Sample, rng: np.random.Generator) -> Damaged:
    """One face twice."""
    vertices, faces = sample.mesh
    more = np.concatenate([faces, faces[[rng.integers(len(faces))]]])
    return clean(sample, rng)._replace(mesh=Mesh(vertices, more))


def fin(sample: Sample, rng: np.random.Generator) -> Damaged:
    """A face that stands on an edge between two others, its tip a new vertex."""
    vertices, faces = sample.mesh
    face = faces[rng.integers(len(faces))]
    a, b, c = vertices[face]
    normal = np.cross(b - a, c - a)
    # As high as its edge is long.
    height = np.linalg.norm(b - a) * normal / np.linalg.norm(normal)
    tip = (a + b) / 2 + height
    more = np.concatenate([faces, [[*face[:2], len(vertices)]]])
    mesh = Mesh(np.concatenate([vertices, [tip]]), more.astype(faces.dtype))
    return clean(sample, rng)._replace(mesh=mesh)


def flipped(sample: Sample, rng: np.random.Generator, *, number: int) -> Damaged:
    """Some faces wound the other way."""
    vertices, faces = sample.mesh
    at = rng.choice(len(faces), number, replace=False)
    wound = faces.copy()
    wound[at] = faces[at, ::-1]
    return clean(sample, rng)._replace(mesh=Mesh(vertices, wound))


def nonmanifold(sample: Sample, rng: np.random.Generator, *, edges: int) -> Damaged:
    """So many edges with three faces, an even number: a flap across an edge makes two.

    Flaps are apart: no two of them share a vertex.
    """
    vertices, faces = sample.mesh
    sides = np.concatenate([faces, np.roll(faces, -1, 1), np.roll(faces, 1, 1)])
    # The vertices on both sides of an edge (a, b): faces (a, b, c) and (b, a, d).
    opposite = {(a, b): c for a, b, c in sides.tolist()}
    more, used = [], set()
    for a, b, c in sides[rng.permutation(len(sides))].tolist():
        d = opposite.get((b, a))
        # An edge from c to d would have three faces, too.
        if d is None or (c, d) in opposite or (d, c) in opposite:
            continue
        if len(more) < edges // 2 and used.isdisjoint({a, b, c, d}):
            more.append([a, d, c])
            used |= {a, b, c, d}
    flaps = np.array(more, faces.dtype).reshape(-1, 3)
    return clean(sample, rng)._replace(mesh=Mesh(vertices, np.r_[faces, flaps]))


def half_thinned(sample: Sample, rng: np.random.Generator, *, to: float) -> Damaged:
    """The upper half of the vertices thinned to a share, by edge collapses."""
    vertices = sample.mesh.vertices
    upper = vertices[:, 1] > np.median(vertices[:, 1])
    return _collapsed(sample.mesh, round(to * len(sample.mesh.faces)), upper)


def coarse(sample: Sample, rng: np.random.Generator, *, n: int) -> Damaged:
    """About n vertices left, by edge collapses."""
    # A closed surface has twice as many faces as vertices.
    return _collapsed(sample.mesh, 2 * n)


def fine(sample: Sample, rng: np.random.Generator, *, n: int) -> Damaged:
    """The same surface with n vertices, by splits of the longest edges."""
    return clean(sample, rng)._replace(mesh=upsample(sample.mesh, n))


def cloud(sample: Sample, rng: np.random.Generator) -> Damaged:
    """The vertices alone."""
    points = Mesh(sample.mesh.vertices, sample.mesh.faces[:0])
    return clean(sample, rng)._replace(mesh=points)


def _kept(mesh: Mesh, keep: np.ndarray) -> Damaged:
    """The largest component of the faces whose corners are all kept."""
    part, old = cut(mesh, keep)
    index = np.full(len(keep), -1)
    index[old] = np.arange(len(old))
    return Damaged(part, index)


def _collapsed(mesh: Mesh, faces: int, where: np.ndarray | None = None) -> Damaged:
    """Edges between vertices `where` collapsed, as if the mesh had so many faces."""
    *_, edges = fast_simplification.simplify(
        *mesh, target_count=faces, agg=5, return_collapses=True
    )
    if where is not None:
        edges = edges[where[edges].all(1)]
    points, corners, group = fast_simplification.replay_simplification(
        *mesh, np.ascontiguousarray(edges)
    )
    points = np.asarray(points, np.float64)
    # Of the vertices that became one, the nearest to it is there still.
    gap = np.linalg.norm(mesh.vertices - points[group], axis=1)
    order = np.lexsort((gap, group))
    first = order[np.unique(group[order], return_index=True)[1]]
    index = np.full(len(group), -1)
    index[first] = group[first]
    return Damaged(Mesh(points, np.asarray(corners, np.int32)), index)
