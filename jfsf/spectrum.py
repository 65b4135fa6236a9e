"""Mesh -> Spectrum: Laplacian, lumped mass and its first eigenpairs. Host side.

W phi = lambda A phi. The stiffness W is the cotangent matrix of Pinkall and Polthier
(1993), the mass A the mixed Voronoi area of Meyer et al. (2003) as in the paper's code,
or a third of the triangles around. Meshes that are not clean manifolds, and point
clouds, go through the tufted intrinsic Delaunay Laplacian of Sharp and Crane (2020).
"""

from typing import Literal

import numpy as np
import robust_laplacian
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, splu
from threadpoolctl import threadpool_limits

from jfsf import cache as disk
from jfsf.mesh import MeshError, check, validate
from jfsf.types import ArrayLike, Mesh, Spectrum

# Of the unit-area Laplacian, whose first nonzero eigenvalue is of order 10: far enough
# below 0 to factor safely, near enough for fast convergence.
SHIFT = -0.01
# Vertices above which it pays to order the factor by nested dissection (METIS): at
# 100 000 it takes a fifth of minimum degree's time, and each solve less than half.
DISSECTED = 50_000
# Part of the cache key: raise it when the same mesh is to give other numbers.
VERSION = 3


def spectrum(
    mesh: Mesh,
    k: int = 200,
    *,
    laplacian: Literal["auto", "cotan", "robust"] = "auto",
    mass: Literal["voronoi", "barycentric"] = "voronoi",
    cache: bool = True,
    name: str = "mesh",
) -> Spectrum:
    """The first k eigenpairs of the Laplace-Beltrami operator of `mesh` at area 1.

    Args:
        mesh: one connected component, every vertex used; any unit of length.
        k: number of eigenpairs, the constant included; at most one a vertex.
        laplacian: "auto" takes "cotan" for a clean manifold and "robust" otherwise
            (non-manifold, degenerate or repeated faces, point clouds).
        mass: lumped areas for "cotan"; "robust" brings its own.
        cache: keep the result in the user's cache folder (`cache.folder`), keyed by the
            mesh's content and the settings.
        name: opens the message of a MeshError: the file, or the argument.

    Returns:
        numpy arrays, float64 and int32: evals (k,) ascending, evals[0] = 0; evecs
        (n, k) mass-orthonormal, evecs[:, 0] = 1; mass (n,), sums to 1; the mesh's
        faces. The same mesh gives the same bits again; signs, and bases of repeated
        eigenvalues, may differ on another machine. 1.3 s at n = 5000, k = 200.

    Raises:
        MeshError: what `validate` finds, a vertex without area, a Laplacian that falls
            apart or is not finite, or eigenpairs that did not converge.
        ValueError: an unknown option, or k below 1.
    """
    _check_options("spectrum", laplacian, mass)
    if k < 1:
        raise ValueError(f"spectrum: k is {k}, it must be 1 or more")
    validate(mesh, k=k, name=name)
    mesh = _plain(mesh)

    def compute():
        try:
            return _spectrum(mesh, k, laplacian, mass)
        except MeshError as error:
            raise MeshError(f"{name}: {error}") from error

    if not cache:
        return compute()
    key = disk.key("spectrum", VERSION, *mesh, int(k), laplacian, mass)
    return disk.fetch(key, Spectrum, compute)


def operators(
    mesh: Mesh,
    *,
    laplacian: Literal["auto", "cotan", "robust"] = "auto",
    mass: Literal["voronoi", "barycentric"] = "voronoi",
) -> tuple[sp.csr_matrix, ArrayLike]:
    """Stiffness and lumped mass, as `spectrum` takes them before scaling.

    Args:
        mesh: values as `jfsf.mesh.validate` wants them.
        laplacian, mass: as in `spectrum`.

    Returns:
        Stiffness (n, n), symmetric, positive semidefinite, rows sum to 0, no unit; and
        areas (n,) in squared mesh units, which sum to the area of the mesh with "cotan"
        and closely with "robust".

    Raises:
        MeshError: "cotan" for a point cloud, or points that span no surface.
        ValueError: an unknown option.
    """
    _check_options("operators", laplacian, mass)
    mesh = _plain(mesh)
    cloud = len(mesh.faces) == 0
    if cloud and laplacian == "cotan":
        raise MeshError("a point cloud has no cotangents; pass laplacian='robust'")
    if laplacian == "cotan" or laplacian == "auto" and _is_clean(mesh):
        return _cotan(mesh, mass)
    try:
        if cloud:
            near = min(30, len(mesh.vertices) - 1)
            pair = robust_laplacian.point_cloud_laplacian(
                mesh.vertices, n_neighbors=near
            )
        else:
            pair = robust_laplacian.mesh_laplacian(mesh.vertices, mesh.faces)
    except RuntimeError as error:
        raise MeshError(
            f"no Laplacian could be built ({error}); points on a line, or too few"
        ) from error
    return pair[0].tocsr(), pair[1].diagonal()


def _check_options(function, laplacian, mass):
    if laplacian not in ("auto", "cotan", "robust"):
        raise ValueError(
            f"{function}: laplacian is 'auto', 'cotan' or 'robust', not {laplacian!r}"
        )
    if mass not in ("voronoi", "barycentric"):
        raise ValueError(
            f"{function}: mass is 'voronoi' or 'barycentric', not {mass!r}"
        )


def _plain(mesh):
    # One key and one precision, whatever holds the numbers.
    return Mesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32))


