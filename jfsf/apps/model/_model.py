"""Shapes in correspondence -> a model -> shapes: principal components of positions.

The components are those of the thin singular value decomposition of the rows sqrt(w_v)
(x_iv - m_v), one for each shape: as exact as the numbers are, where the eigenvectors of
the small matrix of products have half their digits.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.apps.model._align import align_checked, align_onto
from jfsf.apps.model._checks import check_faces, check_shapes, check_weights
from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.geometry._surface import root, sum_at_vertices
from jfsf.types import ArrayLike


class ShapeModel(NamedTuple):
    """Linear modes of positions: a shape is mean + sum_k score_k mode_k.

    mean: positions of the mean shape, in the unit of the shapes and the pose of the
        first.
    modes: orthonormal under the weights, sum_v w_v mode_k(v) . mode_l(v) = [k = l]; the
        number of largest size in each is positive.
    variance: variance of the scores of each mode, over s - 1 for s shapes, in squared
        units of the shapes; the largest first. Its root is how far one standard
        deviation moves the surface, as a root mean square.
    scores: scores of the shapes that the model was fitted to, one row for each.
    faces: the faces that all shapes share, vertices from 0.
    weights: weights of the vertices; they sum to 1.
    total_variance: variance of all modes together, kept or not.
    size: the size that shapes are scaled to (`AlignedShapes.size`); 0 if they keep
        their scale.
    """

    mean: Float[Array, "n 3"]
    modes: Float[Array, "k n 3"]
    variance: Float[Array, " k"]
    scores: Float[Array, "s k"]
    faces: Int[Array, "m 3"]
    weights: Float[Array, " n"]
    total_variance: Float[Array, ""]
    size: Float[Array, ""]


def fit_model(
    positions: Float[ArrayLike, "s n 3"],
    faces: Int[ArrayLike, "m 3"],
    *,
    modes: int | None = None,
    scale: bool = False,
    weights: Float[ArrayLike, " n"] | None = None,
) -> ShapeModel:
    """The mean of shapes in correspondence, and how they vary about it, linearly.

    The shapes are aligned first (`align`). Cootes, Taylor, Cooper and Graham (Active
    shape models, 1995); the modes are those of the surface, not of its vertices, as
    each vertex counts by its area.

    For bodies in different poses this is the wrong model: half way between an arm that
    hangs and one that is raised, positions give an arm that is too short.

    Args:
        positions: (s, n, 3) positions of vertices that correspond, in one unit. Far
            from the origin subtract the mean of each shape first, in float64.
        faces: the faces that all shapes share.
        modes: how many are kept; all s - 1 if None.
        scale: take away differences of size too.
        weights: weights of the vertices. If None, a third of the area of a vertex's
            faces, as a share of the shape's area, in the mean over the shapes.

    Raises:
        ValueError: as `align`; or more modes than s - 1.
        MeshError: faces that do not fit.
    """
    name = "fit_model"
    shapes = check_shapes(name, positions, least=2)
    corners = check_faces(name, faces, shapes)
    most = len(shapes) - 1
    if modes is not None and not 1 <= modes <= most:
        raise ValueError(
            f"{name}: modes is {modes}; so many shapes have 1 to {most}, None keeps all"
        )
    if weights is None:
        weights = vertex_shares(shapes, corners)
    mass = check_weights(name, weights, shapes)
    model = fit_checked(shapes, corners, mass, jnp.asarray(scale))
    return model._replace(
        modes=model.modes[:modes],
        variance=model.variance[:modes],
        scores=model.scores[:, :modes],
    )


def fit_checked(
    shapes: Float[Array, "s n 3"],
    faces: Int[Array, "m 3"],
    weights: Float[Array, " n"],
    scaled: Bool[Array, ""],
) -> ShapeModel:
    """`fit_model`, traced, with all modes. What it takes is as for `align_checked`."""
    mass = weights / weights.sum()
    aligned = align_checked(shapes, mass, scaled)
    mean, modes, variance, scores = _principal(aligned.positions, mass)
    total = variance.sum()
    return ShapeModel(mean, modes, variance, scores, faces, mass, total, aligned.size)


@jit
def shape_at(model: ShapeModel, scores: Float[Array, " k"]) -> Float[Array, "n 3"]:
    """Positions of the shape with these scores, in the frame of the model.

    Pure: it vmaps over scores and differentiates. The shape at three standard
    deviations of mode k is that of scores 3 sqrt(model.variance[k]) at k, 0 elsewhere.

    Args:
        model: a shape model.
        scores: scores of the first modes, as many as there are or fewer; the rest are
            0.

    Raises:
        ValueError: more scores than modes.
    """
    if scores.ndim != 1 or len(scores) > len(model.modes):
        raise ValueError(
            f"shape_at: scores are {scores.shape}, the model has {len(model.modes)} "
            "modes; vmap it over many shapes"
        )
    return model.mean + einsum("k,kec->ec", scores, model.modes[: len(scores)])


@jit(static_argnames="aligned")
def scores_of(
    model: ShapeModel, positions: Float[Array, "n 3"], *, aligned: bool = False
) -> Float[Array, " k"]:
    """The scores of a shape, which is moved onto the model's mean first.

    Pure: it vmaps over positions and differentiates. For shapes that the model was
    fitted to, they are `model.scores`.

    Args:
        model: a shape model.
        positions: (n, 3) positions of the model's vertices.
        aligned: whether it lies there already, and is to stay.

    Raises:
        ValueError: another number of vertices.
    """
    if positions.shape != model.mean.shape:
        raise ValueError(
            f"scores_of: positions are {positions.shape}, the model's mean is "
            f"{model.mean.shape}; vmap it over many shapes"
        )
    if not aligned:
        positions = align_onto(model.mean, positions, model.weights, model.size)
    return einsum("e,ec,kec->k", model.weights, positions - model.mean, model.modes)


@jit
def _principal(positions, weights):
    """Mean, all s - 1 modes, variance and scores of shapes; see `ShapeModel`.

    A vertex without weight, such as one without a face, moves with the others, as it
    does in the shapes.
    """
    k = min(len(positions) - 1, positions[0].size)
    mean = positions.mean(0)
    offsets = positions - mean[None]
    scale = jnp.sqrt(weights)[:, None]
    rows = (offsets * scale[None]).reshape(len(positions), -1)
    u, sizes, vt = jnp.linalg.svd(rows, full_matrices=False)
    u, sizes, vt = u[:, :k], sizes[:k], vt[:k]
    modes = safe_divide(vt.reshape(k, *mean.shape), scale[None])
    along = einsum("sk,sec->kec", safe_divide(u, sizes[None]), offsets)
    modes = jnp.where(scale[None] > 0, modes, along)
    # The number of largest size in each mode is to be positive.
    flat = modes.reshape(k, -1)
    largest = jnp.argmax(jnp.abs(flat), 1)
    signs = jnp.where(jnp.take_along_axis(flat, largest[:, None], 1) < 0, -1, 1)
    signs = signs[:, 0].astype(modes.dtype)
    scores = matmul(rows, vt.T) * signs[None]
    variance = sizes**2 / (len(positions) - 1)
    return mean, modes * signs[:, None, None], variance, scores


@jit
def vertex_shares(
    shapes: Float[Array, "s n 3"], faces: Int[Array, "m 3"]
) -> Float[Array, " n"]:
    """A third of the area of each vertex's faces, in the mean over the shapes.

    As a share of the shape's area, so each shape counts the same. The shapes need not
    be aligned.
    """
    areas = face_areas(shapes, faces)
    mean = safe_divide(areas, areas.sum(1, keepdims=True)).mean(0)
    corners = jnp.broadcast_to(mean[:, None], faces.shape)
    return sum_at_vertices(corners, faces, shapes.shape[1]) / mean.sum() / 3


def face_areas(
    points: Float[Array, "*s n 3"], faces: Int[Array, "m 3"]
) -> Float[Array, "*s m"]:
    """Areas of the faces, traced; `jfsf.mesh` has the same on the host."""
    a, b, c = (points[..., faces[:, i], :] for i in range(3))
    return root(jnp.sum(jnp.cross(b - a, c - a) ** 2, -1)) / 2
