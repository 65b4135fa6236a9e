"""The eight metrics of the paper (section 5 and its supplement), and error curves.

Geometric ones read a map, host side; functional ones read C_yx or the aligned
embeddings, are pure jitted JAX, and vmap. Definitions agree with the authors' code to
the digits of its published numbers (tests/test_metrics.py), but the authors measure

- error and bijectivity by Euclidean distance: here they are geodesic, as in the paper;
- functional metrics on spectra in mesh units: ours have area 1. Dividing a shape's
  lengths by sqrt(area) multiplies its eigenvalues by area and its eigenfunctions by
  sqrt(area).
"""

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
import robust_laplacian
import scipy.sparse as sp
from jaxtyping import Array, Float

from jfsf.geodesics import Progress, pair_distances, vertex_indices
from jfsf.knn import neighbours
from jfsf.types import ArrayLike, Mesh

HIGHEST = jax.lax.Precision.HIGHEST


def geodesic_error(
    T_xy: ArrayLike,
    mesh_y: Mesh,
    gt_x: ArrayLike,
    gt_y: ArrayLike,
    *,
    exact: bool = False,
    progress: Progress | None = None,
) -> np.ndarray:
    """Distance on Y from where T_xy sends gt_x[i] to gt_y[i], over sqrt(area of Y).

    The mean is the paper's "accuracy" (Kim, Lipman and Funkhouser 2011).

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        mesh_y: the target.
        gt_x, gt_y: (p,) 0-based; template point i is vertex gt_x[i] of X and gt_y[i]
            of Y. `arange` for shapes in common connectivity.
        exact, progress: as for `jfsf.geodesics.geodesics`.

    Returns:
        (p,) float64, without unit; inf where Y is not connected.

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
    return dist / np.sqrt(_area(mesh_y))


def bijectivity(
    T_xy: ArrayLike,
    T_yx: ArrayLike,
    mesh_x: Mesh,
    *,
    at: ArrayLike | None = None,
    exact: bool = False,
    progress: Progress | None = None,
) -> np.ndarray:
    """Distance on X from x to T_yx[T_xy[x]], over sqrt(area of X).

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        T_yx: (n_y,) integers, the vertex of X for each vertex of Y.
        mesh_x: the shape that is left and returned to.
        at: (p,) vertices of X to measure at; all when absent.
        exact, progress: as for `jfsf.geodesics.geodesics`.

    Returns:
        (n_x,) or (p,) float64, without unit; the mean is the paper's figure.

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
    return dist / np.sqrt(_area(mesh_x))


