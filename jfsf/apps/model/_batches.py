"""A model of more shapes than memory holds, a few at a time.

The singular value decomposition is brought up to date with each batch (Ross, Lim, Lin
and Yang, Incremental learning for robust visual tracking, IJCV 2008; Brand 2002): the
rows of the matrix are the modes so far, the batch, and how far the mean has moved. It
is exact as long as all modes are kept.
"""

from collections.abc import Iterable
from itertools import chain
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jfsf.apps.model._checks import check_faces, check_shapes, check_weights
from jfsf.apps.model._fit import vertex_shares, with_signs
from jfsf.apps.model._records import ShapeModel
from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.types import ArrayLike


class _State(NamedTuple):
    """What is known of the shapes so far; rows are scaled by the root of the weights.

    number: how many there were.
    mean: (d,).
    modes: (k, d), orthonormal; sizes: (k,) their singular values.
    squares: the sum of squared distances from the mean.
    """

    number: Array
    mean: Array
    modes: Array
    sizes: Array
    squares: Array


def fit_model_in_batches(
    batches: Iterable[Any],
    faces: Int[ArrayLike, "m 3"],
    *,
    modes: int = 50,
    weights: Float[ArrayLike, " n"] | None = None,
) -> ShapeModel:
    """A model like that of `fit_model`, of shapes that come a few at a time.

    It holds one batch and twice as many modes as are asked for. Where those are as many
    as the shapes, it is the model of `fit_model`; else it is near to it, as what the
    modes left out hold is not seen again.

    Args:
        batches: arrays (b, n, 3) of positions, aligned with each other before: move
            each shape onto a mean of some of them by `align_onto`.
        faces: of all shapes.
        modes: how many there are in the end.
        weights: of the vertices; if None, those of `fit_model` of the first batch.

    Raises:
        ValueError: fewer than two shapes in all, or arrays that do not fit each other.
        MeshError: faces that do not fit.
    """
    name = "fit_model_in_batches"
    if modes < 1:
        raise ValueError(f"{name}: modes is {modes}, it must be positive")
    remaining = iter(batches)
    first = check_shapes(name, next(remaining, np.zeros((0, 1, 3))), least=1)
    _, n, _ = first.shape
    faces, dtype = check_faces(name, faces, n), first.dtype
    if weights is None:
        weights = vertex_shares(first, faces, jnp.ones(first.shape[:2], bool))
    mass = check_weights(name, weights, n, dtype)
    if not mass.all():
        raise ValueError(
            f"{name}: vertex {jnp.argmin(mass)} has weight 0, as one without a face "
            "has; take it out of the shapes, or give weights"
        )
    mass = mass / mass.sum()
    root = jnp.sqrt(mass)[:, None]
    none = jnp.zeros((0, 3 * n), dtype)
    state = _State(jnp.zeros((), dtype), none.sum(0), none, none[:, 0], none.sum())
    scores = []
    for batch in chain([first], remaining):
        shapes = check_shapes(name, batch, least=1).astype(dtype)
        if shapes.shape[1] != n:
            raise ValueError(
                f"{name}: a batch is {shapes.shape}, those before have {n} vertices"
            )
        rows = (shapes * root[None]).reshape(len(shapes), -1)
        kept = min(2 * modes, len(state.modes) + len(rows), 3 * n)
        new = _updated(state, rows, kept=kept)
        # Scores so far in the new modes, and about the new mean.
        change, shift = _change(state, new)
        scores = [matmul(old, change) + shift[None] for old in scores]
        scores.append(matmul(rows - new.mean[None], new.modes.T))
        state = new
    total = sum(map(len, scores))
    if total < 2:
        raise ValueError(f"{name}: there is {total} shape, it needs 2 or more")
    kept = min(modes, total - 1, len(state.modes))
    found, signs = with_signs(state.modes[:kept].reshape(kept, n, 3) / root[None])
    return ShapeModel(
        mean=state.mean.reshape(n, 3) / root,
        modes=found,
        variance=state.sizes[:kept] ** 2 / (total - 1),
        scores=jnp.concatenate(scores)[:, :kept] * signs[None],
        faces=faces,
        weights=mass,
        total_variance=state.squares / (total - 1),
        size=jnp.zeros((), dtype),
    )


@jit(static_argnames="kept")
def _updated(state, rows, *, kept):
    """The state with more rows; so many modes of it."""
    b = len(rows)
    number = state.number + b
    moved = rows.mean(0) - state.mean
    offsets = rows - rows.mean(0)[None]
    both = state.number * b / number  # 0 before the first batch
    between = jnp.sqrt(both) * moved
    matrix = [state.sizes[:, None] * state.modes, offsets, between[None]]
    _, sizes, vt = jnp.linalg.svd(jnp.concatenate(matrix), full_matrices=False)
    return _State(
        number,
        state.mean + b / number * moved,
        vt[:kept],
        sizes[:kept],
        state.squares + jnp.sum(offsets**2) + jnp.sum(between**2),
    )


@jit
def _change(old, new):
    change = matmul(old.modes, new.modes.T)
    return change, einsum("d,kd->k", old.mean - new.mean, new.modes)
