"""Maps between two disks, such as faces, that turn the rim. Host side (numpy).

Turns of a disk are all nearly isometric, and its first eigenfunctions are those of a
circle, so the search finds some turn. Each disk is laid out in the plane by harmonic
functions, with the rim on a circle by its length (Tutte 1963; Eck et al., SIGGRAPH
1995). A turn of the plane is a map then. Those whose images lie nearest to the points
themselves, after a rigid motion, are kept: the relief of a surface decides.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse.linalg import spsolve
from scipy.spatial import KDTree

from jfsf.matching._rigid import motion
from jfsf.mesh._edit import rims
from jfsf.mesh._geometry import boundary_edges, edges
from jfsf.runtime._sizes import surface_of
from jfsf.spectral._laplacian import operators
from jfsf.types import ArrayLike, Mesh, Spectrum

# A rim is one if it is at least so long, in sqrt(area): that of a flat round disk has
# 3.5, the hole where a body was cut at the neck 0.3.
LEAST_RIM = 1.5
TURNS = 24
# Iterations of nearest points and rigid motions after a turn.
MOTIONS = 6
# Vertices at which turns are compared.
FEW = 300
# Maps that are kept, and how far apart they are, in sqrt(area).
KEPT, APART = 3, 0.15


class Disk(NamedTuple):
    """A surface with one long rim, in space and in the plane.

    points: its vertices in space, in sqrt(area).
    flat: in the unit disk, the rim on its circle; counterclockwise from outside.
    share: of each vertex in the area.
    """

    points: Float[ArrayLike, "n 3"]
    flat: Float[ArrayLike, "n 2"]
    share: Float[ArrayLike, " n"]


def is_disk(spec: Spectrum) -> bool:
    """Whether a shape is a surface with one long rim, and no handle."""
    return bool(_surface_of(spec)[2])


def as_disk(spec: Spectrum) -> Disk:
    """The disk that a shape is. Padding is left out.

    Args:
        spec: of a shape that `is_disk`.
    """
    points, faces, rim = _surface_of(spec)
    sides = _sides(points, rim)
    angle = 2 * np.pi * np.cumsum(sides) / sides.sum()
    flat = np.zeros((len(points), 2))
    flat[rim] = np.stack([np.cos(angle), np.sin(angle)], 1)
    inner = np.ones(len(points), bool)
    inner[rim] = False
    operator, mass = operators(Mesh(points, faces))
    stiffness: Any = operator
    right = -stiffness[inner][:, rim] @ flat[rim]
    solved: Any = spsolve(stiffness[inner][:, inner].tocsc(), right)
    flat[inner] = solved
    return Disk(points, flat, np.asarray(mass / mass.sum()))


def turned_maps(x: Disk, y: Disk, *, mirrors: bool = False) -> list[np.ndarray]:
    """The best maps T_xy, (n_x,), of all turns of the rim, the best first.

    Args:
        x, y: both disks.
        mirrors: whether the maps are to swap left and right.
    """
    in_plane, in_space = KDTree(y.flat), KDTree(y.points)
    few_x, few_y = _few(x), _few(y)
    flat = few_x.flat * [1, -1] if mirrors else few_x.flat
    found = []
    for angle in 2 * np.pi * np.arange(TURNS) / TURNS:
        c, s = np.cos(angle), np.sin(angle)
        at: Any = in_plane.query(flat @ np.array([[c, s], [-s, c]]))[1]
        move = motion(few_x.points, y.points[at], few_x.share, mirrors=mirrors)
        for _ in range(MOTIONS - 1):
            at = in_space.query(move(few_x.points))[1]
            move = motion(few_x.points, y.points[at], few_x.share, mirrors=mirrors)
        there, at = in_space.query(move(few_x.points))
        back = KDTree(move(few_x.points)).query(few_y.points)[0]
        cost = np.sqrt(few_x.share @ there**2) + np.sqrt(few_y.share @ back**2)
        found.append((cost, y.points[at], move))
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    for _, images, move in sorted(found, key=lambda one: one[0]):
        away = [few_x.share @ np.linalg.norm(images - i, axis=1) for i, _ in kept]
        if len(kept) < KEPT and min(away, default=np.inf) > APART:
            T_xy: Any = in_space.query(move(x.points))[1]
            kept.append((images, T_xy))
    return [T_xy for _, T_xy in kept]


def _few(disk: Disk) -> Disk:
    """At some of its vertices."""
    rng = np.random.default_rng(0)
    some = rng.permutation(len(disk.points))[:FEW]
    points, flat, share = (values[some] for values in disk)
    return Disk(points, flat, share / share.sum())


def _surface_of(spec: Spectrum) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Points, faces, and the rim if the shape is a disk, else none."""
    points, faces = surface_of(spec)
    n = len(points)
    # Along the winding.
    closed = [rim[::-1] for rim in rims(faces)]
    if sum(map(len, closed)) < len(boundary_edges(faces)):  # rims touch
        return points, faces, []
    long_rims = [rim for rim in closed if _sides(points, rim).sum() >= LEAST_RIM]
    # With all rims closed a disk is a sphere.
    euler = n - len(edges(faces).ends) + len(faces) + len(closed)
    is_one = euler == 2 and len(long_rims) == 1
    return points, faces, long_rims[0] if is_one else []


def _sides(points: np.ndarray, rim: list[int]) -> np.ndarray:
    """Length of each side, from the vertex before."""
    return np.linalg.norm(points[rim] - np.roll(points[rim], 1, axis=0), axis=1)