def _is_clean(mesh):
    if len(mesh.faces) == 0:
        return False
    report = check(mesh)
    return not (
        report.nonmanifold_edges
        or report.nonmanifold_vertices
        or report.degenerate_faces
        or report.duplicate_faces
    )


def _cotan(mesh, mass):
    v, f = mesh.vertices, mesh.faces
    n = len(v)
    # Edge c is opposite to corner c: it joins corners c + 1 and c + 2.
    edge = [v[f[:, (c + 2) % 3]] - v[f[:, (c + 1) % 3]] for c in range(3)]
    area2 = np.linalg.norm(np.cross(edge[0], edge[1]), axis=1)
    # A degenerate face gives numbers that are not finite: `_spectrum` looks for them.
    with np.errstate(divide="ignore", invalid="ignore"):
        cot = [-(edge[c - 2] * edge[c - 1]).sum(1) / area2 for c in range(3)]
        voronoi = [(edge[c] ** 2).sum(1) * cot[c] / 8 for c in range(3)]

    i = np.concatenate([f[:, (c + 1) % 3] for c in range(3)])
    j = np.concatenate([f[:, (c + 2) % 3] for c in range(3)])
    half = sp.coo_matrix((np.concatenate(cot) / 2, (i, j)), (n, n)).tocsr()
    off = half + half.T
    stiffness = (sp.diags(np.asarray(off.sum(1)).ravel()) - off).tocsr()

    if mass == "barycentric":
        share = [area2 / 6] * 3
    else:
        obtuse = np.stack(cot) < 0
        share = [
            np.where(
                obtuse.any(0),
                np.where(obtuse[c], area2 / 4, area2 / 8),
                voronoi[c - 2] + voronoi[c - 1],
            )
            for c in range(3)
        ]
    areas = sum(np.bincount(f[:, c], share[c], n) for c in range(3))
    return stiffness, areas


def _spectrum(mesh, k, laplacian, mass):
    # Neither very large nor very small units overflow.
    low, high = mesh.vertices.min(0) / 2, mesh.vertices.max(0) / 2
    scaled = Mesh((mesh.vertices / 2 - low) / (high - low).max(), mesh.faces)
    stiffness, areas = operators(scaled, laplacian=laplacian, mass=mass)
    if not (np.isfinite(stiffness.data).all() and np.isfinite(areas).all()):
        raise MeshError("has faces without area; remove them or pass laplacian='auto'")
    if areas.min() <= 0:
        raise MeshError(
            f"vertex {areas.argmin()} has area {areas.min():.3g}; remove degenerate "
            "faces, or pass laplacian='robust'"
        )
    pieces = connected_components(stiffness, directed=False)[0]
    if pieces > 1:
        raise MeshError(f"its Laplacian falls into {pieces} pieces; keep one of them")

    # Stiffness does not change with scale in 2D; the mass alone carries the units.
    unit = np.sqrt(areas.sum())
    areas = areas / areas.sum()
    vertices = (scaled.vertices - areas @ scaled.vertices) / unit
    root = sp.diags(1 / np.sqrt(areas))
    symmetric = (root @ stiffness @ root).tocsc()
    # The products are long and thin: threads cost more than they bring, and on a busy
    # machine 20 times as much.
    with threadpool_limits(1, user_api="blas"):
        # Lanczos gains nothing where most pairs are asked for, and cannot give all.
        if 2 * k > len(areas):
            evals, evecs = np.linalg.eigh(symmetric.toarray())
        else:
            evals, evecs = _shift_invert(symmetric, k)
    evals = np.maximum(evals[:k], 0)
    evecs = evecs[:, :k] / np.sqrt(areas)[:, None]
    evals[0], evecs[:, 0] = 0, 1
    return Spectrum(evals, evecs, areas, mesh.faces.copy(), vertices)  # type: ignore


def _shift_invert(symmetric, k):
    n = symmetric.shape[0]
    solve = _factor((symmetric - SHIFT * sp.identity(n)).tocsc())
    inverse = LinearOperator((n, n), matvec=solve, dtype=float)  # type: ignore
    start = np.random.default_rng(0).normal(size=n)
    # A smaller basis than the usual 2 k takes as many solves and less work on each.
    ncv = min(n, max(20, k + k // 2))
    try:
        # To the last digit: copies of an eigenvalue, as symmetric shapes have, appear
        # only by rounding, and a looser tolerance stops before they do.
        evals, evecs = eigsh(
            symmetric, k, sigma=SHIFT, OPinv=inverse, v0=start, ncv=ncv
        )
    except ArpackNoConvergence as error:
        raise MeshError(
            f"only {len(error.eigenvalues)} of {k} eigenpairs converged; pass "
            "laplacian='robust', or remesh the thinnest triangles"
        ) from error
    order = np.argsort(evals)
    return evals[order], evecs[:, order]


def _factor(matrix):
    """b -> matrix^-1 b."""
    # Positive definite: no pivoting, and half the fill of the default ordering.
    definite = {"diag_pivot_thresh": 0, "options": {"SymmetricMode": True}}
    order = _dissection(matrix) if matrix.shape[0] > DISSECTED else None
    if order is None:
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", **definite).solve
    factor = splu(matrix[order][:, order].tocsc(), permc_spec="NATURAL", **definite)

    def solve(b):
        x = np.empty_like(b)
        x[order] = factor.solve(b[order])
        return x

    return solve


def _dissection(matrix):
    """Rows in the order of nested dissection; None where METIS is not installed."""
    try:
        import pymetis
    except ImportError:
        return None
    graph = matrix.copy()
    graph.setdiag(0)
    graph.eliminate_zeros()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    return np.asarray(pymetis.nested_dissection(adjacency)[0])
