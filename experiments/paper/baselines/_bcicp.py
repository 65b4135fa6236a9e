"""BCICP: bijective and continuous ICP, on both point maps and functional maps.

This file is long because it holds one published method whole.

Ren, Poulenard, Wonka and Ovsjanikov, "Continuous and orientation-preserving
correspondences via functional maps", SIGGRAPH Asia 2018, section 5. Each round:

1. Bijective functional maps: C_yx of T_xy and C_xy of T_yx. Each is changed towards the
   inverse of the other, C_xy <- C_yx^T polar(C_yx C_xy). Both maps are nearest
   neighbours between the embeddings of both directions side by side,
   (Phi_X C_xy^T, Phi_X) and (Phi_Y, Phi_Y C_yx^T).
2. Continuity and coverage of the point maps, see `improve`.
3. Bijective ICP: polar factors R_x, R_y of the functional maps of T_yx o T_xy and
   T_xy o T_yx, and nearest neighbours between (Phi_X, Phi_Y[T_xy] R_y^T) and
   (Phi_X[T_yx] R_x^T, Phi_Y).
4. Step 2 again.

The authors' parameters: k = 50, 10 rounds, 4 passes of step 2, after 5 rounds of plain
alternation of point map and functional map.

Re-implemented from the steps and parameters of the authors' released MATLAB code. Its
versions differ in step 1 and in the condition for step 2. Here step 2 is always taken.
If it is taken only at a coverage below a half, as in the last version, a pair of TOSCA
dogs ends at error 0.029 and bijectivity 0.013 instead of 0.026 and 0.003.

Departures:

- Shapes have unit area, so no step depends on the unit of length.
- Distances are along mesh edges (Dijkstra). The source has fast marching up to 5000
  vertices and Euclidean distances beyond.
- Functional maps weigh vertices by area.
- When a step moves a vertex to improve coverage, another vertex always keeps its old
  image, so coverage cannot drop when several vertices move at once.
- The source's rule for uncovered vertices whose neighbours have several preimages is
  left out: with its tolerance it is a case of `fill_from_inverse`.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from jfsf.array import matmul
from jfsf.convert import nearest
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import components, edges
from jfsf.spectral import embeddings, functional_map, polar, truncate
from jfsf.types import ArrayLike, Maps, Mesh, Spectrum

CROWDED = 4  # preimages of a vertex above which they are spread out
SMALL = 0.08  # share of the vertices below which a region is replaced
COVERED = 0.5  # coverage below which regions are not looked for
SMOOTHABLE = 0.6  # coverage below which torn vertices are not smoothed
GAIN = 1e-4  # relative gain of coverage below which filling stops
SLACK = 0.02  # relative loss of bijectivity that a move for coverage may cause
COARSE = 2000  # vertices up to which the whole map is smoothed


class Surface(NamedTuple):
    """A mesh as the steps need it.

    points: (n, 3) at unit area.
    edges: (e, 2).
    ring: (n, n) sparse 0/1, the neighbours of each vertex.
    graph: (n, n) sparse edge lengths.
    dist: (n, n) float32 lengths of shortest paths along edges.
    longest: longest edge.
    """

    points: ArrayLike
    edges: ArrayLike
    ring: sp.csr_matrix
    graph: sp.csr_matrix
    dist: ArrayLike
    longest: float


def bcicp(
    mesh_x: Mesh,
    mesh_y: Mesh,
    spec_x: Spectrum,
    spec_y: Spectrum,
    maps: Maps,
    *,
    k: int = 50,
    num_iters: int = 10,
    num_passes: int = 4,
    num_start: int = 5,
) -> Maps:
    """Refine a pair of point maps.

    Args:
        mesh_x, mesh_y: triangle meshes.
        spec_x, spec_y: their spectra, k eigenpairs or more, no padding.
        maps: the start, both ways.
        k: eigenfunctions.
        num_iters: rounds.
        num_passes: passes of `improve`, twice a round.
        num_start: rounds of plain alternation before.

    Raises:
        ValueError: a mesh without faces; sizes that do not fit; indices out of range;
            an option that is out of range.
    """
    _check(mesh_x, mesh_y, spec_x, spec_y, maps, k, num_iters, num_passes, num_start)
    x, y = surface(mesh_x), surface(mesh_y)
    spec_x, spec_y = (_plain(truncate(s, k)) for s in (spec_x, spec_y))
    phi_x, phi_y = spec_x.evecs, spec_y.evecs
    T_xy, T_yx = (jnp.asarray(T, jnp.int32) for T in (maps.T_xy, maps.T_yx))
    for _ in range(num_start):
        there = embeddings(
            functional_map(T_xy, spec_x, spec_y), phi_x, phi_y, space="direct"
        )
        back = embeddings(
            functional_map(T_yx, spec_y, spec_x), phi_y, phi_x, space="direct"
        )
        T_xy, T_yx = nearest(*there).T_xy, nearest(*back).T_xy
    T_xy, T_yx = improve(T_xy, T_yx, x, y, num_passes=num_passes)
    for _ in range(num_iters):
        C_yx = functional_map(jnp.asarray(T_xy), spec_x, spec_y)
        C_xy = functional_map(jnp.asarray(T_yx), spec_y, spec_x)
        C_xy, C_yx = _bijective(C_xy, C_yx)
        T_xy, T_yx = nearest(
            jnp.concatenate([matmul(phi_x, C_xy.T), phi_x], 1),
            jnp.concatenate([phi_y, matmul(phi_y, C_yx.T)], 1),
        )
        T_xy, T_yx = improve(T_xy, T_yx, x, y, num_passes=num_passes)
        turn_x = polar(functional_map(jnp.asarray(T_yx[T_xy]), spec_x, spec_x))
        turn_y = polar(functional_map(jnp.asarray(T_xy[T_yx]), spec_y, spec_y))
        T_xy, T_yx = nearest(
            jnp.concatenate([phi_x, matmul(phi_y[T_xy], turn_y.T)], 1),
            jnp.concatenate([matmul(phi_x[T_yx], turn_x.T), phi_y], 1),
        )
        T_xy, T_yx = improve(T_xy, T_yx, x, y, num_passes=num_passes)
        if max(len(T_xy), len(T_yx)) <= COARSE:
            T_xy = smooth(T_xy, x, y, np.arange(len(T_xy)))
            T_yx = smooth(T_yx, y, x, np.arange(len(T_yx)))
    return Maps(jnp.asarray(T_xy, jnp.int32), jnp.asarray(T_yx, jnp.int32))


def _bijective(C_xy, C_yx):
    C_xy = matmul(C_yx.T, polar(matmul(C_yx, C_xy)))
    return C_xy, matmul(C_xy.T, polar(matmul(C_xy, C_yx)))


def surface(mesh: Mesh) -> Surface:
    """Neighbours and distances of `mesh`, scaled to unit area."""
    points, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    points = points / np.sqrt(surface_area(Mesh(points, faces)))
    ends = edges(faces).ends
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    n = len(points)
    both = np.concatenate([ends, ends[:, ::-1]]).T
    graph = sp.csr_matrix((np.tile(length, 2), tuple(both)), (n, n))
    ring = sp.csr_matrix((np.ones(2 * len(ends), np.int32), tuple(both)), (n, n))
    dist = np.empty((n, n), np.float32)
    for rows in np.array_split(np.arange(n), -(-n // 512)):
        dist[rows] = dijkstra(graph, indices=rows)
    return Surface(points, ends, ring, graph, dist, float(length.max()))


def improve(
    T_xy: ArrayLike, T_yx: ArrayLike, x: Surface, y: Surface, *, num_passes: int = 4
) -> tuple[np.ndarray, np.ndarray]:
    """Improve coverage, outliers and smoothness of both maps.

    Each pass has three parts. While coverage rises, each uncovered vertex gets the
    preimage that is nearest to its image under the other map, among vertices whose
    images others share. Torn vertices move as their neighbours do. Small regions that
    are torn off follow the largest.
    """
    T_xy, T_yx = np.array(T_xy), np.array(T_yx)
    T_xy, T_yx = spread(T_xy, x, y), spread(T_yx, y, x)
    T_yx = fill_from_inverse(T_yx, T_xy)
    T_xy = fill_from_inverse(T_xy, T_yx)
    T_xy, T_yx = _smooth_torn(T_xy, x, y), _smooth_torn(T_yx, y, x)
    for _ in range(num_passes):
        for slack in (SLACK, 0.0):
            before = 0.0
            while _share(T_xy, y) > before * (1 + GAIN):
                before = _share(T_xy, y)
                T_yx = fill_nearby(T_yx, T_xy, y, slack=slack)
                T_xy = fill_nearby(T_xy, T_yx, x, slack=slack)
                T_yx = fill_from_inverse(T_yx, T_xy)
                T_xy = fill_from_inverse(T_xy, T_yx)
            T_xy, T_yx = _smooth_torn(T_xy, x, y), _smooth_torn(T_yx, y, x)
        if min(_share(T_xy, y), _share(T_yx, x)) > COVERED:
            T_xy, T_yx = replace_outliers(T_xy, x, y), replace_outliers(T_yx, y, x)
    return T_xy, T_yx


def spread(T_xy: np.ndarray, x: Surface, y: Surface) -> np.ndarray:
    """Spread the preimages of crowded vertices over the vertices nearby.

    A vertex of Y is crowded if more than four vertices of X map to it. These are
    shifted in space so that their mean is at the vertex. Each then maps to the nearest
    vertex of Y.
    """
    count = np.bincount(T_xy, minlength=len(y.points))
    moved = np.flatnonzero(count[T_xy] > CROWDED)
    if len(moved) == 0:
        return T_xy
    image = T_xy[moved]
    centre = np.zeros_like(y.points)
    np.add.at(centre, image, x.points[moved])
    aim = x.points[moved] - centre[image] / count[image, None] + y.points[image]
    T_xy = T_xy.copy()
    T_xy[moved] = KDTree(y.points).query(aim)[1]
    return T_xy


def fill_from_inverse(T_xy: np.ndarray, T_yx: np.ndarray) -> np.ndarray:
    """Map T_yx[v] to an uncovered vertex v of Y, if others share its old image."""
    open_ = np.setdiff1d(np.arange(len(T_yx)), T_xy)
    return _move(T_xy, T_yx[open_], open_, np.zeros(len(open_)), len(T_yx))


def fill_nearby(
    T_xy: np.ndarray, T_yx: np.ndarray, x: Surface, *, slack: float = 0.0
) -> np.ndarray:
    """Map w to an uncovered vertex v of Y, w being spare and near T_yx[v].

    w is the nearest to T_yx[v] of the vertices of X whose images others share. It is
    mapped to v if T_yx[T_xy[w]] then is nearer to w, or farther by `slack` at most.
    """
    count = np.bincount(T_xy, minlength=len(T_yx))
    open_, spare = np.flatnonzero(count == 0), np.flatnonzero(count[T_xy] > 1)
    if len(open_) == 0 or len(spare) == 0:
        return T_xy
    found = dijkstra(x.graph, indices=spare, min_only=True, return_predecessors=True)
    who = found[2][T_yx[open_]]
    open_, who = open_[who >= 0], who[who >= 0]
    old, new = x.dist[T_yx[T_xy[who]], who], x.dist[T_yx[open_], who]
    good = new <= old * (1 + slack) if slack else new < old
    return _move(T_xy, who[good], open_[good], new[good], len(T_yx))


def replace_outliers(T_xy: np.ndarray, x: Surface, y: Surface) -> np.ndarray:
    """Map small regions that are torn off where their neighbours are mapped.

    Without the vertices at torn edges, X falls into regions. Vertices outside regions
    of 8 % or more take the image of the nearest vertex of the largest region, if that
    vertex is nearer than the longest edge.
    """
    torn, longest = _torn(T_xy, x, y)
    keep = np.ones(len(T_xy), bool)
    keep[torn] = False
    label = components(len(T_xy), *x.edges[keep[x.edges].all(1)].T)
    size = np.bincount(label)
    bad = size[label] < SMALL * len(T_xy)
    good = np.flatnonzero(label == size.argmax())
    dist, _, near = dijkstra(
        x.graph, indices=good, min_only=True, return_predecessors=True
    )
    fix = np.flatnonzero(bad & (dist < longest))
    T_new = T_xy.copy()
    T_new[fix] = T_xy[near[fix]]
    return T_new


def smooth(T_xy: np.ndarray, x: Surface, y: Surface, which: np.ndarray) -> np.ndarray:
    """Move each vertex of `which` as its neighbours move on average.

    Its new image is the nearest to that point, among the images of its neighbours and
    the vertices adjacent to these. Of them only the largest connected part counts. A
    part of one or two vertices changes nothing.
    """
    n = len(y.points)
    images = sp.csr_matrix(
        (np.ones(len(T_xy), np.int32), (np.arange(len(T_xy)), T_xy)), (len(T_xy), n)
    )
    rows = x.ring[which]
    reach = (rows @ images @ (y.ring + sp.identity(n, format="csr"))).tocoo()
    order = np.lexsort((reach.col, reach.row))
    row, col = reach.row[order].astype(np.int64), reach.col[order].astype(np.int64)
    if len(row) == 0:
        return T_xy
    # Connected parts of all candidate sets at once: candidate i is (row[i], col[i]).
    near = y.ring[col].tocoo()
    key, wanted = row * n + col, row[near.row] * n + near.col
    at = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
    hit = key[at] == wanted
    part = components(len(key), near.row[hit], at[hit])
    size = np.bincount(part)
    # The largest part of each row. Parts are numbered along rows; ties to the first.
    by_size = np.lexsort((part, -size[part], row))
    first = by_size[np.r_[True, row[by_size][1:] != row[by_size][:-1]]]
    best = np.full(len(which), -1)
    best[row[first]] = np.where(size[part[first]] > 2, part[first], -1)
    keep = part == best[row]
    row, col = row[keep], col[keep]
    step = y.points[T_xy] - x.points
    degree = np.maximum(np.asarray(rows.sum(1)), 1)
    aim = x.points[which] + (rows @ step) / degree
    gap = np.sum((y.points[col] - aim[row]) ** 2, 1)
    order = np.lexsort((col, gap, row))
    row, col = row[order], col[order]
    first = np.r_[True, row[1:] != row[:-1]] if len(row) else np.zeros(0, bool)
    T_new = T_xy.copy()
    T_new[which[row[first]]] = col[first]
    return T_new


def _smooth_torn(T_xy, x, y):
    # With so few images, those of neighbours say nothing about continuity.
    if len(np.unique(T_xy)) < SMOOTHABLE * len(T_xy):
        return T_xy
    torn = _torn(T_xy, x, y)[0]
    return smooth(T_xy, x, y, torn) if len(torn) else T_xy


def _torn(T_xy, x, y):
    """Vertices at edges whose images lie farther apart than any edge is long."""
    longest = max(x.longest, y.longest)
    ends = T_xy[x.edges]
    return np.unique(x.edges[y.dist[ends[:, 0], ends[:, 1]] > longest]), longest


def _move(T_xy, who, where, cost, n_y):
    """T_xy[who] = where, cheapest first, as long as others share the image of `who`.

    `where` are distinct and uncovered, so every move raises coverage by one.
    """
    order = np.lexsort((where, cost))
    who, where = who[order], where[order]
    first = np.sort(np.unique(who, return_index=True)[1])
    who, where = who[first], where[first]
    # Place of each move among those that leave the same image.
    image = T_xy[who]
    order = np.argsort(image, kind="stable")
    start = np.searchsorted(image[order], image[order])
    place = np.empty(len(who), np.int64)
    place[order] = np.arange(len(who)) - start
    spare = place < np.bincount(T_xy, minlength=n_y)[image] - 1
    T_new = T_xy.copy()
    T_new[who[spare]] = where[spare]
    return T_new


def _share(T_xy, y):
    return len(np.unique(T_xy)) / len(y.points)


def _plain(spec):
    return spec._replace(
        **{
            name: jnp.asarray(getattr(spec, name))
            for name in ("evals", "evecs", "mass")
        }
    )


def _check(mesh_x, mesh_y, spec_x, spec_y, maps, k, num_iters, num_passes, num_start):
    sizes = len(mesh_x.vertices), len(mesh_y.vertices)
    for name, mesh, spec in (("x", mesh_x, spec_x), ("y", mesh_y, spec_y)):
        if len(mesh.faces) == 0:
            raise ValueError(f"bcicp: mesh_{name} has no faces; give a triangle mesh")
        if len(spec.mass) != len(mesh.vertices):
            raise ValueError(
                f"bcicp: spec_{name} has {len(spec.mass)} vertices, mesh_{name} has "
                f"{len(mesh.vertices)}; pass the spectrum of the mesh, without padding"
            )
        if not 1 <= k <= len(spec.evals):
            raise ValueError(
                f"bcicp: k is {k}, spec_{name} has {len(spec.evals)} eigenpairs"
            )
    for name, T, (n, m) in (
        ("T_xy", maps.T_xy, sizes),
        ("T_yx", maps.T_yx, sizes[::-1]),
    ):
        T = np.asarray(T)
        if T.shape != (n,) or T.dtype.kind not in "iu" or T.min() < 0 or T.max() >= m:
            raise ValueError(
                f"bcicp: maps.{name} must be {n} integers in 0..{m - 1}, it is "
                f"{T.dtype} {T.shape}; do the maps run the other way?"
            )
    if min(num_iters, num_passes, num_start) < 0:
        raise ValueError(
            f"bcicp: num_iters, num_passes and num_start must not be negative, got "
            f"{num_iters}, {num_passes} and {num_start}"
        )
