"""Mesh -> Spectrum: Laplacian, lumped mass and its first eigenpairs. Host side.

The stiffness is the cotangent matrix of Pinkall and Polthier (1993), the mass the
mixed Voronoi area of Meyer et al. (2003) as in the paper's code, or a third of the
triangles around. Meshes that are not clean manifolds, and point clouds, go through the
tufted intrinsic Delaunay Laplacian of Sharp and Crane (2020).
"""

from typing import Literal

import numpy as np
import robust_laplacian
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh, splu

from jfsf import cache as disk
from jfsf.mesh import MeshError, check, validate
from jfsf.types import Mesh, Spectrum

# Of the unit-area Laplacian, whose first nonzero eigenvalue is of order 10: far enough
# below 0 to factor safely, near enough for fast convergence.
SHIFT = -0.01


def spectrum(
    mesh: Mesh,
    k: int = 200,
    *,
    laplacian: Literal["auto", "cotan", "robust"] = "auto",
    mass: Literal["voronoi", "barycentric"] = "voronoi",
    cache: bool = True,
) -> Spectrum:
    """The first k eigenpairs of the Laplace-Beltrami operator of `mesh` at area 1.

    Args:
        mesh: one connected component, every vertex used; any unit of length.
        k: number of eigenpairs, the constant included; fewer than vertices.
        laplacian: "auto" takes "cotan" for a clean manifold and "robust" otherwise
            (non-manifold or degenerate faces, point clouds).
        mass: lumped areas for "cotan"; "robust" brings its own.
        cache: keep the result in the user's cache folder, keyed by the mesh's content
            and the settings.

    Returns:
        float64 numpy arrays; evecs mass-orthonormal, evals ascending, evecs[:, 0] = 1.

    Raises:
        MeshError: what `validate` finds, or eigenpairs that did not converge.
        ValueError: an unknown option.
    """
    if laplacian not in ("auto", "cotan", "robust"):
        raise ValueError(f"spectrum: laplacian is 'auto', 'cotan' or 'robust', not "
                         f"{laplacian!r}")
    if mass not in ("voronoi", "barycentric"):
        raise ValueError(f"spectrum: mass is 'voronoi' or 'barycentric', not {mass!r}")
    validate(mesh, k=k)
    if not cache:
        return _spectrum(mesh, k, laplacian, mass)
    key = disk.key(*mesh, "spectrum", k, laplacian, mass, SHIFT)
    return disk.fetch(key, Spectrum, lambda: _spectrum(mesh, k, laplacian, mass))


def operators(
    mesh: Mesh,
    *,
    laplacian: Literal["auto", "cotan", "robust"] = "auto",
    mass: Literal["voronoi", "barycentric"] = "voronoi",
) -> tuple[sp.csr_matrix, np.ndarray]:
    """Stiffness (n, n), positive semidefinite, and lumped mass (n,), in mesh units."""
    if laplacian == "auto":
        laplacian = "cotan" if _is_clean(mesh) else "robust"
    if len(mesh.faces) == 0:
        stiffness, areas = robust_laplacian.point_cloud_laplacian(mesh.vertices)
        return stiffness.tocsr(), areas.diagonal()
    if laplacian == "robust":
        stiffness, areas = robust_laplacian.mesh_laplacian(mesh.vertices, mesh.faces)
        return stiffness.tocsr(), areas.diagonal()
    return _cotan(mesh, mass)


def _is_clean(mesh: Mesh) -> bool:
    if len(mesh.faces) == 0:
        return False
    report = check(mesh)
    return not (
        report.nonmanifold_edges
        or report.nonmanifold_vertices
        or report.degenerate_faces
        or report.duplicate_faces
    )


def _cotan(mesh: Mesh, mass: str) -> tuple[sp.csr_matrix, np.ndarray]:
    v, f = mesh.vertices, mesh.faces
    n = len(v)
    # Edge c is opposite to corner c: it joins corners c + 1 and c + 2.
    edge = [v[f[:, (c + 2) % 3]] - v[f[:, (c + 1) % 3]] for c in range(3)]
    area2 = np.linalg.norm(np.cross(edge[0], edge[1]), axis=1)
    cot = [-np.sum(edge[(c + 1) % 3] * edge[(c + 2) % 3], 1) / area2 for c in range(3)]

    i = np.concatenate([f[:, (c + 1) % 3] for c in range(3)])
    j = np.concatenate([f[:, (c + 2) % 3] for c in range(3)])
    w = np.concatenate(cot) / 2
    off = sp.coo_matrix((w, (i, j)), (n, n)).tocsr()
    off = off + off.T
    stiffness = (sp.diags(np.asarray(off.sum(1)).ravel()) - off).tocsr()

    if mass == "barycentric":
        share = [area2 / 6] * 3
    else:
        voronoi = [np.sum(edge[c] ** 2, 1) * cot[c] / 8 for c in range(3)]
        obtuse = np.stack(cot) < 0
        share = [
            np.where(
                obtuse.any(0),
                np.where(obtuse[c], area2 / 4, area2 / 8),
                voronoi[(c + 1) % 3] + voronoi[(c + 2) % 3],
            )
            for c in range(3)
        ]
    areas = sum(np.bincount(f[:, c], share[c], n) for c in range(3))
    return stiffness, np.asarray(areas)


def _spectrum(mesh: Mesh, k: int, laplacian, mass) -> Spectrum:
    stiffness, areas = operators(mesh, laplacian=laplacian, mass=mass)
    if areas.min() <= 0:
        raise MeshError(
            f"vertex {areas.argmin()} has area {areas.min():.3g}: remove degenerate "
            "faces, or pass laplacian='robust'"
        )
    # Stiffness does not change with scale in 2D; the mass alone carries the units.
    mass_x = areas / areas.sum()
    root = sp.diags(1 / np.sqrt(mass_x))
    symmetric = (root @ stiffness @ root).tocsc()
    n = len(mass_x)
    if k > n // 2:
        # Lanczos gains nothing here and fails outright for k = n.
        evals, evecs = np.linalg.eigh(symmetric.toarray())
        evals, evecs = evals[:k], evecs[:, :k]
    else:
        evals, evecs = _shift_invert(symmetric, k)
    evecs = evecs / np.sqrt(mass_x)[:, None]
    evals[0], evecs[:, 0] = 0, 1
    return Spectrum(np.maximum(evals, 0), evecs, mass_x, mesh.faces.astype(np.int32))


def _shift_invert(symmetric: sp.csc_matrix, k: int) -> tuple[np.ndarray, np.ndarray]:
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator

    n = symmetric.shape[0]
    # The shifted matrix is positive definite: no pivoting, and half the fill of the
    # default ordering.
    factor = splu(
        (symmetric - SHIFT * sp.identity(n)).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0,
        options={"SymmetricMode": True},
    )
    inverse = LinearOperator((n, n), matvec=factor.solve, dtype=float)  # type: ignore
    start = np.random.default_rng(0).normal(size=n)
    try:
        evals, evecs = eigsh(symmetric, k, sigma=SHIFT, OPinv=inverse, v0=start)
    except ArpackNoConvergence as error:
        raise MeshError(
            f"only {len(error.eigenvalues)} of {k} eigenpairs converged: pass "
            "laplacian='robust', or remesh the thinnest triangles"
        ) from error
    order = np.argsort(evals)
    return evals[order], evecs[:, order]
