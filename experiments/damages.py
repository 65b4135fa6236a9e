"""Damage to a mesh: noise, spikes, holes, cuts, uneven sampling, other sizes.

Each function takes an embedded shape and a random generator, and returns the damaged
mesh with the vertex of it at each old one. The old mesh stays as it is.
"""

from typing import NamedTuple

import fast_simplification
import numpy as np
from scipy.spatial import KDTree
from upsample import upsample

from jfsf import data
from jfsf.data import Sample
from jfsf.geometry import geodesics
from jfsf.mesh import surface_area
from jfsf.parts import cut
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
