"""Shape models: a mean, and modes, those that hold the most variance first."""

from typing import NamedTuple

from jaxtyping import Array, Float, Int


class ShapeModel(NamedTuple):
    """Linear modes of positions: a shape is mean + sum_k score_k mode_k.

    mean: positions, in the unit of the shapes and the pose of the first.
    modes: orthonormal under the weights, sum_v w_v mode_k(v) . mode_l(v) = [k = l]; the
        number of largest size in each is positive.
    variance: of the scores, with s - 1 for s shapes, in squared units; the largest
        first. Its root is how far one standard deviation moves the surface, as a root
        mean square.
    scores: of the shapes that it was fitted to.
    faces: of all shapes.
    weights: of the vertices; they sum to 1.
    total_variance: of all modes, kept or not.
    size: what shapes are scaled to (`AlignedShapes.size`); 0 if they keep their scale.
    """

    mean: Float[Array, "n 3"]
    modes: Float[Array, "k n 3"]
    variance: Float[Array, " k"]
    scores: Float[Array, "s k"]
    faces: Int[Array, "m 3"]
    weights: Float[Array, " n"]
    total_variance: Float[Array, ""]
    size: Float[Array, ""]


class GradientModel(NamedTuple):
    """Modes of deformation gradients, for shapes that bend (`gradients_of`).

    A shape is from_gradients(reference, mean_features + sum_k score_k mode_k).

    mean: positions of the mean features.
    modes: orthonormal under `face_weights`; as in `ShapeModel`.
    variance, scores: without unit; roots of variance are changes of the gradients, in
        Frobenius' norm, as root mean squares over the surface.
    faces, weights, total_variance, size: as in `ShapeModel`.
    reference: positions of the most central of the shapes.
    mean_features: the mean of the shapes' features.
    face_weights: areas of the faces of the reference; they sum to 1.
    """

    mean: Float[Array, "n 3"]
    modes: Float[Array, "k m 9"]
    variance: Float[Array, " k"]
    scores: Float[Array, "s k"]
    faces: Int[Array, "m 3"]
    weights: Float[Array, " n"]
    total_variance: Float[Array, ""]
    size: Float[Array, ""]
    reference: Float[Array, "n 3"]
    mean_features: Float[Array, "m 9"]
    face_weights: Float[Array, " m"]


Model = ShapeModel | GradientModel
