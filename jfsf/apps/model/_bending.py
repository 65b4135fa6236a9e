"""Whether shapes bend, so that linear modes of positions are the wrong model."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.apps.model._align import align_checked
from jfsf.apps.model._checks import check_faces, check_shapes
from jfsf.apps.model._fit import local_gradients, vertex_shares
from jfsf.apps.model._gradients import ROOT_2
from jfsf.array import einsum
from jfsf.types import ArrayLike

# Radians, 20 degrees, in the mean over the surface. Of the MakeHuman bodies four builds
# in one pose have 0.22, and one body in six poses 0.46. Limbs turn by more: what is
# turned by three times as much is 13 % too short half way.
MOST_TURN = 0.35


def local_rotation(
    positions: Float[ArrayLike, "s n 3"], faces: Int[ArrayLike, "m 3"]
) -> Float[Array, " s"]:
    """How far the faces of each shape are turned against the most central one.

    The mean over the surface of the angle of each face's deformation gradient, in
    radians, after alignment; that of the most central shape itself is 0 but for
    rounding. Noise turns faces too: smooth a rough mesh first.

    Args:
        positions: of vertices that correspond, in one unit, as for `fit_model`.
        faces: of all shapes.

    Raises:
        ValueError: as `align`.
        MeshError: faces that do not fit.
    """
    shapes = check_shapes("local_rotation", positions, least=2)
    faces = check_faces("local_rotation", faces, shapes.shape[1])
    known = jnp.ones(shapes.shape[:2], bool)
    weights = vertex_shares(shapes, faces, known)
    aligned = align_checked(shapes, weights, known, jnp.asarray(False))
    local = local_gradients(aligned.positions, weights, faces, aligned.size)
    angles = jnp.linalg.norm(local.features[..., :3], axis=2) / ROOT_2
    return einsum("m,sm->s", local.face_weights, angles)


def bending_warning(
    positions: Float[ArrayLike, "s n 3"],
    faces: Int[ArrayLike, "m 3"],
    *,
    most_turn: float = MOST_TURN,
) -> str | None:
    """A sentence for a report where shapes bend too far for modes of positions.

    That is where the `local_rotation` of the shapes is above `most_turn` in the mean,
    without the most central one. It is a rule of thumb: half way between two positions,
    what is turned by an angle t has cos(t / 2) of its length.

    Args:
        positions, faces: as for `local_rotation`.
        most_turn: in radians.

    Returns:
        The sentence, or None where linear modes of positions will do.

    Raises:
        ValueError, MeshError: as `local_rotation`.
    """
    angles = local_rotation(positions, faces)
    mean = float(angles.sum() / (len(angles) - 1))
    if mean <= most_turn:
        return None
    return (
        f"the shapes bend: their surfaces are turned by {math.degrees(mean):.0f} "
        "degrees in the mean against the most central one, so linear modes of "
        "positions are the wrong model; use modes of gradients (fit_gradient_model)"
    )
