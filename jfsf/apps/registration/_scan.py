"""A scan to be registered to: the nearest point of its surface that faces alike."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh import OnSurface
from jfsf.mesh._closest import SurfaceTree, nearest_of, surface_tree
from jfsf.mesh._geometry import vertex_normals
from jfsf.types import Mesh

CANDIDATES = 12  # pieces of the scan that are looked at for each point
NORMAL_WEIGHT = 0.05  # distance that normals at an angle of 1 count for, in sqrt(area)
MIN_ALIKE = 0.5  # least cosine of the angle between the normals


class Scan(NamedTuple):
    """A surface, and what finds its nearest points by position and normal.

    surface: see `surface_tree`.
    normal: (n, 3) unit normals of its vertices.
    piece_normal: (p, 3) unit normals of its pieces.
    tree: of centres and weighted normals of these.
    """

    surface: SurfaceTree
    normal: np.ndarray
    piece_normal: np.ndarray
    tree: KDTree


def scan_of(mesh: Mesh) -> Scan:
    """A scan, wound alike everywhere, in the unit of its sqrt(area)."""
    surface = surface_tree(mesh)
    normal = vertex_normals(*surface.mesh)
    mean = normal[surface.mesh.faces].sum(1)
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    piece_normal = (mean / np.where(size > 0, size, 1))[surface.owner]
    points = np.concatenate([surface.centre, NORMAL_WEIGHT * piece_normal], 1)
    return Scan(surface, normal, piece_normal, KDTree(points))


def facing(scan: Scan, points, normal) -> OnSurface:
    """The nearest point of the scan with a normal alike, for each point.

    Args:
        scan: `scan_of`.
        points: (q, 3).
        normal: (q, 3) unit normals.
    """
    k = min(CANDIDATES, len(scan.surface.owner))
    queries = np.concatenate([points, NORMAL_WEIGHT * normal], 1)
    piece = np.asarray(scan.tree.query(queries, np.arange(1, k + 1))[1]).ravel()
    row = np.repeat(np.arange(len(points)), k)
    alike = np.einsum("pd,pd->p", scan.piece_normal[piece], normal[row])
    kept = alike > MIN_ALIKE
    return nearest_of(scan.surface, points, row[kept], scan.surface.owner[piece[kept]])
