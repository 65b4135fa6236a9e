"""Reversible harmonic maps: smooth maps both ways that undo each other.

This file is long because it holds one published method whole.

Ezuz, Solomon and Ben-Chen, Reversible harmonic maps between discrete surfaces (ACM TOG
2019). Shapes have area 1, W and M are stiffness and lumped mass. E_x (n_x, 8) embeds X
so that Euclidean distances resemble its geodesic ones; precise maps P_xy (n_x, n_y),
whose rows are barycentric coordinates, pull E_y back to X. The energy is

    alpha     (|P_xy E_y|^2_Wx + |P_yx E_x|^2_Wy)               harmonic
  + (1-alpha) (|P_yx P_xy E_y - E_y|^2_My + |P_xy P_yx E_x - E_x|^2_Mx)  reversible.

Half-quadratic splitting replaces P_xy E_y by a free F_xy (n_x, 8) and adds
beta |F_xy - P_xy E_y|^2_Mx, likewise for yx. Each block then has an exact minimiser:

- F_xy: (alpha Wx + (1-alpha) P_yx^T My P_yx + beta Mx) F_xy
  = (1-alpha) P_yx^T My E_y + beta Mx P_xy E_y, sparse as the mesh;
- P_xy, row by row: the point nearest to [sqrt(1-alpha) E_x, sqrt(beta) F_xy] on the
  triangles of Y embedded by [sqrt(1-alpha) F_yx, sqrt(beta) E_y].

beta grows by its first value each round, up to 100 times it. Weights, schedule, number
of rounds and embedding follow R. Magnet's ReversibleHarmonicMaps, which names the
authors' program as its source for the schedule. Departures:

- It stops when the energy changes by less than 1e-9. Here the limit is 1e-7, after
  beta has stopped growing: on a pair of 5000 vertices 80 more rounds did not lower the
  error.
- The embedding is metric multidimensional scaling of the geodesic distances among 500
  points, extended to the other vertices with the least bi-Laplacian energy. Here it
  starts from classical scaling, not from random points, and the points are farthest
  points, not the vertices of a simplified mesh.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jfsf.convert import precise, to_vertex
from jfsf.geometry import geodesics
from jfsf.geometry._geodesics import vertex_indices
from jfsf.mesh._geometry import farthest_vertices, vertex_components
from jfsf.runtime._shared import one_blas_thread
from jfsf.spectral._laplacian import definite_solver, operators
from jfsf.types import ArrayLike, Maps, Mesh, PreciseMap

SAMPLES = 500  # points of the multidimensional scaling
LAG = 10  # half rounds over which the change of the energy is measured


class Reversible(NamedTuple):
    """Precise maps both ways, and how they were reached.

    pmap_xy: a point of Y for each vertex of X.
    pmap_yx: a point of X for each vertex of Y.
    energies: (2 rounds, 4), after each half round: harmonic, reversible and penalty
        terms with their weights, and their sum. While beta grows the sum may grow too.
    """

    pmap_xy: PreciseMap
    pmap_yx: PreciseMap
    energies: ArrayLike


class _Shape(NamedTuple):
    emb: np.ndarray
    faces: np.ndarray
    stiffness: sp.csr_matrix
    mass: np.ndarray


def rhm(
    mesh_x: Mesh,
    mesh_y: Mesh,
    maps: Maps,
    *,
    dim: int = 8,
    alpha: float = 5e-4,
    beta: float = 5e-3,
    growth: int = 100,
    num_iters: int = 200,
    tol: float = 1e-7,
) -> Maps:
    """Refine maps both ways; see `rhm_precise`, whose points it rounds to vertices.

    Returns:
        The corner of largest weight of each point.

    Raises:
        ValueError: as `rhm_precise`.
    """
    found = rhm_precise(
        mesh_x,
        mesh_y,
        maps,
        dim=dim,
        alpha=alpha,
        beta=beta,
        growth=growth,
        num_iters=num_iters,
        tol=tol,
    )
    return Maps(to_vertex(found.pmap_xy), to_vertex(found.pmap_yx))


def rhm_precise(
    mesh_x: Mesh,
    mesh_y: Mesh,
    maps: Maps,
    *,
    dim: int = 8,
    alpha: float = 5e-4,
    beta: float = 5e-3,
    growth: int = 100,
    num_iters: int = 200,
    tol: float = 1e-7,
) -> Reversible:
    """Refine maps both ways to vertex-to-point maps that are smooth and reversible.

    Args:
        mesh_x, mesh_y: connected triangle meshes, any unit of length.
        maps: the start; T_xy (n_x,) and T_yx (n_y,).
        dim: width of the embeddings.
        alpha: weight of the harmonic term, in (0, 1); reversibility has the rest.
        beta: weight of the penalty in the first round.
        growth: rounds in which the penalty grows; 1 keeps it as it is.
        num_iters: rounds, at most.
        tol: after the growth, stop when the energy changes by less in five rounds.

    Raises:
        ValueError: maps do not fit the meshes, a mesh has no faces or is not connected,
            or an option is out of range.
    """
    name = "rhm"
    _check_options(name, alpha, beta, growth, num_iters)
    T_xy, T_yx = _vertex_maps(name, mesh_x, mesh_y, maps)
    x, y = _shapes(name, mesh_x, mesh_y, dim)
    P_xy, P_yx = _selection(T_xy, len(y.mass)), _selection(T_yx, len(x.mass))
    F_xy, F_yx = P_xy @ y.emb, P_yx @ x.emb

    energies = []
    penalty = beta
    for i in range(num_iters):
        penalty = beta * min(i + 1, growth)
        P_yx = _matrix(_project(y, x, F_yx, F_xy, alpha, penalty), len(x.mass))
        F_yx = _solve(y, x, P_yx, P_xy, alpha, penalty)
        energies.append(_energies(x, y, P_xy, P_yx, F_xy, F_yx, alpha, penalty))
        P_xy = _matrix(_project(x, y, F_xy, F_yx, alpha, penalty), len(y.mass))
        F_xy = _solve(x, y, P_xy, P_yx, alpha, penalty)
        energies.append(_energies(x, y, P_xy, P_yx, F_xy, F_yx, alpha, penalty))
        # Before that, the growing penalty changes the energy.
        if 2 * (i + 1 - growth) >= LAG:
            if abs(energies[-1][3] - energies[-1 - LAG][3]) < tol:
                break
    pmap_yx = _project(y, x, F_yx, F_xy, alpha, penalty)
    pmap_xy = _project(x, y, F_xy, F_yx, alpha, penalty)
    return Reversible(pmap_xy, pmap_yx, np.array(energies))


def embed(mesh: Mesh, *, dim: int = 8, num_samples: int = SAMPLES) -> np.ndarray:
    """Points (n, dim) whose distances resemble the mesh's geodesic ones, at area 1.

    Args:
        mesh: connected triangle mesh.
        dim: coordinates a vertex, below the number of samples.
        num_samples: points of the scaling; all vertices if there are fewer.

    Raises:
        ValueError: the mesh has no faces or is not connected, or dim does not fit.
    """
    return _shape("embed", "mesh", mesh, dim, num_samples).emb


def rhm_energy(
    mesh_x: Mesh,
    mesh_y: Mesh,
    maps: Maps | tuple[PreciseMap, PreciseMap],
    *,
    dim: int = 8,
    alpha: float = 5e-4,
) -> tuple[float, float]:
    """Harmonic and reversible energy of maps, with their weights; no penalty.

    Args:
        mesh_x, mesh_y: connected triangle meshes.
        maps: vertex or precise maps, X to Y and Y to X.
        dim, alpha: as in `rhm_precise`.

    Raises:
        ValueError: as `rhm_precise`.
    """
    name = "rhm_energy"
    _check_options(name, alpha, 1.0, 1, 1)
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    if isinstance(maps, Maps):
        T_xy, T_yx = _vertex_maps(name, mesh_x, mesh_y, maps)
        P_xy, P_yx = _selection(T_xy, n_y), _selection(T_yx, n_x)
    else:
        P_xy, P_yx = _matrix(maps[0], n_y), _matrix(maps[1], n_x)
    x, y = _shapes(name, mesh_x, mesh_y, dim)
    F_xy, F_yx = P_xy @ y.emb, P_yx @ x.emb
    harmonic, reversible, *_ = _energies(x, y, P_xy, P_yx, F_xy, F_yx, alpha, 0)
    return harmonic, reversible


def _project(x, y, F_xy, F_yx, alpha, beta) -> PreciseMap:
    """P_xy: the best point of Y for each vertex of X."""
    there, back = np.sqrt(1 - alpha), np.sqrt(beta)
    queries = np.concatenate([there * x.emb, back * F_xy], 1)
    surface = np.concatenate([there * F_yx, back * y.emb], 1)
    return precise(jnp.asarray(queries), jnp.asarray(surface), jnp.asarray(y.faces))


def _solve(x, y, P_xy, P_yx, alpha, beta) -> np.ndarray:
    """F_xy of given maps."""
    back = P_yx.T @ sp.diags(y.mass)
    system = alpha * x.stiffness + (1 - alpha) * (back @ P_yx) + sp.diags(beta * x.mass)
    right = (1 - alpha) * (back @ y.emb) + beta * x.mass[:, None] * (P_xy @ y.emb)
    return definite_solver(system)(right)


def _energies(x, y, P_xy, P_yx, F_xy, F_yx, alpha, beta) -> tuple[float, ...]:
    harmonic = np.sum(F_xy * (x.stiffness @ F_xy)) + np.sum(F_yx * (y.stiffness @ F_yx))
    reversible = y.mass @ np.sum((P_yx @ F_xy - y.emb) ** 2, 1)
    reversible += x.mass @ np.sum((P_xy @ F_yx - x.emb) ** 2, 1)
    penalty = x.mass @ np.sum((F_xy - P_xy @ y.emb) ** 2, 1)
    penalty += y.mass @ np.sum((F_yx - P_yx @ x.emb) ** 2, 1)
    terms = alpha * harmonic, (1 - alpha) * reversible, beta * penalty
    return *terms, sum(terms)


def _selection(T_xy: np.ndarray, n_y: int) -> sp.csr_matrix:
    """P_xy of a vertex map."""
    n_x = len(T_xy)
    return sp.csr_matrix((np.ones(n_x), T_xy, np.arange(n_x + 1)), (n_x, n_y))


def _matrix(pmap: PreciseMap, n_y: int) -> sp.csr_matrix:
    """P_xy of a precise map."""
    corners, bary = np.asarray(pmap.corners), np.asarray(pmap.bary, np.float64)
    n_x = len(corners)
    ends = np.arange(0, 3 * n_x + 1, 3)
    return sp.csr_matrix((bary.ravel(), corners.ravel(), ends), (n_x, n_y))


def _shapes(name, mesh_x, mesh_y, dim):
    return _shape(name, "mesh_x", mesh_x, dim), _shape(name, "mesh_y", mesh_y, dim)


def _shape(name, argument, mesh: Mesh, dim: int, num_samples: int = SAMPLES) -> _Shape:
    vertices = np.asarray(mesh.vertices, np.float64)
    faces = np.asarray(mesh.faces, np.int32)
    if len(faces) == 0:
        raise ValueError(f"{name}: {argument} has 0 faces; give a triangle mesh")
    count = min(num_samples, len(vertices))
    if not 1 <= dim < count:
        raise ValueError(
            f"{name}: dim is {dim}, it must be in 1..{count - 1}: {argument} has "
            f"{count} samples"
        )
    _check_connected(name, argument, faces, len(vertices))
    stiffness, areas = operators(Mesh(vertices, faces))
    unit = np.sqrt(areas.sum())
    unit_mesh, mass = Mesh(vertices / unit, faces), areas / areas.sum()
    at = farthest_vertices(unit_mesh, count)
    dist = geodesics(unit_mesh, at)[:, at]
    # Small products: threads cost more than they bring.
    with one_blas_thread():
        scaled = _scaling((dist + dist.T) / 2, dim)

    emb = np.empty((len(vertices), dim))
    emb[at] = scaled
    rest = np.setdiff1d(np.arange(len(vertices)), at)
    if len(rest):
        energy = (stiffness @ sp.diags(1 / mass) @ stiffness).tocsr()[rest]
        emb[rest] = definite_solver(energy[:, rest])(-(energy[:, at] @ scaled))
    return _Shape(emb, faces, sp.csr_matrix(stiffness), mass)


def _check_connected(name, argument, faces, n):
    pieces = vertex_components(faces, n).max() + 1
    if pieces > 1:
        raise ValueError(
            f"{name}: {argument} has {pieces} pieces, geodesic distances between them "
            "are infinite; keep one"
        )


def _scaling(dist: np.ndarray, dim: int, *, num_iters: int = 1000, tol: float = 1e-6):
    """Points of least stress sum (|x_i - x_j| - d_ij)^2: SMACOF (de Leeuw 1977)."""
    n = len(dist)
    centred = dist**2 - (dist**2).mean(0)[None]
    gram = -(centred - centred.mean(1)[:, None]) / 2
    value, vector = np.linalg.eigh((gram + gram.T) / 2)
    points = vector[:, -dim:] * np.sqrt(np.maximum(value[-dim:], 0))[None]
    last = np.inf
    for _ in range(num_iters):
        square = np.sum(points**2, 1)
        found = square[:, None] + square[None] - 2 * points @ points.T
        found = np.sqrt(np.maximum(found, 0))
        stress = np.sum((found - dist) ** 2)
        if last - stress <= tol * stress:
            break
        last = stress
        # Coincident points have no direction from one to the other.
        ratio = np.divide(dist, found, out=np.zeros_like(dist), where=found > 1e-9)
        points = (ratio.sum(1)[:, None] * points - ratio @ points) / n
    return points


def _vertex_maps(name, mesh_x, mesh_y, maps):
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    T_xy = vertex_indices(name, "maps.T_xy", maps.T_xy, n_y)
    T_yx = vertex_indices(name, "maps.T_yx", maps.T_yx, n_x)
    if (len(T_xy), len(T_yx)) != (n_x, n_y):
        raise ValueError(
            f"{name}: maps have {len(T_xy)} and {len(T_yx)} entries, X and Y have "
            f"{n_x} and {n_y} vertices; are they swapped?"
        )
    return T_xy, T_yx


def _check_options(name, alpha, beta, growth, num_iters):
    if not 0 < alpha < 1:
        raise ValueError(f"{name}: alpha is {alpha}, it must be between 0 and 1")
    if not beta > 0:
        raise ValueError(f"{name}: beta is {beta}, it must be positive")
    if growth < 1 or num_iters < 1:
        raise ValueError(
            f"{name}: growth and num_iters must be 1 or more, got {growth} and "
            f"{num_iters}"
        )
