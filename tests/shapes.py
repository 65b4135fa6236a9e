"""Meshes and settings that many tests share, and how meshes are written."""

from functools import cache

import fast_simplification
import numpy as np
import trimesh
from scipy.spatial import KDTree

from jfsf import SearchSettings, Settings
from jfsf.data import Sample, load
from jfsf.types import Mesh

# A match by small programs, where neither the search nor the details are under test.
SMALL = Settings(
    k=40,
    ks=(30, 40),
    bend_rounds=3,
    retry_below=0,
    search=SearchSettings(samples=60, final_samples=100, assignments=20),
)


@cache
def small(name, faces):
    """A decimated body, and its vertex for each template point."""
    mesh, vertex = load(name)
    points, corners = fast_simplification.simplify(
        mesh.vertices.astype(np.float32), mesh.faces, target_count=faces
    )
    near = np.asarray(KDTree(points).query(mesh.vertices)[1])
    return Mesh(points.astype(np.float64), corners.astype(np.int32)), near[vertex]


@cache
def manifold(name):
    """One of two bodies, decimated without harm, and large enough for a sure map."""
    body = load(name)
    points, faces = fast_simplification.simplify(
        *body.mesh, target_count={"man_walk": 1400, "man_up": 1340}[name], agg=3
    )
    template = body.mesh.vertices[body.template_to_vertex]
    mesh = Mesh(points.astype(np.float64), faces.astype(np.int32))
    return Sample(mesh, np.asarray(KDTree(mesh.vertices).query(template)[1]))


def sphere(subdivisions=2):
    """The unit sphere: 12, 42, 162, 642 or 2562 vertices."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Mesh(np.array(ball.vertices), np.array(ball.faces, np.int32))


def bumpy(seed=0, subdivisions=2):
    """An ellipsoid without symmetry, whose bumps are higher than `testing.blob`'s."""
    (v, faces), rng = sphere(subdivisions), np.random.default_rng(seed)
    bumps = 1 + 0.2 * np.sin(v @ rng.normal(size=(3, 4)) * 2) @ rng.normal(size=4)
    return Mesh(v * bumps[:, None] * [1.0, 1.4, 2.0], faces)


def write_off(path, mesh):
    """With all digits."""
    with path.open("w") as file:
        file.write(f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n")
        np.savetxt(file, mesh.vertices, "%.17g")
        np.savetxt(file, np.insert(mesh.faces, 0, 3, axis=1), "%d")


def frozen(mesh):
    """The mesh, whose arrays cannot be written to."""
    for array in mesh:
        array.flags.writeable = False
    return mesh
