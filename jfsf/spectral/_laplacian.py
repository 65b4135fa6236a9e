"""Stiffness and lumped mass of a mesh or a point cloud. Host side.

W phi = lambda A phi. The stiffness W is the cotangent matrix of Pinkall and Polthier
(1993). The mass A is the mixed Voronoi area of Meyer et al. (2003), as in the paper's
code, or a third of the area of the triangles around a vertex. Meshes that are not clean
manifolds, and point clouds, get the tufted intrinsic Delaunay Laplacian of Sharp and
Crane (2020).
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
import robust_laplacian
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jfsf.mesh import MeshError, check
from jfsf.types import ArrayLike, Mesh

Laplacian = Literal["auto", "cotan", "robust"]
Mass = Literal["voronoi", "barycentric"]


def operators(
    mesh: Mesh,
    *,
    laplacian: Laplacian = "auto",
    mass: Mass = "voronoi",
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
    check_options("operators", laplacian, mass)
    mesh = plain_arrays(mesh)
    cloud = len(mesh.faces) == 0
    if cloud and laplacian == "cotan":
        raise MeshError("a point cloud has no cotangents", "pass laplacian='robust'")
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
            f"no Laplacian could be built ({error})", "points on a line, or too few"
        ) from error
    return pair[0].tocsr(), pair[1].diagonal()


def check_options(function: str, laplacian: str, mass: str) -> None:
    """ValueError in the name of `function` for an unknown Laplacian or mass."""
    if laplacian not in ("auto", "cotan", "robust"):
        raise ValueError(
            f"{function}: laplacian is 'auto', 'cotan' or 'robust', not {laplacian!r}"
        )
    if mass not in ("voronoi", "barycentric"):
        raise ValueError(
            f"{function}: mass is 'voronoi' or 'barycentric', not {mass!r}"
        )


def plain_arrays(mesh: Mesh) -> Mesh:
    """Both arrays by numpy in one precision: equal meshes get equal cache keys."""
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


def definite_solver(
    matrix: sp.spmatrix, ordering: Literal["MMD_AT_PLUS_A", "NATURAL"] = "MMD_AT_PLUS_A"
) -> Callable[[np.ndarray], np.ndarray]:
    """b -> matrix^-1 b, by one factor of the matrix.

    Args:
        matrix: symmetric and positive definite.
        ordering: "NATURAL" where rows and columns are ordered for little fill.
    """
    # No pivoting, and half the fill of the default ordering.
    factor = splu(
        sp.csc_matrix(matrix),
        permc_spec=ordering,
        diag_pivot_thresh=0,
        options={"SymmetricMode": True},
    )
    return factor.solve
