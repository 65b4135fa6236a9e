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
from jfsf.types import ArrayLike

MOST_STEPS = 100  # two shapes need one; twelve bodies in all poses about 20
# The mean rests where it moves by less than this many roundings of its largest number.
ROUNDINGS = 100


class AlignedShapes(NamedTuple):
    """Shapes moved onto their mean: scale * shape @ rotation.T + translation.

    positions: of all vertices.
    rotation: of each shape.
    translation: of each shape.
    scale: factor of each shape.
    mean: of the positions.
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
) -> AlignedShapes:
    """Move shapes onto their common mean, each by a rotation and a translation.

    Nothing is mirrored. The first shape stays where it is, but for its size: the mean
    has its pose. So to move any other shape changes nothing, and another order of the
    shapes moves all of them together.

    Args:
        shapes: (s, n, 3) positions of vertices that correspond, in one unit.
        scale: also make all shapes equally large, as in geometric morphometrics: their
            `AlignedShapes.size` agrees. The geometric mean of the scales is 1, so that
            the unit stays.
        weights: how much each vertex counts, such as its area; all alike if None.

    Raises:
        ValueError: fewer than two shapes, arrays that do not fit each other, or
            positions or weights that are not finite; or shapes so far from the origin,
            so small or so large that their precision is too coarse.
    """
    shapes = check_shapes("align", shapes, least=2)
    weights = check_weights("align", weights, shapes)
    return align_checked(shapes, weights, jnp.asarray(scale))


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
    share = weights / weights.sum()
    fit = _fit(shape[None], mean, share)
    size = jnp.asarray(size, shape.dtype)
    scale = jnp.where(size > 0, size / jnp.exp(fit.log_size), 1)
    return _moved(fit, scale)[0] + einsum("n,nd->d", share, mean)[None]


@jit
def align_checked(
    shapes: Float[Array, "s n 3"],
    weights: Float[Array, " n"],
    scaled: Bool[Array, ""],
) -> AlignedShapes:
    """`align`, traced: whether to scale is an array."""
    share = weights / weights.sum()
    tol = ROUNDINGS * float(jnp.finfo(shapes.dtype).eps)
    onto = lambda fit: _moved(fit, _scales(fit, scaled)).mean(0)

    def step(state):
        mean, _, number = state
        new = onto(_fit(shapes, mean, share))
        return new, jnp.max(jnp.abs(new - mean)) / jnp.max(jnp.abs(new)), number + 1

    def moves(state):
        _, change, number = state
        return (change > tol) & (number < MOST_STEPS)

    # First onto the first shape. The mean is about the origin: far away floats are
    # coarse.
    mean = onto(_fit(shapes, shapes[0], share))
    start = mean, jnp.asarray(jnp.inf, mean.dtype), 0
    mean, _, _ = jax.lax.while_loop(moves, step, start)
    fit = _fit(shapes, mean, share)
    scale = _scales(fit, scaled)
    # All are turned back together, so that the first keeps its pose.
    rotation = einsum("ba,sbc->sac", fit.rotation[0], fit.rotation)
    positions = _moved(fit._replace(rotation=rotation), scale) + fit.centre[:1, None]
    moved = scale[:, None] * einsum("sab,sb->sa", rotation, fit.centre)
    size = jnp.where(scaled, jnp.exp(jnp.mean(fit.log_size)), 0)
    translation = fit.centre[:1] - moved
    mean = positions.mean(0)
    return AlignedShapes(positions, rotation, translation, scale, mean, size)


class _Fit(NamedTuple):
    """Each shape turned onto the mean.

    offsets: of its vertices from its centroid.
    centre: its centroid.
    rotation: of each shape.
    log_size: the logarithm of its size, 0 for a point.
    """

    offsets: Array
    centre: Array
    rotation: Array
    log_size: Array


def _fit(shapes, mean, share):
    """The best rotation of each shape onto the mean, whose centroid does not count."""
    centre = einsum("n,snd->sd", share, shapes)
    offsets = shapes - centre[:, None]
    target = mean - einsum("n,nd->d", share, mean)[None]
    rotation = nearest_rotation(einsum("n,na,snb->sab", share, target, offsets))
    squares = einsum("n,snd->s", share, offsets**2)
    log_size = jnp.log(jnp.where(squares > 0, squares, 1)) / 2
    return _Fit(offsets, centre, rotation, log_size)


def _scales(fit, scaled):
    return jnp.where(scaled, jnp.exp(fit.log_size.mean() - fit.log_size), 1)


def _moved(fit, scale):
    """The shapes, turned and scaled, about the origin."""
    return scale[:, None, None] * einsum("sab,snb->sna", fit.rotation, fit.offsets)


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
