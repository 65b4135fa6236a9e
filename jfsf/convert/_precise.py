"""Vertex-to-point maps: each row of an embedding -> the nearest point of a surface.

Ezuz and Ben-Chen, Deblurring and denoising of maps between shapes (2017): the mapped
embedding of X is projected to the triangles of Y's, not to its vertices only.

Exact. The point p of a triangle nearest to q lies inside the triangle or an edge, to
which q - p is normal, or is a corner; so |q - c|^2 = |q - p|^2 + |p - c|^2 for a corner
c near it, and no triangle around a vertex v, as its nearest corner, is nearer to q than
|q - v|^2 - r^2, r the largest distance from a point of one to its corners. The k0
vertices with the least such bounds give the candidates; rows that the next bound does
not settle, few on smooth embeddings, are measured against every triangle.

Exact up to rounding: where a row all but touches the surface, products of float32 rows
cancel, and the distance may come out larger than the least by some 1e-4 of itself. And
the least bounds are found as exactly as `jfsf.neighbours` tells points apart.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.neighbours import neighbours
from jfsf.spectral._functional_maps import coefficients
from jfsf.types import PreciseMap, Spectrum

ROWS = 128  # rows of queries at a time: their scores stay in the cache
KEEP = 32  # triangles chosen by distances from products, then ranked by differences


class _Surface(NamedTuple):
    """Y embedded; g11, g12, g22: products of the edges from corner 0 to 1 and 2."""

    emb: Float[Array, "n_y k"]
    square: Float[Array, " n_y"]
    faces: Int[Array, "m 3"]
    g11: Float[Array, " m"]
    g12: Float[Array, " m"]
    g22: Float[Array, " m"]


@jit(static_argnames=("k0", "degree"))
def precise(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    faces_y: Int[Array, "m 3"],
    *,
    k0: int = 24,
    degree: int = 10,
) -> PreciseMap:
    """The point of the embedded surface Y nearest to each row of `emb_x`.

    Args:
        emb_x, emb_y: aligned embeddings (`jfsf.spectral.embeddings`).
        faces_y: triangles of Y; (0, 0, 0) is padding.
        k0: vertices whose triangles are tried first. More or fewer change the time,
            not the result.
        degree: triangles of each of these vertices that are tried first. More or fewer
            change the time, not the result.

    Returns:
        Triangles and barycentric coordinates; nan for a row that is not finite. Between
        equally near triangles the choice is arbitrary.

    Raises:
        ValueError: widths differ, there are no triangles, or an option is below 1.
    """
    if emb_x.ndim != 2 or emb_y.ndim != 2 or emb_x.shape[1] != emb_y.shape[1]:
        raise ValueError(f"precise: emb_x is {emb_x.shape}, emb_y is {emb_y.shape}")
    if faces_y.ndim != 2 or faces_y.shape[1] != 3 or len(faces_y) == 0:
        raise ValueError(f"precise: faces_y is {faces_y.shape}, expected (m, 3), m > 0")
    if k0 < 1 or degree < 1:
        raise ValueError(
            f"precise: k0 and degree must be positive, got {k0} and {degree}"
        )
    surface, radius = _surface(emb_y, faces_y)
    real = jnp.any(faces_y != faces_y[:, :1], 1)
    star, count = _stars(faces_y, real, len(emb_y), degree)
    near, bound = _bounds(emb_x, surface, radius, real, count, min(k0, len(emb_y)))
    # A vertex with more triangles than fit settles nothing beyond its own bound.
    bound = jnp.min(jnp.where(count[near] > degree, bound, bound[:, -1:]), 1)

    def first(args):
        row, vertices = args
        faces = star[vertices].ravel()
        return _nearest(row, faces, faces >= 0, surface)

    square, face, bary = jax.lax.map(first, (emb_x, near), batch_size=ROWS)
    # Rounding alone must not send a row to the second pass.
    open_ = ~(square * (1 - 8 * jnp.finfo(square.dtype).eps) <= bound)

    every = jnp.arange(len(faces_y), dtype=star.dtype)
    second = jax.vmap(lambda row: _nearest(row, every, real, surface)[1:])
    rows = jnp.argsort(~open_)
    rows = jnp.pad(rows, (0, -len(rows) % ROWS), constant_values=len(rows))

    def more(state):
        return state[0] < open_.sum()

    def measure(state):
        start, face, bary = state
        at = jax.lax.dynamic_slice(rows, (start,), (ROWS,))
        nearest = second(emb_x[at])
        face = face.at[at].set(nearest[0], mode="drop")
        return start + ROWS, face, bary.at[at].set(nearest[1], mode="drop")

    _, face, bary = jax.lax.while_loop(
        more, measure, (jnp.zeros_like(open_.sum()), face, bary)
    )
    return PreciseMap(faces_y[face].astype(jnp.int32), bary)


@jit
def pull_back_precise(
    pmap: PreciseMap, values_y: Float[Array, "n_y c"]
) -> Float[Array, "n_x c"]:
    """Functions on Y pulled back to X by a vertex-to-point map, linear on triangles.

    Pulled back, the coordinates of Y's vertices are the image points of X's vertices.

    Raises:
        ValueError: values_y is not a matrix.
    """
    if values_y.ndim != 2:
        raise ValueError(
            f"pull_back_precise: values_y is {values_y.shape}, expected (n_y, c)"
        )
    return jnp.sum(pmap.bary[:, :, None] * values_y[pmap.corners], 1)


@jit
def to_vertex(pmap: PreciseMap) -> Int[Array, " n_x"]:
    """T_xy of a vertex-to-point map: the corner of most weight, ties to the first."""
    at = jnp.argmax(pmap.bary, 1, keepdims=True)
    return jnp.take_along_axis(pmap.corners, at, 1)[:, 0]


@jit
def functional_map_precise(
    pmap: PreciseMap, spec_x: Spectrum, spec_y: Spectrum
) -> Float[Array, "k_x k_y"]:
    """C_yx of a vertex-to-point map P: Phi_X^+ P Phi_Y.

    Raises:
        ValueError: pmap does not have one row for each vertex of X.
    """
    if len(pmap.corners) != len(spec_x.evecs):
        raise ValueError(
            f"functional_map_precise: pmap has {len(pmap.corners)} rows, X has "
            f"{len(spec_x.evecs)} vertices"
        )
    return coefficients(pull_back_precise(pmap, spec_y.evecs), spec_x)


def _surface(emb: Array, faces: Array):
    """The surface, and r^2 of each triangle."""
    corner = emb[faces]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    g11, g12, g22 = (jnp.sum(a * b, 1) for a, b in ((one, one), (one, two), (two, two)))
    sides = jnp.sort(jnp.stack([g11, g22, jnp.sum((two - one) ** 2, 1)]), 0)
    # Acute: the circumcentre is farthest from the corners; else half the longest side.
    det = g11 * g22 - g12**2
    acute = (sides[2] < sides[0] + sides[1]) & (det > 0)
    circum = jnp.prod(sides, 0) / jnp.where(acute, 4 * det, 1)
    radius = jnp.where(acute, circum, sides[2] / 4)
    return _Surface(emb, jnp.sum(emb**2, 1), faces, g11, g12, g22), radius


def _stars(faces: Array, real: Array, n: int, degree: int):
    """The first `degree` triangles of each vertex, -1 where absent; how many it has."""
    corner = jnp.where(real[:, None], faces, n).ravel()
    order = jnp.argsort(corner)
    corner, vertex = corner[order], jnp.arange(n, dtype=corner.dtype)
    start = jnp.searchsorted(corner, vertex)
    count = jnp.searchsorted(corner, vertex, side="right") - start
    slot = jnp.arange(degree, dtype=start.dtype)[None, :]
    face = order[jnp.minimum(start[:, None] + slot, len(order) - 1)] // 3
    return jnp.where(slot < count[:, None], face, -1), count


def _bounds(
    emb_x, surface: _Surface, radius: Array, real: Array, count: Array, k0: int
):
    """The k0 vertices of least |q - v|^2 - r_v^2, and these bounds; both ascending.

    One more coordinate makes them plain nearest neighbours.
    """
    emb_y = surface.emb
    radius = jnp.where(real, radius, 0)
    around = jnp.zeros(len(emb_y), emb_y.dtype)
    around = around.at[surface.faces].max(
        jnp.broadcast_to(radius[:, None], surface.faces.shape)
    )
    lift = jnp.sqrt(around.max() - around)
    points = jnp.concatenate([emb_y, lift[:, None]], 1)
    queries = jnp.pad(emb_x, ((0, 0), (0, 1)))
    near = neighbours(queries, points, count > 0, k0=k0)
    return near.idx, near.dist**2 - around.max()


def _nearest(row: Array, faces: Array, known: Array, surface: _Surface):
    """Squared distance, triangle and barycentric coordinates of the nearest point.

    faces: candidates; those not `known` are left out.
    """
    product = matmul(surface.emb, row)
    square = jnp.sum(row**2) + surface.square - 2 * product
    corner = square[surface.faces[faces]]
    g11, g12, g22 = surface.g11[faces], surface.g12[faces], surface.g22[faces]
    p1 = (corner[:, 0] - corner[:, 1] + g11) / 2
    p2 = (corner[:, 0] - corner[:, 2] + g22) / 2
    _, _, gain = _closest(p1, p2, g11, g12, g22)
    # Products cancel: they only choose. float32 sorts faster.
    score = jnp.where(known, -(corner[:, 0] + gain), -jnp.inf).astype(jnp.float32)
    best = jax.lax.top_k(score, min(KEEP, len(faces)))[1]
    faces, known = faces[best], known[best]

    corner = surface.emb[surface.faces[faces]]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    to = row[None, :] - corner[:, 0]
    grams = surface.g11[faces], surface.g12[faces], surface.g22[faces]
    s, t, _ = _closest(jnp.sum(to * one, 1), jnp.sum(to * two, 1), *grams)
    square = jnp.sum((to - s[:, None] * one - t[:, None] * two) ** 2, 1)
    square = jnp.where(known, square, jnp.inf)
    at = jnp.argmin(square)
    s, t = s[at], t[at]
    bary = jnp.stack([jnp.maximum(1 - s - t, 0), s, t])
    bary = jnp.where(jnp.isfinite(square[at]), bary, jnp.nan)
    return square[at], jnp.maximum(faces[at], 0), bary


def _closest(p1: Array, p2: Array, g11: Array, g12: Array, g22: Array):
    """s, t of the least |w - s e1 - t e2|^2 - |w|^2 over the triangle, and that value.

    p1, p2: products of w with the edges e1, e2, whose own are g11, g12, g22.
    """
    det = g11 * g22 - g12**2
    flat = det <= 8 * jnp.finfo(det.dtype).eps * g11 * g22
    det = jnp.where(flat, 1, det)
    s, t = (g22 * p1 - g12 * p2) / det, (g11 * p2 - g12 * p1) / det
    inside = ~flat & (s >= 0) & (t >= 0) & (s + t <= 1)
    zero, across = jnp.zeros_like(p1), _along(p2 - p1 + g11 - g12, g11 - 2 * g12 + g22)

    def value(s, t):
        return s * (s * g11 - 2 * p1) + t * (t * g22 - 2 * p2) + 2 * s * t * g12

    best = value(s, t)
    least = jnp.where(inside, -jnp.inf, jnp.inf)
    edges = (_along(p1, g11), zero), (zero, _along(p2, g22)), (1 - across, across)
    for on_s, on_t in edges:
        other = value(on_s, on_t)
        better = other < least
        s, t = jnp.where(better, on_s, s), jnp.where(better, on_t, t)
        best, least = jnp.where(better, other, best), jnp.where(better, other, least)
    return s, t, best


def _along(product: Array, square: Array):
    ok = square > 0
    return jnp.where(ok, jnp.clip(product / jnp.where(ok, square, 1), 0, 1), 0)
