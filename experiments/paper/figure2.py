"""Figure 2 of Pai et al. (CVPR 2021): which matrix carries delta functions to points.

Two spheres, triangulated differently, are bent together (nearly isometric) or one is
swollen and pinched (far from it). The ground truth's adjoint D = C_yx^T and its
functional map C_xy each send the delta of every vertex of X to Y, where the nearest
delta is taken (eq. 5 against Ovsjanikov et al. 2012). Error over the basis size.

    python -m experiments.paper.figure2 --out experiments/results/figure2.json
"""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import trimesh
from scipy.spatial import ConvexHull, KDTree

from experiments import command_line, results_file
from jfsf.apps.plot._charts import Panel, draw_curves
from jfsf.convert import nearest
from jfsf.evaluate import geodesic_error
from jfsf.mesh._geometry import face_normals
from jfsf.spectral import functional_map, spectrum, truncate
from jfsf.types import Mesh, Spectrum

POINTS = 3000  # of the second sphere; the first is an icosphere of 2562
KS = tuple(range(20, 101, 10))
EVERY = 5  # one in so many vertices of X is measured


def main() -> None:
    parser = command_line.parser(__doc__, out="figure2.json")
    args = command_line.parse(parser)
    sphere_x, sphere_y = icosphere(), fibonacci(POINTS)
    x = posed(sphere_x, bent(sphere_x.vertices))
    once = bent(sphere_y.vertices)
    curves = {}
    for name, vertices in (
        ("near isometry", bent(once)),
        ("far from isometry", swollen(once)),
    ):
        curves[name] = errors(sphere_x, sphere_y, x, posed(sphere_y, vertices))
        print(name, curves[name])
    settings = {"ks": KS, "points": [len(sphere_x.vertices), POINTS], "every": EVERY}
    results_file.write(args.out, settings=settings, errors=curves)
    draw(curves, args.out.with_suffix(".png"))


def errors(sphere_x: Mesh, sphere_y: Mesh, x: Mesh, y: Mesh) -> dict[str, list[float]]:
    """Mean geodesic error on Y at each of `KS`, by either matrix."""
    T_xy = np.asarray(KDTree(sphere_y.vertices).query(sphere_x.vertices)[1], np.int32)
    T_yx = np.asarray(KDTree(sphere_x.vertices).query(sphere_y.vertices)[1], np.int32)
    spec_x, spec_y = (_spectrum(mesh) for mesh in (x, y))
    at = np.arange(0, len(T_xy), EVERY)
    found = {"adjoint": [], "functional map": []}
    for k in KS:
        low_x, low_y = truncate(spec_x, k), truncate(spec_y, k)
        C_yx = functional_map(jnp.asarray(T_xy), low_x, low_y)
        C_xy = functional_map(jnp.asarray(T_yx), low_y, low_x)
        for name, matrix in (("adjoint", C_yx.T), ("functional map", C_xy)):
            maps = nearest(low_x.evecs @ matrix.T, low_y.evecs)
            error = geodesic_error(np.asarray(maps.T_xy), y, at, T_xy[at])
            found[name].append(float(error.mean()))
    return found


def icosphere() -> Mesh:
    """2562 vertices, nearly uniform."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32))


def fibonacci(n: int) -> Mesh:
    """The convex hull of n points on a spiral."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    r = np.sqrt(1 - z**2)
    points = np.stack([r * np.cos(angle), r * np.sin(angle), z], 1)
    faces = ConvexHull(points).simplices
    normal = face_normals(points, faces)
    inward = np.einsum("ij,ij->i", normal, points[faces].sum(1)) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces.astype(np.int32))


def posed(mesh: Mesh, vertices: np.ndarray) -> Mesh:
    """The same triangles elsewhere."""
    return mesh._replace(vertices=vertices)


def bent(points: np.ndarray) -> np.ndarray:
    """An ellipsoid without symmetry, so that every eigenvalue is simple."""
    x, y, z = (points * (1.6, 1.0, 0.8)).T
    return np.stack([x, y + 0.25 * x**2, z + 0.15 * x * y + 0.1 * x], 1)


def swollen(points: np.ndarray) -> np.ndarray:
    """One end blown up, the other pinched: areas change some fiftyfold."""
    x = points[:, :1]
    return points * np.exp(np.tanh(3 * x))


def _spectrum(mesh: Mesh) -> Spectrum:
    spec = spectrum(mesh, KS[-1])
    return Spectrum(
        *(jnp.asarray(a, a.dtype if a.dtype.kind == "i" else "float32") for a in spec)
    )


def draw(curves: dict, path: Path) -> None:
    """Two panels, error over basis size."""
    axes = "eigenfunctions", "mean geodesic error / sqrt(area)"
    panels = [
        Panel({label: (KS, row) for label, row in lines.items()}, *axes, title=name)
        for name, lines in curves.items()
    ]
    draw_curves(panels, path=path)


if __name__ == "__main__":
    main()