def coverage(
    T_xy: ArrayLike, mass_y: ArrayLike, *, mass_x: ArrayLike | None = None
) -> Float[Array, ""]:
    """Share of Y's area that T_xy hits, in [0, 1].

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
    if not isinstance(
        T_xy, jax.Array
    ):  # reading a jax array back would stall its device
        T_xy = vertex_indices("coverage", "T_xy", T_xy, len(mass_y))
    return _coverage(jnp.asarray(T_xy), jnp.asarray(mass_y), mass_x)


@jax.jit
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

    Each coordinate is scaled to [0, 1] over Y first (a flat one counts 0), so neither
    shape's size matters; Y's rotation does.

    Args:
        T_xy: (n_x,) integers, the vertex of Y for each vertex of X.
        vertices_y: (n_y, 3).
        stiffness_x: (n_x, n_x) cotangent stiffness of X, positive semidefinite.

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


@jax.jit
def orthogonality(C_yx: Float[Array, "k_x k_y"]) -> Float[Array, ""]:
    """|C^T C - I|_2, the spectral norm: 0 for an area-preserving map.

    At least 1 when k_x < k_y, where C^T C cannot have full rank.
    """
    _matrix("orthogonality", C_yx)
    gram = jnp.matmul(C_yx.T, C_yx, precision=HIGHEST)
    return jnp.abs(
        jnp.linalg.eigvalsh(gram - jnp.eye(len(gram), dtype=gram.dtype))
    ).max()


@partial(jax.jit, static_argnames="ord")
def laplacian_commutativity(
    C_yx: Float[Array, "k_x k_y"],
    evals_x: Float[Array, " k_x"],
    evals_y: Float[Array, " k_y"],
    *,
    ord: Literal[2, "fro"] = 2,
) -> Float[Array, ""]:
    """|L_X C - C L_Y| / |C|: 0 for an isometry; in units of the eigenvalues.

    Args:
        C_yx: functions on Y pulled back to X.
        evals_x, evals_y: eigenvalues.
        ord: spectral norm (2), which the paper's tables use, or Frobenius ("fro").

    Raises:
        ValueError: shapes differ, or another `ord`.
    """
    if C_yx.shape != evals_x.shape + evals_y.shape:
        raise ValueError(
            f"laplacian_commutativity: C_yx is {C_yx.shape}, evals_x and evals_y are "
            f"{evals_x.shape} and {evals_y.shape}"
        )
    if ord not in (2, "fro"):
        raise ValueError(f"laplacian_commutativity: ord is {ord!r}, not 2 or 'fro'")
    gap = (evals_x[:, None] - evals_y[None, :]) * C_yx
    return jnp.linalg.norm(gap, ord) / jnp.linalg.norm(C_yx, ord)


@jax.jit
def zoomout_energy(C_yx: Float[Array, "k_x k_y"]) -> Float[Array, ""]:
    """sum over k of |C_k^T C_k - I|_F / k, C_k the leading k by k block.

    k runs from 1 to min(k_x, k_y); after Melzi et al. 2019, who square the norm: the
    paper's tables do not.
    """
    _matrix("zoomout_energy", C_yx)
    k = min(C_yx.shape)
    eye = jnp.eye(k, dtype=C_yx.dtype)

    def step(gram: Array, i: Array):
        row = C_yx[i, :k]
        gram += row[:, None] * row[None, :]
        inside = jnp.arange(k) <= i
        gap = jnp.where(inside[:, None] & inside[None, :], gram - eye, 0)
        return gram, _root((gap * gap).sum()) / (i + 1).astype(gap.dtype)

    return jax.lax.scan(step, jnp.zeros_like(eye), jnp.arange(k))[1].sum()


@jax.jit
def spectral_chamfer(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    *,
    mass_x: Float[Array, " n_x"] | None = None,
    mass_y: Float[Array, " n_y"] | None = None,
) -> Float[Array, ""]:
    """Mean distance from a row of emb_x to the nearest of emb_y, plus the converse.

    The authors report the sums in place of the means: with n vertices on both shapes
    theirs is n times ours, times 1 / sqrt(area of Y) because their spectra are in mesh
    units (their tables appear to be in units of 10^4). Symmetric; differentiable.

    Args:
        emb_x, emb_y: aligned embeddings; for the paper's numbers the adjoint ones,
            (Phi_X C_yx, Phi_Y), with C_yx the functional map of the map that is scored.
        mass_x, mass_y: 0 marks padding; the means are over the rest, unweighted.

    Raises:
        ValueError: widths differ, or a mass has another length.
    """
    if emb_x.ndim != 2 or emb_y.ndim != 2 or emb_x.shape[1] != emb_y.shape[1]:
        raise ValueError(
            f"spectral_chamfer: emb_x is {emb_x.shape}, emb_y is {emb_y.shape}"
        )
    for name, mass, emb in (("mass_x", mass_x, emb_x), ("mass_y", mass_y, emb_y)):
        if mass is not None and mass.shape != emb.shape[:1]:
            raise ValueError(
                f"spectral_chamfer: {name} is {mass.shape}, its embedding is "
                f"{emb.shape}"
            )
    there = _mean_nearest(emb_x, emb_y, mass_x, mass_y)
    return there + _mean_nearest(emb_y, emb_x, mass_y, mass_x)


def error_curve(errors: ArrayLike, thresholds: ArrayLike) -> np.ndarray:
    """Share of `errors` (p,) that are <= each of `thresholds` (t,): (t,) in [0, 1].

    The curve of Kim, Lipman and Funkhouser (2011); nan counts as above.

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

    Exact, by the integral of the steps; nan counts as above.

    Raises:
        ValueError: no errors, or limit not positive.
    """
    errors = _errors("auc", errors)
    if not limit > 0:
        raise ValueError(f"auc: limit is {limit}, errors need a limit above 0")
    return float(np.where(errors < limit, 1 - errors / limit, 0).mean())


def _errors(name, errors):
    errors = np.asarray(errors, np.float64)
    if errors.ndim != 1 or len(errors) == 0:
        raise ValueError(f"{name}: errors are {errors.shape}, expected (p,), p > 0")
    return errors


def _area(mesh: Mesh) -> float:
    v, f = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if len(f) == 0:
        return float(robust_laplacian.point_cloud_laplacian(v)[1].diagonal().sum())
    cross = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    return float(np.linalg.norm(cross, axis=1).sum() / 2)


def _matrix(name, C_yx):
    if C_yx.ndim != 2:
        raise ValueError(f"{name}: C_yx is {C_yx.shape}, expected (k_x, k_y)")


def _mean_nearest(queries: Array, points: Array, mass_queries, mass_points) -> Array:
    valid = None if mass_points is None else mass_points > 0
    # The nearest point is piecewise constant: only the distance to it has a gradient.
    fixed = jax.lax.stop_gradient((queries, points))
    nearest = neighbours(*fixed, valid, k0=1).idx[:, 0]
    dist = _root(jnp.sum((queries - points[nearest]) ** 2, 1))
    if mass_queries is None:
        return dist.mean()
    use = mass_queries > 0
    return jnp.where(use, dist, 0).sum() / use.sum().astype(dist.dtype)


def _root(x: Array) -> Array:
    # The gradient of sqrt at 0 is inf; here it is 0. nan stays nan.
    zero = x == 0
    return jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, x)))
