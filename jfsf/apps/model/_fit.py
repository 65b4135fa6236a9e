"""Shapes in correspondence -> a model: alignment, then principal components.

The components are those of the thin singular value decomposition of the rows
sqrt(w_v) (x_iv - m_v), one a shape: as exact as the numbers are, where the eigenvectors
of the small matrix of products have half their digits.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.apps.model._align import align_checked, align_onto
from jfsf.apps.model._checks import (
    check_faces,
    check_mask,
    check_modes,
    check_shapes,
    check_weights,
    is_known,
)
from jfsf.apps.model._gradients import face_areas, from_gradients, gradients_of
from jfsf.apps.model._records import GradientModel, ShapeModel
from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.geometry._surface import sum_at_vertices
from jfsf.types import ArrayLike


def fit_model(
    positions: Float[ArrayLike, "s n 3"],
    faces: Int[ArrayLike, "m 3"],
    *,
    modes: int | None = None,
    scale: bool = False,
    weights: Float[ArrayLike, " n"] | None = None,
    missing: Bool[ArrayLike, "s n"] | None = None,
) -> ShapeModel:
    """The mean of shapes in correspondence, and how they vary about it, linearly.

    The shapes are aligned first (`align`). Cootes, Taylor, Cooper and Graham (Active
    shape models, 1995); the modes are those of the surface, not of its vertices, as
    each vertex counts by its area.

    For shapes in different poses this is the wrong model: see `bending_warning` and
    `fit_gradient_model`.

    Args:
        positions: of vertices that correspond, in one unit; far from the origin pass
            `centred` ones.
        faces: of all shapes.
        modes: how many are kept; all s - 1 if None.
        scale: take away differences of size too.
        weights: of the vertices. If None a third of the area of a vertex's faces, as a
            share of the shape's area, in the mean over the shapes.
        missing: vertices that a shape does not have; they are put at the mean.

    Raises:
        ValueError: as `align`; a vertex that all shapes miss; or more modes than s - 1.
        MeshError: faces that do not fit.
    """
    name = "fit_model"
    shapes, faces, mass, known = _checked(name, positions, faces, weights, missing)
    check_all_known(name, known)
    modes = check_modes(name, modes, len(shapes) - 1)
    aligned = align_checked(shapes, mass, known, jnp.asarray(scale))
    found = principal(aligned.positions, mass)
    return ShapeModel(
        mean=found.mean,
        modes=found.modes[:modes],
        variance=found.variance[:modes],
        scores=found.scores[:, :modes],
        faces=faces,
        weights=mass,
        total_variance=found.variance.sum(),
        size=aligned.size,
    )


def fit_gradient_model(
    positions: Float[ArrayLike, "s n 3"],
    faces: Int[ArrayLike, "m 3"],
    *,
    modes: int | None = None,
    scale: bool = False,
    weights: Float[ArrayLike, " n"] | None = None,
) -> GradientModel:
    """The mean of shapes that bend, and how they vary about it, by their gradients.

    As `fit_model`, but of the features of `gradients_of`: principal components of how
    faces are turned and stretched, relative to the shape nearest to the mean of
    positions, onto which all are moved. A face that is turned by more than 180 degrees
    from there is taken the shorter way round.

    Args:
        positions, faces, modes, scale, weights: as for `fit_model`.

    Raises:
        ValueError, MeshError: as `fit_model`.
    """
    name = "fit_gradient_model"
    shapes, faces, mass, known = _checked(name, positions, faces, weights)
    modes = check_modes(name, modes, len(shapes) - 1)
    aligned = align_checked(shapes, mass, known, jnp.asarray(scale))
    local = local_gradients(aligned.positions, mass, faces, aligned.size)
    found = principal(local.features, local.face_weights)
    return GradientModel(
        mean=from_gradients(local.reference, found.mean, faces, mass),
        modes=found.modes[:modes],
        variance=found.variance[:modes],
        scores=found.scores[:, :modes],
        faces=faces,
        weights=mass,
        total_variance=found.variance.sum(),
        size=aligned.size,
        reference=local.reference,
        mean_features=found.mean,
        face_weights=local.face_weights,
    )


class LocalGradients(NamedTuple):
    """Shapes by their gradients against the most central of them.

    reference: positions of the shape that is nearest to the mean.
    features: `gradients_of` each shape.
    face_weights: areas of the faces of the reference; they sum to 1.
    """

    reference: Float[Array, "n 3"]
    features: Float[Array, "s m 9"]
    face_weights: Float[Array, " m"]


@jit
def local_gradients(
    aligned: Float[Array, "s n 3"],
    weights: Float[Array, " n"],
    faces: Int[Array, "m 3"],
    size: Float[Array, ""],
) -> LocalGradients:
    """Gradients of aligned shapes, which are moved onto the most central one.

    Args:
        aligned: `AlignedShapes.positions`.
        weights: of the vertices.
        faces: of all shapes.
        size: `AlignedShapes.size`.
    """
    offsets = aligned - aligned.mean(0)[None]
    nearest = jnp.argmin(einsum("n,snd->s", weights, offsets**2))
    reference = aligned[nearest]
    onto = jax.vmap(align_onto, (None, 0, None, None))
    positions = onto(reference, aligned, weights, size)
    features = jax.vmap(gradients_of, (None, 0, None))(reference, positions, faces)
    areas = face_areas(reference, faces)
    return LocalGradients(reference, features, areas / areas.sum())


class Principal(NamedTuple):
    """Principal components of rows (e, c) of features, orthonormal under weights."""

    mean: Float[Array, "e c"]
    modes: Float[Array, "k e c"]
    variance: Float[Array, " k"]
    scores: Float[Array, "s k"]


@jit
def principal(
    features: Float[Array, "s e c"], weights: Float[Array, " e"]
) -> Principal:
    """All s - 1 modes of features, about their mean; see `ShapeModel`.

    An element without weight, such as a vertex without a face, moves with the others,
    as it does in the shapes.
    """
    k = min(len(features) - 1, features[0].size)
    mean = features.mean(0)
    offsets = features - mean[None]
    root = jnp.sqrt(weights)[:, None]
    rows = (offsets * root[None]).reshape(len(features), -1)
    u, sizes, vt = jnp.linalg.svd(rows, full_matrices=False)
    u, sizes, vt = u[:, :k], sizes[:k], vt[:k]
    found = safe_divide(vt.reshape(k, *mean.shape), root[None])
    along = einsum("sk,sec->kec", safe_divide(u, sizes[None]), offsets)
    found, signs = with_signs(jnp.where(root[None] > 0, found, along))
    scores = matmul(rows, vt.T) * signs[None]
    return Principal(mean, found, sizes**2 / (len(features) - 1), scores)


def with_signs(
    modes: Float[Array, "k e c"],
) -> tuple[Float[Array, "k e c"], Float[Array, " k"]]:
    """Modes whose number of largest size is positive, and the signs that this took."""
    flat = modes.reshape(len(modes), -1)
    largest = jnp.argmax(jnp.abs(flat), 1)
    signs = jnp.where(jnp.take_along_axis(flat, largest[:, None], 1) < 0, -1, 1)
    signs = signs[:, 0].astype(modes.dtype)
    return modes * signs[:, None, None], signs


@jit
def vertex_shares(
    shapes: Float[Array, "s n 3"], faces: Int[Array, "m 3"], known: Bool[Array, "s n"]
) -> Float[Array, " n"]:
    """A third of the area of each vertex's faces, in the mean over the shapes.

    As a share of the shape's area, so each shape counts the same. A face counts in the
    shapes that have its three corners. The shapes need not be aligned.
    """
    whole = known[:, faces].all(2)
    shapes = jnp.where(known[..., None], shapes, 0)
    areas = jnp.where(whole, jax.vmap(face_areas, (0, None))(shapes, faces), 0)
    areas = safe_divide(areas, areas.sum(1, keepdims=True))
    mean = safe_divide(areas.sum(0), whole.sum(0).astype(areas.dtype))
    corners = jnp.broadcast_to(mean[:, None], faces.shape)
    return sum_at_vertices(corners, faces, shapes.shape[1]) / mean.sum() / 3


def check_all_known(name: str, known: Bool[Array, "s n"]) -> None:
    """ValueError if all shapes miss a vertex."""
    if not is_known(known):
        return
    nowhere = jnp.flatnonzero(~known.any(0))
    if len(nowhere):
        raise ValueError(
            f"{name}: all shapes miss vertex {nowhere[0]}, and {len(nowhere)} vertices "
            "in all; take them out of the shapes and the faces"
        )


def _checked(name, positions, faces, weights, missing=None):
    """The arguments of both functions, and what is not missing."""
    shapes = check_shapes(name, positions, missing, least=2)
    faces = check_faces(name, faces, shapes.shape[1])
    known = check_mask(name, missing, shapes.shape[:2])
    if weights is None:
        weights = vertex_shares(shapes, faces, known)
    mass = check_weights(name, weights, shapes.shape[1], shapes.dtype)
    return shapes, faces, mass / mass.sum(), known
