"""Metrics of a point-to-point map: error, bijectivity, coverage, smoothness; curves.

From section 5 of the paper (Pai et al. 2021) and its supplement. They run on the host,
but for `coverage`, which is jitted and vmaps. The definitions reproduce the published
numbers of the authors' code to all digits, except that the authors measure error and
bijectivity by Euclidean distance. Here they are geodesic, as in the paper.
"""

import jax
import jax.numpy as jnp
import numpy as np
import robust_laplacian
import scipy.sparse as sp
from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.geometry import pair_distances
from jfsf.geometry._geodesics import Progress, vertex_indices
from jfsf.mesh import surface_area
from jfsf.types import ArrayLike, Mesh


def geodesic_error(
    T_xy: ArrayLike,
    mesh_y: Mesh,
    gt_x: ArrayLike,
    gt_y: ArrayLike,
    *,
    exact: bool = False,
    progress: Progress | None = None,
) -> np.ndarray:
    """d_Y(T_xy[gt_x[i]], gt_y[i]) / sqrt(area of Y), d_Y the geodesic distance on Y.

    The mean is "accuracy" in tables 1 and 2 of Pai et al. (CVPR 2021), after Kim,
    Lipman and Funkhouser (2011).

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        mesh_y: the target.
        gt_x, gt_y: (p,) 0-based; point i of the ground truth is vertex gt_x[i] of X and
            gt_y[i] of Y. `arange` for shapes in common connectivity.
        exact, progress: as for `jfsf.geometry.geodesics`.

    Returns:
        (p,) float64, without unit; inf between pieces that are not connected, such as
        for an image that belongs to no face. nan where gt_y[i] itself belongs to no
        face, and T_xy goes elsewhere: no distance to it can be measured.

    Raises:
        ValueError: lengths differ or an index is out of range.
    """
    name = "geodesic_error"
    T_xy = vertex_indices(name, "T_xy", T_xy, len(mesh_y.vertices))
    gt_x = vertex_indices(name, "gt_x", gt_x, len(T_xy))
    gt_y = vertex_indices(name, "gt_y", gt_y, len(mesh_y.vertices))
    if len(gt_x) != len(gt_y):
        raise ValueError(f"{name}: gt_x has {len(gt_x)} points, gt_y has {len(gt_y)}")
    dist = pair_distances(mesh_y, gt_y, T_xy[gt_x], exact=exact, progress=progress)
    return _without_strays(dist, mesh_y, gt_y) / np.sqrt(_area(mesh_y))


def bijectivity(
    T_xy: ArrayLike,
    T_yx: ArrayLike,
    mesh_x: Mesh,
    *,
    at: ArrayLike | None = None,
    exact: bool = False,
    progress: Progress | None = None,
) -> np.ndarray:
    """d_X(x, T_yx[T_xy[x]]) / sqrt(area of X), d_X the geodesic distance on X.

    The mean is "bijectivity" in tables 1 and 2 of Pai et al. (CVPR 2021).

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        T_yx: (n_y,) integers, the vertex of X for each vertex of Y.
        mesh_x: X, on which the distance is measured.
        at: (p,) vertices of X to measure at; all when absent.
        exact, progress: as for `jfsf.geometry.geodesics`.

    Returns:
        (n_x,) or (p,) float64, without unit; inf and nan as of `geodesic_error`.

    Raises:
        ValueError: lengths differ or an index is out of range.
    """
    name = "bijectivity"
    n_x = len(mesh_x.vertices)
    if len(T_xy) != n_x:
        raise ValueError(f"{name}: T_xy has {len(T_xy)} entries, X has {n_x} vertices")
    T_xy = vertex_indices(name, "T_xy", T_xy, len(T_yx))
    T_yx = vertex_indices(name, "T_yx", T_yx, n_x)
    x = np.arange(n_x) if at is None else vertex_indices(name, "at", at, n_x)
    dist = pair_distances(mesh_x, x, T_yx[T_xy[x]], exact=exact, progress=progress)
    return _without_strays(dist, mesh_x, x) / np.sqrt(_area(mesh_x))


def coverage(
    T_xy: ArrayLike, mass_y: ArrayLike, *, mass_x: ArrayLike | None = None
) -> Float[Array, ""]:
    """Share of Y's area that T_xy hits, in [0, 1].

    The sum of a_j over all vertices j = T_xy[i] of Y, each once, over that of all j.
    "Coverage" in tables 1 and 2 of Pai et al. (CVPR 2021).

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        mass_y: (n_y,) lumped areas of Y, in any unit.
        mass_x: (n_x,), 0 on padding, whose entries of T_xy are ignored.

    Raises:
        ValueError: shapes are wrong, or a numpy T_xy is out of range; an index out of
            range in a jax array hits nothing.
    """
    if np.ndim(T_xy) != 1 or np.ndim(mass_y) != 1:
        raise ValueError(
            f"coverage: T_xy is {np.shape(T_xy)} and mass_y {np.shape(mass_y)}, "
            "expected (n_x,) and (n_y,)"
        )
    if mass_x is not None and np.shape(mass_x) != np.shape(T_xy):
        raise ValueError(
            f"coverage: mass_x is {np.shape(mass_x)}, T_xy is {np.shape(T_xy)}"
        )
    # A jax array is not checked: reading its values would wait for its device.
    if not isinstance(T_xy, jax.Array):
        T_xy = vertex_indices("coverage", "T_xy", T_xy, len(mass_y))
    return _coverage(jnp.asarray(T_xy), jnp.asarray(mass_y), mass_x)


