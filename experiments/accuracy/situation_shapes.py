"""Shapes for situations.py: made from the embedded bodies, or from formulas.

Bodies: mirrored ones with a swollen arm, and crops of their heads, remeshed. Formulas:
surfaces with symmetries, and some that have nothing in common with each other.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, Delaunay, KDTree

from jfsf import data
from jfsf.geometry import geodesics
from jfsf.mesh import decimate, largest_component, surface_area
from jfsf.mesh._edit import rims
from jfsf.mesh._geometry import boundary_edges
from jfsf.testing import mirror
from jfsf.types import Mesh

POSE = "man_t"  # of the template in which tips are found: y up, facing z
HEAD = 0.1, 0.7  # |x| and y between which the head is in that pose
# In sqrt(area) of a body: radius of a crop around the nose; how far an arm is swollen,
# from the tip of the hand on, and by how much.
FACE, ARM, SWELLING = 0.11, (0.1, 0.4), 0.03
LEAST_POINTS = 4  # of a vertex that counts as ground truth
Shaping = Callable[[np.ndarray], np.ndarray]


class Case(NamedTuple):
    """A pair, and the vertices of X and Y that correspond; None where nothing does."""

    name: str
    x: Mesh
    y: Mesh
    truth: tuple[np.ndarray, np.ndarray] | None = None


class Known(NamedTuple):
    """A mesh with template points.

    vertex: for each of these the vertex of the mesh; -1 where it has none.
    points: where each lies, on the surface or near it.
    """

    mesh: Mesh
    vertex: np.ndarray  # type: ignore
    points: np.ndarray  # type: ignore


@cache
def tips() -> dict[str, int]:
    """The template points of the left hand and of the nose."""
    mesh, vertex = data.load(POSE)
    points = mesh.vertices[vertex]
    wide, neck = HEAD
    head = (abs(points[:, 0]) < wide) & (points[:, 1] > neck)
    front = np.where(head, points[:, 2], -np.inf)
    return {"hand": int(points[:, 0].argmax()), "nose": int(front.argmax())}


@cache
def swollen(name: str) -> Known:
    """An embedded body whose left arm is swollen."""
    mesh, vertex = data.load(name)
    unit = np.sqrt(surface_area(mesh))
    away = geodesics(mesh, vertex[[tips()["hand"]]])[0] / unit
    low, high = ARM
    edge = 0.05
    inside = (1 + np.tanh((away - low) / edge)) * (1 + np.tanh((high - away) / edge))
    normals = trimesh.Trimesh(*mesh, process=False).vertex_normals
    moved = mesh.vertices + (SWELLING * unit * inside / 4)[:, None] * normals
    return Known(Mesh(moved, mesh.faces), vertex, moved[vertex])


@cache
def face(name: str, seed: int) -> Known:
    """The face of an embedded body, remeshed and turned at random."""
    rng = np.random.default_rng(seed)
    mesh, vertex = data.load(name)
    radius = FACE * rng.uniform(0.95, 1.05) * np.sqrt(surface_area(mesh))
    inside = geodesics(mesh, vertex[[tips()["nose"]]])[0] < radius
    kept = mesh.faces[inside[mesh.faces].all(1)]
    part = largest_component(Mesh(mesh.vertices, _without_tongues(kept)))
    fine = trimesh.remesh.subdivide_loop(*_capped(part.mesh), iterations=2)
    turn = rotation(rng)
    turned = Mesh(fine[0] @ turn.T, np.asarray(fine[1], np.int32))
    new = decimate(turned, int(rng.integers(1400, 2000)))
    near = np.asarray(KDTree(new.vertices).query(mesh.vertices @ turn.T)[1])
    at = np.isin(vertex, part.index)
    points = mesh.vertices[vertex] @ turn.T
    return Known(new, np.where(at, near[vertex], -1), points)


def _without_tongues(faces: np.ndarray) -> np.ndarray:
    """Without faces that hang by one edge or one vertex, time and again."""
    while True:
        rim = np.zeros(faces.max() + 1, bool)
        rim[boundary_edges(faces)] = True
        hangs = rim[faces].all(1)
        if not hangs.any():
            return faces.astype(np.int32)
        faces = faces[~hangs]


def _capped(mesh: Mesh) -> Mesh:
    """All rims closed but the longest: an open mouth."""
    points, faces = list(mesh.vertices), mesh.faces.tolist()
    for rim in sorted(rims(mesh.faces), key=len)[:-1]:
        points.append(mesh.vertices[rim].mean(0))
        ends = zip(rim, [*rim[1:], rim[0]], strict=True)
        faces += [(a, b, len(points) - 1) for a, b in ends]
    return Mesh(np.array(points), np.array(faces, np.int32))


def pair(name: str, x: Known, y: Known) -> Case:
    """Two meshes with template points in common.

    Several of these share a vertex, so each is up to half an edge of the body away. A
    vertex of X goes to the mean place on Y of its points: that is more precise.
    """
    both = (x.vertex >= 0) & (y.vertex >= 0)
    at, number = x.vertex[both], len(x.mesh.vertices)
    count = np.bincount(at, minlength=number)
    total = [np.bincount(at, column, number) for column in y.points[both].T]
    known = np.flatnonzero(count >= LEAST_POINTS)
    place = np.stack(total, 1)[known] / count[known, None]
    near = np.asarray(KDTree(y.mesh.vertices).query(place)[1])
    return Case(name, x.mesh, y.mesh, (known, near))


def mirrored(shape: Known) -> Known:
    """Its mirror image."""
    return shape._replace(
        mesh=mirror(shape.mesh), points=shape.points * [-1.0, 1.0, 1.0]
    )


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn))


def ball(shaping: Shaping, n: int, rng: np.random.Generator) -> Mesh:
    """The image of the unit sphere, of n vertices spread evenly there, and turned."""
    i = np.arange(n) + 0.5
    height, angle = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i + rng.uniform(0, 7)
    wide = np.sqrt(1 - height**2)
    points = np.stack([wide * np.cos(angle), wide * np.sin(angle), height], 1)
    # Other triangles each time: the poles of the spiral lie elsewhere.
    points = points @ rotation(rng).T
    faces = ConvexHull(points).simplices
    corners = points[faces]
    inward = np.linalg.det(corners) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(shaping(points) @ rotation(rng).T, faces.astype(np.int32))


def ellipsoid(*axes: float) -> Shaping:
    """Half axes."""
    return lambda points: points * np.array(axes)


def tube(length: float, knobs: float = 0.0, side: float = 0.0) -> Shaping:
    """A rod of radius 1; with knobs, and one to a side, it is like a thigh bone.

    The two ends are then unlike, and it differs from its mirror image.
    """

    def shape(points):
        height = points[:, 2]
        round_, cap = np.hypot(points[:, 0], points[:, 1]), 0.85
        beyond = np.clip((abs(height) - cap) / (1 - cap), 0, 1)
        wide = np.where(beyond > 0, np.sqrt(1 - beyond**2), 1)
        across = points[:, :2] / np.maximum(round_, 1e-9)[:, None] * wide[:, None]
        along = length * np.sign(height) * np.minimum(abs(height), cap) / cap
        along = along + np.sign(height) * beyond
        x, y = across.T
        t = along / (length + 1)
        x = x * (1 + knobs * np.exp(-(((t + 0.85) / 0.2) ** 2)))
        x = x + 1.5 * side * np.exp(-(((t - 0.9) / 0.12) ** 2)) * np.maximum(x, 0)
        # Condyles behind, one larger, and bumps in front: of another shape mirrored.
        wider = np.where(x > 0, 2.0, 0.7) * knobs
        y = y + wider * np.exp(-(((t + 0.85) / 0.15) ** 2)) * np.minimum(y, 0)
        y = y + 1.2 * side * np.exp(-(((t - 0.5) / 0.15) ** 2)) * np.maximum(y, 0)
        return np.stack([x, y + 0.15 * knobs * length * t**2, along], 1)

    return shape


def kidney(points: np.ndarray) -> np.ndarray:
    """An ellipsoid that is bent."""
    x, y, z = (points * [1.0, 0.6, 1.7]).T
    bend = 0.45
    return np.stack(
        [(x + 1 / bend) * np.cos(bend * z), y, (x + 1 / bend) * np.sin(bend * z)], 1
    )


def block(points: np.ndarray) -> np.ndarray:
    """A box with round edges."""
    return (
        1.2 * points / (abs(points) ** 6).sum(1, keepdims=True) ** (1 / 6) * [1, 2, 0.6]
    )


def torus(thin: float, rows: int, columns: int, rng: np.random.Generator) -> Mesh:
    """Of revolution; `thin` is the radius of the tube over that of the ring."""
    u = (np.arange(columns)[None] + 0.5 * (np.arange(rows) % 2)[:, None]) / columns
    v = np.broadcast_to(np.arange(rows)[:, None] / rows, u.shape)
    u, v = 2 * np.pi * (u.ravel() + rng.uniform()), 2 * np.pi * v.ravel()
    ring = 1 + thin * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), thin * np.sin(v)], 1)
    number = np.arange(rows * columns).reshape(rows, columns)
    here, right = number, np.roll(number, -1, 1)
    up, up_right = np.roll(number, -1, 0), np.roll(np.roll(number, -1, 0), -1, 1)
    # A row of odd number lies half a step to the right: the one above to the left.
    odd = (np.arange(rows) % 2 == 1)[:, None]
    first = np.where(
        odd[..., None],
        np.stack([here, right, up_right], 2),
        np.stack([here, right, up], 2),
    )
    second = np.where(
        odd[..., None],
        np.stack([here, up_right, up], 2),
        np.stack([right, up_right, up], 2),
    )
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    return Mesh(points @ rotation(rng).T, faces.astype(np.int32))


def dome(height: float, n: int, rng: np.random.Generator) -> Mesh:
    """A disk of revolution: every turn about its axis is an isometry."""
    i = np.arange(n) + 0.5
    radius, angle = np.sqrt(i / n), np.pi * (1 + 5**0.5) * i + rng.uniform(0, 7)
    # A ring of vertices: an even rim.
    rim = (
        2
        * np.pi
        * (np.arange(int(3.5 * np.sqrt(n))) + rng.uniform())
        / int(3.5 * np.sqrt(n))
    )
    inside = radius < 1 - 0.7 / np.sqrt(n)
    radius = np.concatenate([radius[inside], np.ones(len(rim))])
    angle = np.concatenate([angle[inside], rim])
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    faces = Delaunay(flat).simplices
    corners = flat[faces]
    sides = corners[:, 1:] - corners[:, :1]
    area = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    faces = np.where((area < 0)[:, None], faces[:, ::-1], faces)[abs(area) > 1e-9]
    points = np.concatenate([flat, height * (1 - radius**2)[:, None]], 1)
    return Mesh(points @ rotation(rng).T, faces.astype(np.int32))
