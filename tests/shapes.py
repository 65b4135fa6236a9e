"""Embedded bodies with few faces, and their ground truth."""

from functools import cache

import fast_simplification
import numpy as np
from scipy.spatial import KDTree

from jfsf.data import load
from jfsf.types import Mesh


@cache
def small(name, faces):
    """A decimated body, and its vertex for each template point."""
    mesh, vertex = load(name)
    points, corners = fast_simplification.simplify(
        mesh.vertices.astype(np.float32), mesh.faces, target_count=faces
    )
    near = np.asarray(KDTree(points).query(mesh.vertices)[1])
    return Mesh(points.astype(np.float64), corners.astype(np.int32)), near[vertex]
