"""How good a model is: compactness, generality and specificity.

Davies (Learning shapes: optimal models for analysis and synthesis, 2002); Styner et al.
(Evaluation of 3D correspondence methods for model building, IPMI 2003). They compare
correspondences of one set of shapes: the better one gives, for each number of modes, a
model that holds more of the variance, comes nearer to a shape that it has not seen, and
makes shapes that are nearer to real ones.

The distance of two shapes is sum_v w_v |x_v - y_v|, with the weights of the model,
which sum to 1: a mean over the surface.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.apps.model._align import align_onto
from jfsf.apps.model._checks import check_faces, check_shapes
from jfsf.apps.model._model import (
    ShapeModel,
    face_areas,
    fit_checked,
    scores_of,
    shape_at,
    vertex_shares,
)
from jfsf.array import einsum
from jfsf.array._jit import jit
from jfsf.geometry._surface import root
from jfsf.types import ArrayLike


class Compactness(NamedTuple):
    """What the first modes hold together, for each number of modes from 1.

    variance: C(m) = sum_{k <= m} variance_k.
    share: of the total variance.
    """

    variance: Float[Array, " k"]
    share: Float[Array, " k"]


class Distances(NamedTuple):
    """Mean distances for some numbers of modes; smaller is better.

    counts: the numbers of modes.
    distance: in the unit of the shapes.
    share: in sqrt(area) of the shapes, scaled as in the model; not of the mean, which
        is too small where shapes are in different poses.
    standard_error: of the distance, that a finite number of shapes gives it.
    """

    counts: Int[Array, " c"]
    distance: Float[Array, " c"]
    share: Float[Array, " c"]
    standard_error: Float[Array, " c"]


def compactness(model: ShapeModel) -> Compactness:
    """The variance that the first modes hold, C(m) = sum_{k <= m} variance_k."""
    variance = jnp.cumsum(model.variance)
    return Compactness(variance, variance / model.total_variance)


def generality(
    positions: Float[ArrayLike, "s n 3"],
    faces: Int[ArrayLike, "m 3"],
    *,
    scale: bool = False,
    counts: tuple[int, ...] | None = None,
) -> Distances:
    """How near a model comes to a shape that it was not fitted to, one left out a time.

        G(m) = 1/s sum_i |x_i - x_i'(m)|,

    x_i'(m) the shape of the model of all others that has the first m scores of x_i.
    The error is the standard deviation over i, over sqrt(s - 1) (Styner et al.).

    One program for all shapes; it takes as long as fitting s models.

    Args:
        positions: (s, n, 3) positions of vertices that correspond, in one unit, as for
            `fit_model`.
        faces: the faces that all shapes share.
        scale: take away differences of size too, as `fit_model` does.
        counts: numbers of modes to measure; 1 to s - 2, all that s - 1 shapes have, if
            None.

    Raises:
        ValueError: fewer than three shapes, or numbers of modes that models of s - 1
            shapes do not have; as `fit`.
        MeshError: as `fit`.
    """
    shapes = check_shapes("generality", positions, least=3)
    corners = check_faces("generality", faces, shapes)
    numbers = jnp.array(_checked("generality", counts, len(shapes) - 2))
    distance, length = _left_out(shapes, corners, numbers, jnp.asarray(scale))
    error = distance.std(0) / jnp.sqrt(jnp.asarray(len(shapes) - 1, distance.dtype))
    share = (distance / length[:, None]).mean(0)
    return Distances(numbers, distance.mean(0), share, error)


def specificity(
    model: ShapeModel,
    positions: Float[ArrayLike, "s n 3"],
    key: Array,
    *,
    samples: int = 1000,
    counts: tuple[int, ...] | None = None,
) -> Distances:
    """How near random shapes of the model are to the shapes that it was fitted to.

        S(m) = 1/N sum_j min_i |y_j(m) - x_i|,

    y_j(m) of independent normal scores of the variance of each of the first m modes.
    The error is the standard deviation over j, over sqrt(N) (Styner et al.).

    Args:
        model: a shape model.
        positions: the shapes that it was fitted to.
        key: a key of `jax.random`.
        samples: N.
        counts: numbers of modes; if None 1 to all of them.

    Raises:
        ValueError: no samples, numbers of modes that the model does not have, or shapes
            of other vertices.
    """
    shapes = check_shapes("specificity", positions, least=1)
    if shapes.shape[1:] != model.mean.shape:
        raise ValueError(
            f"specificity: shapes are {shapes.shape}, the model's mean is "
            f"{model.mean.shape}"
        )
    if samples < 1:
        raise ValueError(f"specificity: samples is {samples}, it must be positive")
    numbers = jnp.array(_checked("specificity", counts, len(model.modes)))
    distance, length = _of_samples(model, shapes, key, numbers, samples=samples)
    error = distance.std(0) / jnp.sqrt(jnp.asarray(samples, distance.dtype))
    mean = distance.mean(0)
    return Distances(numbers, mean, mean / length.mean(), error)


@jit
def _left_out(shapes, faces, counts, scaled):
    """Distances (s, c), and sqrt(area) (s,) of the shape that is left out."""
    s = len(shapes)

    def without(i):
        others = shapes[(i + 1 + jnp.arange(s - 1)) % s]
        weights = vertex_shares(others, faces)
        model = fit_checked(others, faces, weights, scaled)
        left = align_onto(model.mean, shapes[i], model.weights, model.size)
        scores = scores_of(model, left, aligned=True)

        def distance(count):
            near = shape_at(model, _first(scores, count))
            return mean_distance(near, left, model.weights)

        return jax.lax.map(distance, counts), _length(left, faces)

    return jax.lax.map(without, jnp.arange(s))


@jit(static_argnames="samples")
def _of_samples(model, shapes, key, counts, *, samples):
    """Distances (samples, c) to the nearest shape, and sqrt(area) (s,) of all."""
    onto = jax.vmap(align_onto, (None, 0, None, None))
    aligned = onto(model.mean, shapes, model.weights, model.size)
    modes = len(model.modes)
    scores = jax.random.normal(key, (samples, modes), model.mean.dtype)
    scores = scores * jnp.sqrt(model.variance)[None]

    def of_sample(scores):
        def distance(count):
            drawn = shape_at(model, _first(scores, count))
            to = partial(mean_distance, drawn, weights=model.weights)
            return jax.vmap(to)(aligned).min()

        return jax.lax.map(distance, counts)

    return jax.lax.map(of_sample, scores), _length(aligned, model.faces)


def _first(scores, number) -> Any:
    """Scores with all but the first few 0; how many is traced."""
    return jnp.where(jnp.arange(len(scores)) < number, scores, 0)


def _length(shapes, faces):
    return jnp.sqrt(face_areas(shapes, faces).sum(-1))


def mean_distance(
    x: Float[Array, "n 3"], y: Float[Array, "n 3"], weights: Float[Array, " n"]
) -> Float[Array, ""]:
    """sum_v w_v |x_v - y_v|."""
    return einsum("n,n->", weights, root(jnp.sum((x - y) ** 2, 1)))


def _checked(name, counts, most):
    counts = tuple(range(1, most + 1)) if counts is None else counts
    if not counts or min(counts) < 0 or max(counts) > most:
        raise ValueError(
            f"{name}: counts is {counts}; models of these shapes have 0 to {most} modes"
        )
    return counts
