"""Scores to shapes and back; the one place that knows the kinds of models apart."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.apps.model._align import align_onto
from jfsf.apps.model._gradients import from_gradients, gradients_of
from jfsf.apps.model._records import Model, ShapeModel
from jfsf.array import einsum
from jfsf.array._jit import jit


@jit
def shape_at(model: Model, scores: Float[Array, " k"]) -> Float[Array, "n 3"]:
    """Positions of the shape with these scores, in the frame of the model.

    Pure: it vmaps over scores and differentiates. The shape at three standard
    deviations of mode k is that of scores 3 sqrt(model.variance[k]) at k, 0 elsewhere.

    Args:
        model: of either kind.
        scores: of the first modes, as many as there are or fewer; the rest are 0.

    Raises:
        ValueError: more scores than modes.
    """
    if scores.ndim != 1 or len(scores) > len(model.modes):
        raise ValueError(
            f"shape_at: scores are {scores.shape}, the model has {len(model.modes)} "
            "modes; vmap it over many shapes"
        )
    moved = einsum("k,kec->ec", scores, model.modes[: len(scores)])
    if isinstance(model, ShapeModel):
        return model.mean + moved
    features = model.mean_features + moved
    return from_gradients(model.reference, features, model.faces, model.weights)


@jit(static_argnames="aligned")
def scores_of(
    model: Model, positions: Float[Array, "n 3"], *, aligned: bool = False
) -> Float[Array, " k"]:
    """The scores of a shape, which is moved into the model's frame (`moved_onto`).

    Pure: it vmaps over positions and differentiates. For shapes that the model was
    fitted to, they are `model.scores`.

    Args:
        model: of either kind.
        positions: of the vertices of the model.
        aligned: whether it lies in that frame already, and is to stay there.

    Raises:
        ValueError: another number of vertices.
    """
    if positions.shape != model.mean.shape:
        raise ValueError(
            f"scores_of: positions are {positions.shape}, the model's mean is "
            f"{model.mean.shape}; vmap it over many shapes"
        )
    if not aligned:
        positions = moved_onto(model, positions)
    if isinstance(model, ShapeModel):
        offsets, weights = positions - model.mean, model.weights
    else:
        features = gradients_of(model.reference, positions, model.faces)
        offsets, weights = features - model.mean_features, model.face_weights
    return einsum("e,ec,kec->k", weights, offsets, model.modes)


def moved_onto(model: Model, positions: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """A shape in the frame of a model, moved as those were that it was fitted to.

    That is onto the mean, or onto the reference of a model of gradients.
    """
    target = model.mean if isinstance(model, ShapeModel) else model.reference
    return align_onto(target, positions, model.weights, model.size)


def first_scores(scores: Float[Array, " k"], number: Array | int) -> Float[Array, " k"]:
    """Scores with all but the first few 0; how many is traced."""
    return jnp.where(jnp.arange(len(scores)) < number, scores, 0)
