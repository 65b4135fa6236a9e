"""Positions to deformation gradients of faces, and back by a Poisson equation.

The gradient F of a face is the linear map from its edges at rest to those of the moved
face (Sumner and Popovic, SIGGRAPH 2004). The direction across is its normal, as long as
the root of twice its area:

    F [u, v, n / sqrt|n|] = [u', v', n' / sqrt|n'|],   n = u x v.

F = R S, a rotation and a symmetric stretch. The features are log R and S - I, as in
Mesh-based inverse kinematics (Sumner, Zwicker, Gotsman and Popovic, SIGGRAPH 2005):
half way between two of them a limb is half way turned, and as long as it was. Between
positions it is shortened.

The positions of given gradients are those whose edges are nearest to F of the edges at
rest, in least squares weighted by cotangents:

    L p = div(F e),

with the cotangent Laplacian L at rest.
"""

import jax.numpy as jnp
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, Float, Int

from jfsf.apps.model._rotations import nearest_rotation, rotation_vectors, rotations_of
from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.geometry._stretches import root
from jfsf.geometry._surface import (
    divergence,
    next_corners,
    opposite_edges,
    sum_at_vertices,
    surface,
)

ROOT_2 = 2**0.5
# Of the linear system: least decrease of its residual, by how many steps at most.
TOLERANCE = {"float32": 1e-5, "float64": 1e-9}
MOST_STEPS = 4000


@jit
def gradients_of(
    reference: Float[Array, "n 3"],
    positions: Float[Array, "n 3"],
    faces: Int[Array, "m 3"],
) -> Float[Array, "m 9"]:
    """How each face is turned and stretched: log R and S - I of its gradient R S.

    Pure: it vmaps over positions and differentiates, except at a face that is turned by
    180 degrees, where the logarithm jumps. Of a face that is turned farther, the
    shorter way round is taken.

    Args:
        reference: the shape at rest.
        positions: the shape moved, in one frame with it: a turn of the whole counts.
        faces: of both.

    Returns:
        A row a face: three numbers of the rotation (axis times angle in radians, times
        sqrt(2)), the diagonal of S - I, and the rest of S (yz, zx, xy, times sqrt(2)).
        The square of a row is |log R|^2 + |S - I|^2, of Frobenius. 0 where nothing
        moves, and for faces that have no area at rest.
    """
    F = _deformation(reference, positions, faces)
    R = nearest_rotation(F)
    S = matmul(jnp.swapaxes(R, 1, 2), F)
    S = (S + jnp.swapaxes(S, 1, 2)) / 2
    diagonal = jnp.stack([S[:, i, i] for i in range(3)], 1) - 1
    rest = jnp.stack([S[:, 1, 2], S[:, 2, 0], S[:, 0, 1]], 1)
    turn = rotation_vectors(R)
    return jnp.concatenate([ROOT_2 * turn, diagonal, ROOT_2 * rest], 1)


@jit(static_argnames="max_steps")
def from_gradients(
    reference: Float[Array, "n 3"],
    features: Float[Array, "m 9"],
    faces: Int[Array, "m 3"],
    weights: Float[Array, " n"] | None = None,
    *,
    max_steps: int = MOST_STEPS,
) -> Float[Array, "n 3"]:
    """The positions whose gradients are nearest to given ones (Poisson equation).

    Exact where some positions have these gradients: it is the inverse of
    `gradients_of`, up to a shift. Pure: it vmaps over features and differentiates; the
    system is solved by conjugate gradients, without a matrix.

    Args:
        reference: the shape at rest; the centroid stays at its place.
        features: as from `gradients_of`.
        faces: of the shape. Vertices without a face stay, but for that shift.
        weights: of the vertices in the centroid; all alike if None.
        max_steps: of the solver, at most.
    """
    n = len(reference)
    mass = jnp.ones(n, reference.dtype) if weights is None else weights
    _, _, rest, stiff = surface(reference, faces, mass)
    turn = rotations_of(features[:, :3] / ROOT_2)
    x, y, z = (features[:, i] + 1 for i in (3, 4, 5))
    yz, zx, xy = (features[:, i] / ROOT_2 for i in (6, 7, 8))
    rows = [x, xy, zx], [xy, y, yz], [zx, yz, z]
    stretch = jnp.stack([jnp.stack(row, -1) for row in rows], -2)
    F = matmul(turn, stretch)
    right = divergence(stiff * einsum("mab,mcb->mca", F, rest), faces, n)
    both_ends = next_corners(stiff, 1) + next_corners(stiff, 2)
    diagonal = sum_at_vertices(both_ends, faces, n)

    found, _ = cg(
        lambda p: divergence(stiff * opposite_edges(p, faces), faces, n),
        right,
        reference,
        tol=TOLERANCE[reference.dtype.name],
        maxiter=max_steps,
        M=lambda residual: safe_divide(residual, diagonal),
    )
    # The equation leaves a shift free.
    share = mass / mass.sum()
    return found + einsum("n,nd->d", share, reference - found)[None]


def face_areas(
    points: Float[Array, "n 3"], faces: Int[Array, "m 3"]
) -> Float[Array, " m"]:
    """Areas of the faces, traced; `jfsf.mesh.face_areas` is their host side."""
    return root(jnp.sum(_across(points, faces)[1] ** 2, 1)) / 2


def _across(points, faces):
    """Two edges of each face, and their cross product."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    edges = b - a, c - a
    return edges, jnp.cross(*edges)


def _frame(points, faces):
    (u, v), across = _across(points, faces)
    size = root(jnp.sum(across**2, 1, keepdims=True))
    normal = safe_divide(across, root(size))
    return u, v, normal


def _deformation(reference, positions, faces):
    """F (m, 3, 3) of each face; the identity for one that has no area at rest."""
    u, v, normal = _frame(reference, faces)
    # The rows of the inverse of [u, v, normal], times its determinant.
    rows = jnp.cross(v, normal), jnp.cross(normal, u), jnp.cross(u, v)
    volume = jnp.sum(rows[2] * normal, 1, keepdims=True)
    inverse = [safe_divide(row, volume) for row in rows]
    moved = jnp.stack(_frame(positions, faces), 2)
    F = einsum("mac,mcb->mab", moved, jnp.stack(inverse, 1))
    flat = (volume == 0)[:, :, None]
    return jnp.where(flat, jnp.eye(3, dtype=F.dtype)[None], F)