@jit
def _coverage(T_xy: Array, mass_y: Array, mass_x: Array | None):
    valid = True if mass_x is None else mass_x > 0
    # A negative index would count from the end.
    T_xy = jnp.where((T_xy >= 0) & valid, T_xy, len(mass_y))
    hit = jnp.zeros(len(mass_y), bool).at[T_xy].set(True, mode="drop")
    return jnp.where(hit, mass_y, 0).sum() / mass_y.sum()


def smoothness(
    T_xy: ArrayLike, vertices_y: ArrayLike, stiffness_x: sp.csr_matrix | sp.csr_array
) -> float:
    """Mean Dirichlet energy of Y's coordinates pulled back by T_xy; 0 is constant.

    1/3 sum_c f_c^T W f_c, with f_c = y_c[T_xy] for the three coordinates y_c of Y and W
    the stiffness of X. "Smoothness" in tables 1 and 2 of Pai et al. (CVPR 2021).

    Each coordinate is scaled to [0, 1] over Y first, and one that is constant on Y
    counts 0. So the size of neither shape matters, but the rotation of Y does.

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        vertices_y: (n_y, 3).
        stiffness_x: (n_x, n_x) cotangent stiffness of X, positive semidefinite.

    Returns:
        The energy, without unit: the stiffness does not change when X is scaled.

    Raises:
        ValueError: shapes differ or T_xy is out of range.
    """
    vertices_y = np.asarray(vertices_y, np.float64)
    T_xy = vertex_indices("smoothness", "T_xy", T_xy, len(vertices_y))
    if stiffness_x.shape != (len(T_xy), len(T_xy)):
        raise ValueError(
            f"smoothness: stiffness_x is {stiffness_x.shape}, T_xy has {len(T_xy)} "
            "entries"
        )
    span = np.ptp(vertices_y, axis=0)
    scaled = (vertices_y - vertices_y.min(0)) / np.where(span > 0, span, 1)
    pulled = scaled[T_xy]
    return float(np.sum(pulled * (stiffness_x @ pulled)) / pulled.shape[1])


def error_curve(errors: ArrayLike, thresholds: ArrayLike) -> np.ndarray:
    """Share of `errors` (p,) that are <= each of `thresholds` (t,): (t,) in [0, 1].

    The curve of Kim, Lipman and Funkhouser (2011). nan counts as above all thresholds.

    Raises:
        ValueError: no errors, or not vectors.
    """
    errors = _errors("error_curve", errors)
    thresholds = np.asarray(thresholds, np.float64)
    if thresholds.ndim != 1:
        raise ValueError(f"error_curve: thresholds are {thresholds.shape}, not (t,)")
    # nan sorts last, above every threshold.
    return np.searchsorted(np.sort(errors), thresholds, side="right") / len(errors)


def auc(errors: ArrayLike, *, limit: float = 0.25) -> float:
    """Area under the error curve from 0 to `limit`, over `limit`: 1 is perfect.

    Exact: the integral of the step function. nan counts as above `limit`.

    Raises:
        ValueError: no errors, or limit not positive.
    """
    errors = _errors("auc", errors)
    if not limit > 0:
        raise ValueError(f"auc: limit is {limit}, it must be positive")
    return float(np.where(errors < limit, 1 - errors / limit, 0).mean())


def _errors(name, errors):
    errors = np.asarray(errors, np.float64)
    if errors.ndim != 1 or len(errors) == 0:
        raise ValueError(f"{name}: errors are {errors.shape}, expected (p,), p > 0")
    return errors


def _without_strays(dist: np.ndarray, mesh: Mesh, at: np.ndarray) -> np.ndarray:
    """Distances from these vertices; nan from one that belongs to no face."""
    if not len(mesh.faces):
        return dist
    stray = np.ones(len(mesh.vertices), bool)
    stray[np.asarray(mesh.faces)] = False
    return np.where(stray[at] & np.isinf(dist), np.nan, dist)


def _area(mesh: Mesh) -> float:
    mesh = mesh._replace(vertices=np.asarray(mesh.vertices, np.float64))
    if len(mesh.faces):
        return surface_area(mesh)
    mass = robust_laplacian.point_cloud_laplacian(mesh.vertices)[1]
    return float(mass.diagonal().sum())
