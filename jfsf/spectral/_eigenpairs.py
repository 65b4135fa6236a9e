"""Mesh -> Spectrum: the first eigenpairs of its Laplace-Beltrami operator. Host side.

W phi = lambda A phi by shift-invert Lanczos on M^-1/2 W M^-1/2, which is factored once.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from jfsf.mesh import MeshError, validate
from jfsf.mesh._geometry import in_unit_box
from jfsf.runtime._shared import one_blas_thread
from jfsf.spectral._lanczos import largest_eigenpairs
from jfsf.spectral._laplacian import (
    Laplacian,
    Mass,
    check_options,
    definite_solver,
    operators,
    plain_arrays,
)
from jfsf.storage import key
from jfsf.storage._cache import fetch
from jfsf.types import Mesh, Spectrum

# Of the unit-area Laplacian, whose first nonzero eigenvalue is of order 10. Nearer to
# 0, the constant function's image is so large that its rounding errors spoil the basis;
# further away, eigenvalues lie closer together.
SHIFT = -10.0
# Vertices above which the factor is ordered by nested dissection (METIS): at 100 000
# this takes a fifth of the time of minimum degree, and each solve less than half.
DISSECTION_ABOVE = 50_000
# Of the residuals: eigenvalues are then right to 1e-4 or better (1e-6 on scans), and
# maps as good as with all digits.
TOL = 1e-3
# Tolerances from here up are met with a basis in float32, which large shapes get: its
# rounding errors are some 1e-5 of the eigenvalues.
SINGLE = 1e-4
# Vectors in a block of Lanczos. Small blocks need fewer vectors in all, but those of
# large shapes wait for memory, which a block shares.
BLOCK, LARGE_BLOCK = 8, 16
# Part of the cache key: raise it when the same mesh is to give other numbers.
VERSION = 5


def spectrum(
    mesh: Mesh,
    k: int = 200,
    *,
    laplacian: Laplacian = "auto",
    mass: Mass = "voronoi",
    tol: float = TOL,
    cache: bool = True,
    name: str = "mesh",
) -> Spectrum:
    """The first k eigenpairs of the Laplace-Beltrami operator of `mesh` at area 1.

    Args:
        mesh: one connected component, every vertex used; any unit of length.
        k: number of eigenpairs, the constant included; at most one for each vertex.
        laplacian: "auto" takes "cotan" for a clean manifold and "robust" otherwise
            (non-manifold, degenerate or repeated faces, point clouds).
        mass: lumped areas for "cotan"; "robust" brings its own.
        tol: tolerance of the residuals, see `largest_eigenpairs`. With the default,
            eigenvalues are right to 1e-4, and so is the space of all eigenvectors but
            the last tenth; maps are as good as with more digits. 1e-9 gives eight of
            them, in more time; below 1e-4 meshes of more than 50 000 vertices take more
            memory.
        cache: keep the result in the user's cache folder (`cache.folder`), keyed by the
            mesh's content and the settings.
        name: opens the message of a MeshError: the file, or the argument.

    Returns:
        numpy arrays, float64 and int32: evals (k,) ascending, evals[0] = 0; evecs
        (n, k) mass-orthonormal, evecs[:, 0] = 1; mass (n,), sums to 1; the mesh's
        faces. The same mesh gives the same bits again; signs, and bases of repeated
        eigenvalues, may differ on another machine.

    Raises:
        MeshError: what `validate` finds, a vertex without area, a Laplacian that falls
            apart or is not finite, or eigenpairs that did not converge.
        ValueError: an unknown option, k below 1, or tol not above 0.
    """
    check_options("spectrum", laplacian, mass)
    if k < 1:
        raise ValueError(f"spectrum: k is {k}, it must be 1 or more")
    if not tol > 0:
        raise ValueError(f"spectrum: tol is {tol}, it must be above 0")
    validate(mesh, k=k, name=name)
    return spectrum_of_valid(
        mesh, k, laplacian=laplacian, mass=mass, tol=tol, cache=cache, name=name
    )


def spectrum_of_valid(
    mesh: Mesh,
    k: int,
    *,
    laplacian: Laplacian = "auto",
    mass: Mass = "voronoi",
    tol: float = TOL,
    cache: bool = True,
    name: str = "mesh",
    threads: bool = True,
) -> Spectrum:
    """`spectrum` of a mesh that `jfsf.mesh.validate` has accepted with this k.

    threads: as in `largest_eigenpairs`.
    """
    mesh = plain_arrays(mesh)

    def compute():
        try:
            return _spectrum(mesh, k, laplacian, mass, tol, threads)
        except MeshError as error:
            raise error.named(name) from error

    if not cache:
        return compute()
    name_on_disk = key("spectrum", VERSION, *mesh, int(k), laplacian, mass, tol)
    return fetch(name_on_disk, Spectrum, compute)


def _spectrum(mesh, k, laplacian, mass, tol, threads):
    scaled = Mesh(in_unit_box(mesh.vertices), mesh.faces)
    stiffness, areas = operators(scaled, laplacian=laplacian, mass=mass)
    _check_operators(stiffness, areas)

    # Stiffness does not change with scale in 2D; the mass alone carries the units.
    unit = np.sqrt(areas.sum())
    areas = areas / areas.sum()
    vertices = (scaled.vertices - areas @ scaled.vertices) / unit
    root = sp.diags(1 / np.sqrt(areas))
    symmetric = (root @ stiffness @ root).tocsc()
    # The products are long and thin: threads cost more than they bring, and on a busy
    # machine 20 times as much.
    with one_blas_thread():
        # Lanczos gains nothing where most pairs are asked for, and cannot give all.
        if 2 * k > len(areas):
            evals, evecs = np.linalg.eigh(symmetric.toarray())
        else:
            evals, evecs = _shift_invert(symmetric, k, tol, threads=threads)
    evals = np.maximum(evals[:k], 0)
    single = evecs.dtype == np.float32
    evecs = evecs[:, :k] / np.sqrt(areas)[:, None]
    evals[0], evecs[:, 0] = 0, 1
    if single:
        # Orthonormal to 1e-5 so far.
        gram = (evecs * areas[:, None]).T @ evecs
        evecs = evecs @ np.linalg.inv(np.linalg.cholesky(gram)).T
        evecs[:, 0] = 1
    return Spectrum(evals, evecs, areas, mesh.faces.copy(), vertices)  # type: ignore


def _check_operators(stiffness, areas):
    """MeshError unless these are operators of one connected surface."""
    if not (np.isfinite(stiffness.data).all() and np.isfinite(areas).all()):
        raise MeshError(
            "has faces without area", "remove them or pass laplacian='auto'"
        )
    if areas.min() <= 0:
        raise MeshError(
            f"vertex {areas.argmin()} has area {areas.min():.3g}",
            "remove degenerate faces, or pass laplacian='robust'",
        )
    pieces = connected_components(stiffness, directed=False)[0]
    if pieces > 1:
        raise MeshError(f"its Laplacian falls into {pieces} pieces", "keep one of them")


def _shift_invert(
    symmetric, k, tol=TOL, *, threads=True, dissection_above=DISSECTION_ABOVE
):
    """The first k eigenpairs."""
    n = symmetric.shape[0]
    solve = _factor((symmetric - SHIFT * sp.identity(n)).tocsc(), dissection_above)
    rng = np.random.default_rng(0)
    block = BLOCK if n <= dissection_above else LARGE_BLOCK
    # Of a large shape, the basis takes most of the memory.
    single = tol >= SINGLE and n > dissection_above
    start = rng.normal(size=(block, n)).astype(np.float32 if single else np.float64)
    # Solves in float32 are no faster at 100 000 vertices, and the lowest eigenvalues
    # would be off by 6e-5.
    exact = lambda columns: solve(columns.astype(np.float64, copy=False))
    eigenpairs = largest_eigenpairs(exact, start, k, tol=tol, threads=threads)
    if eigenpairs is None:
        eigenpairs = _arpack(solve, k, rng.normal(size=n))
    inverse, evecs = eigenpairs
    return SHIFT + 1 / inverse, evecs


def _arpack(solve, k, start, *, max_restarts=None):
    """By restarted Lanczos, `max_restarts` times; ARPACK's own limit if None.

    Slower, and it gives up later.
    """
    n = len(start)
    inverse = LinearOperator((n, n), matvec=solve, dtype=float)  # type: ignore
    # A smaller basis than the usual 2 k takes as many solves and less work on each.
    ncv = min(n, max(20, k + k // 2))
    try:
        evals, evecs = eigsh(inverse, k, v0=start, ncv=ncv, maxiter=max_restarts)
    except ArpackNoConvergence as error:
        raise MeshError(
            f"only {len(error.eigenvalues)} of {k} eigenpairs converged",
            "pass laplacian='robust', or remesh the thinnest triangles",
        ) from error
    order = np.argsort(-evals)
    return evals[order], evecs[:, order]


def _factor(matrix, dissection_above):
    """b -> matrix^-1 b."""
    order = _dissection(matrix) if matrix.shape[0] > dissection_above else None
    if order is None:
        return definite_solver(matrix)
    ordered = definite_solver(matrix[order][:, order], "NATURAL")

    def solve(b):
        x = np.empty_like(b)
        x[order] = ordered(b[order])
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
