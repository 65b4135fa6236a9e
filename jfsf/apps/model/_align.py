"""Shapes in correspondence, moved onto each other: generalised Procrustes analysis.

Gower (Psychometrika 1975) and Goodall (J. R. Stat. Soc. B 1991). With x_iv vertex v of
shape i and mass w_v, over rotations R_i, translations t_i and the mean m it makes

    sum_i sum_v w_v |c_i R_i x_iv + t_i - m_v|^2

as small as it can: in turn, each shape is moved onto the mean, and the mean is taken
anew, until it rests. The factors c_i are 1, or make all shapes as large as each other.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.apps.model._checks import check_shapes, check_weights
from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.geometry._surface import root
from jfsf.types import ArrayLike

MOST_STEPS = 100  # two shapes need one; twelve bodies in all poses about 20
# The mean rests where it moves by less than this many roundings of its largest number.
ROUNDINGS = 100


class AlignedShapes(NamedTuple):
    """Shapes moved onto their mean: scale * shape @ rotation.T + translation.

    positions: of all vertices; those of the mean where a shape misses one.
    rotation: of each shape.
    translation: of each shape.
    scale: factor of each shape.
    mean: of the positions, over the shapes that have the vertex.
    size: root of the mean squared distance of a vertex from the centroid, under the
        weights, which all shapes have in common; 0 without `scale`.
    """

    positions: Float[Array, "s n 3"]
    rotation: Float[Array, "s 3 3"]
    translation: Float[Array, "s 3"]
    scale: Float[Array, " s"]
    mean: Float[Array, "n 3"]
    size: Float[Array, ""]


def align(
    shapes: Float[ArrayLike, "s n 3"],
    *,
    scale: bool = False,
    weights: Float[ArrayLike, " n"] | None = None,
    missing: Bool[ArrayLike, "s n"] | None = None,
) -> AlignedShapes:
    """Move shapes onto their common mean, each by a rotation and a translation.

    Nothing is mirrored. The first shape stays where it is, but for its size: the mean
    has its pose. So to move any other shape changes nothing, and another order of the
    shapes moves all of them together.

    Args:
        shapes: (s, n, 3) positions of vertices that correspond, in one unit.
        scale: also make all shapes equally large, as in geometric morphometrics: their
            `AlignedShapes.size` agrees, on the vertices that they have. The geometric
            mean of the scales is 1, so that the unit stays.
        weights: how much each vertex counts, such as its area; all alike if None.
        missing: vertices that a shape does not have. Their positions are not read.

    Returns:
        The shapes; nan in the mean at a vertex that all shapes miss.

    Raises:
        ValueError: fewer than two shapes, arrays that do not fit each other, or
            positions or weights that are not finite; or shapes so far from the origin,
            so small or so large that their precision is too coarse.
    """
    shapes, present = check_shapes("align", shapes, missing, least=2)
    weights = check_weights("align", weights, shapes)
    return align_checked(shapes, weights, present, jnp.asarray(scale))


@jit
def align_onto(
    mean: Float[Array, "n 3"],
    shape: Float[Array, "n 3"],
    weights: Float[Array, " n"],
    size: Float[Array, ""] | float = 0.0,
) -> Float[Array, "n 3"]:
    """Positions of one shape moved onto a mean that stays (Kabsch 1976, Umeyama 1991).

    Pure: it vmaps over shapes and differentiates.

    Args:
        mean: positions to come near to.
        shape: of the same vertices.
        weights: how much each vertex counts.
        size: `AlignedShapes.size`, to which the shape is scaled; 0 keeps its scale.
    """
    share = (weights / weights.sum())[None]
    fit = _fit(shape[None], mean, share, share[0])
    shape_size = _size(shape, share[0])
    size = jnp.asarray(size, shape_size.dtype)
    scale = jnp.where(size > 0, safe_divide(size, shape_size), 1)
    return _moved(fit, scale[None])[0]


@jit
def align_checked(
    shapes: Float[Array, "s n 3"],
    weights: Float[Array, " n"],
    present: Bool[Array, "s n"],
    scaled: Bool[Array, ""],
) -> AlignedShapes:
    """`align`, traced: which vertices there are and whether to scale are arrays."""
    share = weights / weights.sum()
    shapes = jnp.where(present[..., None], shapes, 0)
    mass = jnp.where(present, share[None], 0)
    tol = ROUNDINGS * float(jnp.finfo(shapes.dtype).eps)

    def step(state):
        mean, _, number = state
        fit = _fit(shapes, mean, mass, share)
        new = _mean(_moved(fit, _scales(fit, scaled)), present)
        return new, jnp.max(jnp.abs(new - mean)) / jnp.max(jnp.abs(new)), number + 1

    def moves(state):
        _, change, number = state
        return (change > tol) & (number < MOST_STEPS)

    # First onto the first shape, by the vertices that both have.
    first = _fit(shapes, shapes[0], jnp.where(present[:1], mass, 0), share)
    mean = _mean(_moved(first, _scales(first, scaled)), present)
    mean = mean - first.at[:1]  # far from the origin floats are coarse
    start = mean, jnp.asarray(jnp.inf, mean.dtype), 0
    mean, _, _ = jax.lax.while_loop(moves, step, start)
    fit = _fit(shapes, mean, mass, share)
    scale = _scales(fit, scaled)
    # All are turned back together, so that the first keeps its pose.
    back = fit.rotation[0]
    at = einsum("sa,ab->sb", fit.at - fit.at[:1], back) + fit.centre[:1]
    rotation = einsum("ba,sbc->sac", back, fit.rotation)
    fit = fit._replace(rotation=rotation, at=at)
    positions = _moved(fit, scale)
    mean = jnp.where(present.any(0)[:, None], _mean(positions, present), jnp.nan)
    positions = jnp.where(present[..., None], positions, mean[None])
    moved = scale[:, None] * einsum("sab,sb->sa", rotation, fit.centre)
    size = jnp.where(scaled, jnp.exp(jnp.mean(-fit.log_growth)), 0)
    return AlignedShapes(positions, rotation, at - moved, scale, mean, size)


class _Fit(NamedTuple):
    """Each shape moved onto the mean.

    offsets: of its vertices from its centroid.
    centre: its centroid before.
    at: its centroid after.
    rotation: of each shape.
    log_growth: the logarithm of what makes its size 1, were it complete.
    """

    offsets: Array
    centre: Array
    at: Array
    rotation: Array
    log_growth: Array


def _fit(shapes, mean, mass, whole):
    """The best rotation of each shape onto the mean, under its own masses."""
    total = mass.sum(1, keepdims=True)
    share = safe_divide(mass, total)
    centre = einsum("sn,snd->sd", share, shapes)
    at = einsum("sn,nd->sd", share, mean)
    offsets, target = shapes - centre[:, None], mean[None] - at[:, None]
    rotation = nearest_rotation(einsum("sn,sna,snb->sab", share, target, offsets))
    squares = lambda values: einsum("sn,snd->s", share, values**2)
    # What the mean's size is on these vertices, beside all of it: a body without its
    # legs is not a small one.
    seen = safe_divide(squares(target), _size(mean, whole) ** 2)
    growth = safe_divide(seen, squares(offsets))
    log_growth = jnp.log(jnp.where(growth > 0, growth, 1)) / 2
    return _Fit(offsets, centre, at, rotation, log_growth)


def _size(points, share):
    offsets = points - einsum("n,nd->d", share, points)[None]
    return root(einsum("n,nd->", share, offsets**2))


def _scales(fit, scaled):
    log = fit.log_growth - fit.log_growth.mean()
    return jnp.where(scaled, jnp.exp(log), 1)


def _moved(fit, scale):
    turned = einsum("sab,snb->sna", fit.rotation, fit.offsets)
    return scale[:, None, None] * turned + fit.at[:, None]


def _mean(positions, present):
    total = einsum("sn,sna->na", present.astype(positions.dtype), positions)
    return safe_divide(total, present.sum(0).astype(total.dtype)[:, None])


@jax.custom_jvp
def nearest_rotation(matrix: Float[Array, "*b 3 3"]) -> Float[Array, "*b 3 3"]:
    """The rotation R for which trace(R^T matrix) is largest; never a reflection.

    With U diag(s) V^T the SVD of the matrix it is U diag(1, 1, det(U V)) V^T (Kabsch
    1976; Umeyama 1991). Of a matrix of rank below 2 there are many, and it is one of
    them; derivatives are 0 there.
    """
    return _factors(matrix)[0]


@nearest_rotation.defjvp
def _slope_of_nearest_rotation(primals, tangents):
    """With matrix = R P, P symmetric: R^T dM - dM^T R = W P + P W, where dR = R W.

    The derivative of the SVD itself is not finite where singular values repeat.
    """
    (matrix,), (slope,) = primals, tangents
    rotation, sizes, vt = _factors(matrix)
    v = jnp.swapaxes(vt, -1, -2)
    inner = matmul(matmul(vt, jnp.swapaxes(rotation, -1, -2)), matmul(slope, v))
    skew = inner - jnp.swapaxes(inner, -1, -2)
    turn = safe_divide(skew, sizes[..., :, None] + sizes[..., None, :])
    return rotation, matmul(rotation, matmul(v, matmul(turn, vt)))


def _factors(matrix):
    """The rotation, the eigenvalues of P = R^T matrix, and its eigenvectors as rows."""
    u, sizes, vt = jnp.linalg.svd(matrix)
    side = jnp.sign(jnp.linalg.det(u) * jnp.linalg.det(vt))
    signs = jnp.ones_like(sizes).at[..., 2].set(side)
    return matmul(u * signs[..., None, :], vt), sizes * signs, vt
