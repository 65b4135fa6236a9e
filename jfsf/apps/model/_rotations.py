"""Rotations of 3 x 3 matrices, and their logarithms; all batched and differentiable."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._precision import safe_divide


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


def rotation_vectors(rotation: Float[Array, "*b 3 3"]) -> Float[Array, "*b 3"]:
    """The logarithm of each rotation: its axis times its angle, in [0, pi] radians.

    By the unit quaternion q: 4 q q^T is linear in the rotation, and its largest column
    is accurate for every angle.
    """
    xx, yy, zz = (rotation[..., i, i] for i in range(3))
    sums = lambda i, j: rotation[..., i, j] + rotation[..., j, i]
    less = lambda i, j: rotation[..., i, j] - rotation[..., j, i]
    products = _matrix(
        [1 + xx + yy + zz, less(2, 1), less(0, 2), less(1, 0)],
        [less(2, 1), 1 + xx - yy - zz, sums(0, 1), sums(0, 2)],
        [less(0, 2), sums(0, 1), 1 - xx + yy - zz, sums(1, 2)],
        [less(1, 0), sums(0, 2), sums(1, 2), 1 - xx - yy + zz],
    )
    best = jnp.argmax(jnp.diagonal(products, axis1=-2, axis2=-1), -1)
    column = jnp.take_along_axis(products, best[..., None, None], -1)[..., 0]
    # q and -q are one rotation; the angle of the one with w >= 0 is at most pi.
    column = jnp.where(column[..., :1] < 0, -column, column)
    q = column / jnp.sqrt(jnp.sum(column**2, -1, keepdims=True))
    w, axis = q[..., :1], q[..., 1:]
    squared = jnp.sum(axis**2, -1, keepdims=True)
    none = squared == 0
    sine = jnp.sqrt(jnp.where(none, 1, squared))
    return axis * jnp.where(none, 2, 2 * jnp.arctan2(sine, w) / sine)


def rotations_of(vectors: Float[Array, "*b 3"]) -> Float[Array, "*b 3 3"]:
    """The rotation about each vector, by its length in radians."""
    squared = jnp.sum(vectors**2, -1)
    none = squared == 0
    angle = jnp.sqrt(jnp.where(none, 1, squared))
    w = jnp.where(none, 1, jnp.cos(angle / 2))
    factor = jnp.where(none, 0.5, jnp.sin(angle / 2) / angle)
    x, y, z = (factor * vectors[..., i] for i in range(3))
    return _matrix(
        [1 - 2 * (y**2 + z**2), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x**2 + z**2), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)],
    )


def _matrix(*rows):
    return jnp.stack([jnp.stack(row, -1) for row in rows], -2)
