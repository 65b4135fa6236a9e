"""Files for situations.py: small bodies, and what people's files have beside a shape.

`situation_formats.py` writes them; `situation_reading.py`, `situation_commands.py` and
`situation_carried.py` say what is run on them.
"""

from functools import cache
from typing import Any, NamedTuple

import fast_simplification
import numpy as np
import trimesh
from damages import nonmanifold
from scipy.spatial import KDTree

from jfsf import data
from jfsf.data import Sample
from jfsf.mesh import face_normals
from jfsf.types import Mesh

# About 1200 and 1150 vertices, of X and of Y: padded to 1280 all of them, so that
# programs compile once. With these numbers all bodies are manifolds.
FACES = {"x": 2400, "y": 2300}
BASE = "man_t"  # y up, facing z
NO_FACES = np.zeros((0, 3), np.int32)
NAMES = "left hand", "right hand", "头", "pied gauche é", "right foot"


class Contents(NamedTuple):
    """What a file holds: a body, and more.

    mesh: all of it.
    body: with the template's points.
    at: (n,) the vertex of `mesh` at each vertex of the body.
    """

    mesh: Mesh
    body: Sample
    at: np.ndarray  # type: ignore


@cache
def body(name: str, side: str = "x") -> Contents:
    """An embedded body with few faces, a closed manifold."""
    sample = data.load(name)
    points, faces, *_ = fast_simplification.simplify(
        sample.mesh.vertices.astype(np.float32),
        sample.mesh.faces,
        target_count=FACES[side],
        agg=4,
    )
    mesh = Mesh(np.asarray(points, float), np.asarray(faces, np.int32))
    near = np.asarray(KDTree(mesh.vertices).query(sample.mesh.vertices)[1])
    small = Sample(mesh, near[sample.template_to_vertex])
    return Contents(mesh, small, np.arange(len(mesh.vertices)))


def beside(own: Contents, points, faces: Any = NO_FACES) -> Contents:
    """With other vertices before its own, and faces between these."""
    more, (vertices, corners) = len(points), own.mesh
    both = np.concatenate([np.asarray(faces), corners + more])
    mesh = Mesh(np.concatenate([points, vertices]), both.astype(np.int32))
    return own._replace(mesh=mesh, at=own.at + more)


def with_body(own: Contents, other: Contents) -> Contents:
    """A smaller body at its side."""
    low, high = own.mesh.vertices.min(0), own.mesh.vertices.max(0)
    place = [1.5 * (high - low)[0], 0, 0]
    return beside(own, 0.6 * other.mesh.vertices + place, other.mesh.faces)


def with_strays(own: Contents, number: int) -> Contents:
    """Vertices of no face, in space around it."""
    rng = np.random.default_rng(number)
    return beside(own, rng.uniform(-1.5, 1.5, (number, 3)))


def with_triangle(own: Contents) -> Contents:
    """A triangle in front of it."""
    return beside(own, [[0.0, 0, 2], [0.1, 0, 2], [0, 0.1, 2]], [[0, 1, 2]])


def with_nan(own: Contents, number: int) -> Contents:
    """Some vertices of the body without a position."""
    vertices = own.mesh.vertices.copy()
    vertices[np.random.default_rng(0).permutation(len(vertices))[:number]] = np.nan
    return own._replace(mesh=Mesh(vertices, own.mesh.faces))


def cloud(own: Contents) -> Contents:
    """Its vertices alone."""
    return own._replace(mesh=Mesh(own.mesh.vertices, NO_FACES))


def with_outliers(own: Contents, share: float) -> Contents:
    """A cloud with points anywhere in its box, made wider by a tenth to each side."""
    points = own.mesh.vertices
    low, high = points.min(0), points.max(0)
    margin = (high - low) / 10
    number = round(share * len(points))
    rng = np.random.default_rng(0)
    return beside(cloud(own), rng.uniform(low - margin, high + margin, (number, 3)))


def with_floor(own: Contents, number: int, axis: int) -> Contents:
    """A cloud on a noisy square, as a scanner sees the floor, or a wall behind."""
    points, rng = own.mesh.vertices, np.random.default_rng(0)
    low, size = points.min(0), np.ptp(points, axis=0).max()
    square = rng.uniform(-0.7 * size, 0.7 * size, (number, 3)) + points.mean(0)
    square[:, axis] = low[axis] + 0.003 * size * rng.normal(size=number)
    return beside(cloud(own), square)


def torn(own: Contents, tunnels: int, pieces: int, edges: int) -> Contents:
    """As scans of bones are: tunnels through it, crumbs inside, edges of three faces.

    Tunnels join faces that lie opposite each other.
    """
    rng = np.random.default_rng(0)
    vertices, faces = own.mesh
    centre, normal = vertices[faces].mean(1), face_normals(vertices, faces)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    gone: list[int] = []
    walls: list[list[int]] = []
    used: set[int] = set()
    for i in rng.permutation(len(faces)):
        to = centre - centre[i]
        far = np.linalg.norm(to, axis=1) + 1e-9
        # Straight behind, facing away, and not a whole body's depth off.
        behind = (to @ -normal[i] > 0.95 * far) & (normal @ normal[i] < -0.8)
        far = np.where(behind & (far < 0.3), far, np.inf)
        j = int(far.argmin())
        corners = {*faces[i].tolist(), *faces[j].tolist()}
        if len(walls) == 6 * tunnels:
            break
        if np.isfinite(far[j]) and used.isdisjoint(corners):
            used |= corners
            gone += [int(i), j]
            walls += _tunnel(vertices, faces[i], faces[j])
    mesh = Mesh(vertices, np.concatenate([np.delete(faces, gone, 0), walls]))
    flapped = nonmanifold(own.body._replace(mesh=mesh), rng, edges=edges).mesh
    shape = own._replace(mesh=Mesh(flapped.vertices, flapped.faces.astype(np.int32)))
    for _ in range(pieces):
        crumb = trimesh.creation.icosphere(subdivisions=1, radius=0.02)
        where = vertices[rng.integers(len(vertices))]
        shape = beside(shape, crumb.vertices + where, crumb.faces)
    return shape


def _tunnel(vertices, one, other) -> list[list[int]]:
    """Faces between the rims that two faces leave."""
    turns = [np.roll(other[::-1], i) for i in range(3)]
    other = min(turns, key=lambda b: np.linalg.norm(vertices[one] - vertices[b]))
    found = []
    for i in range(3):
        a, b = one[i], one[(i + 1) % 3]
        c, d = other[(i + 1) % 3], other[i]
        found += [[a, b, c], [a, c, d]]
    return np.array(found).tolist()


def darts(own: Mesh) -> list[list[list[float]]]:
    """Polygons of the same surface: of one in ten triangles a concave quad and a rest.

    A quad begins at a corner from which a fan would fold over.
    """
    polygons = list(own.vertices[np.delete(own.faces, np.s_[::10], 0)])
    for a, b, c in own.vertices[own.faces[::10]]:
        middle = (a + b + c) / 3
        polygons += [[b, middle, c, a], [b, c, middle]]
    return [[point.tolist() for point in polygon] for polygon in polygons]


def landmark_vertices(own: Contents) -> np.ndarray:
    """Vertices of the body at `NAMES`: the template points farthest to each side."""
    base = data.load(BASE)
    x, y, _ = base.mesh.vertices[base.template_to_vertex].T
    sides = x, -x, y, x - 3 * y, -x - 3 * y
    return own.body.template_to_vertex[[int(side.argmax()) for side in sides]]
