"""ZoomOut: alternate map and functional map while the basis grows.

Melzi et al. (SIGGRAPH Asia 2019), as an instance of algorithm 1 of Pai et al. (CVPR
2021), over any converter. Descriptors and oriented products of gradients may stand
beside the eigenfunctions, each column weighted by how well it corresponds so far.
"""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.fmap import Space, embeddings, uniform
from jfsf.orientation import carried_fields
from jfsf.types import Spectrum, Tiles

# (emb_x, emb_y, marginal_x, marginal_y) -> a record with T_xy and T_yx.
Converter = Callable[..., Any]

SLACK = 0.05  # mean square that a column may differ by before it loses weight
MANY = 6  # steps, worth a scan of their own


@partial(jax.jit, static_argnames=("ks", "converter", "space", "weighted", "both"))
def zoomout(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"],
    extra_x: Float[Array, "n_x d"] | None = None,
    extra_y: Float[Array, "n_y d"] | None = None,
    field_x: Float[Array, "n_x s s"] | None = None,
    field_y: Float[Array, "n_y t t"] | None = None,
    *,
    ks: tuple[int, ...],
    converter: Converter,
    space: Space = "direct",
    weighted: bool = False,
    both: bool = False,
    extra_weight: Float[Array, ""] | float = 1.0,
    tiles: tuple[Tiles, Tiles] | None = None,
) -> Float[Array, "k k"]:
    """Refine C_yx from ks[0] to ks[-1] eigenfunctions.

    Each step converts the map at one k and reads the functional map at the next, so
    len(ks) - 1 conversions; convert the result once more for the final map. For speed,
    refine spectra restricted to samples (`sampling.restrict`) and convert in full.

    Args:
        spec_x, spec_y: spectra with ks[-1] eigenpairs or more; mass 0 is padding.
        C_yx: the start; its leading ks[0] x ks[0] block is used.
        extra_x, extra_y: columns to append to both embeddings, such as descriptors
            (`descriptors.standardise`): at small k they hold what the basis misses.
        field_x, field_y: `orientation.bracket_fields`, to append columns that tell
            front from back under the map so far; one of them negated asks for a map
            that mirrors.
        ks: sizes of the basis, increasing; equal ones iterate in place.
        converter: `nearest`, `sinkhorn` or any other with their signature.
        space: "direct" is the field's and holds up while C_yx is still rough.
        weighted: from the second conversion on, divide each column by the root of its
            mean squared difference under the map so far. Functions that one shape does
            not share with the other (an eigenfunction of a hand that is a fist there)
            then count for little.
        extra_weight: of all appended columns beside the eigenfunctions: with 0 they
            say nothing. Traced, so hypotheses may differ in it under one vmap.
        both: average the functional map of T_xy with the adjoint of that of T_yx.
        tiles: of X and of Y (`jfsf.tiles.spectral_tiles`), handed to the converter:
            every round then searches among candidates, at a cost that grows like n.

    Returns:
        C_yx at ks[-1].

    Raises:
        ValueError: ks is empty, decreases, or does not fit C_yx or the spectra; only
            one of extra_x and extra_y, or of field_x and field_y, is given.
    """
    if not ks or list(ks) != sorted(ks):
        raise ValueError(f"zoomout: ks must not be empty or decrease, got {ks}")
    widest = min(len(spec_x.evals), len(spec_y.evals))
    if ks[-1] > widest:
        raise ValueError(f"zoomout: ks ends at {ks[-1]}, there are {widest} eigenpairs")
    if not 1 <= ks[0] <= min(C_yx.shape):
        raise ValueError(f"zoomout: C_yx is {C_yx.shape}, ks starts at {ks[0]}")
    if (extra_x is None) != (extra_y is None):
        raise ValueError("zoomout: give both extra_x and extra_y, or neither")
    if (field_x is None) != (field_y is None):
        raise ValueError("zoomout: give both field_x and field_y, or neither")
    fields = None if field_x is None else (field_x, field_y)
    extra = (
        (spec_x.evecs[:, :0] if extra_x is None else extra_x),
        (spec_y.evecs[:, :0] if extra_y is None else extra_y),
    )
    C_yx = C_yx[: ks[0], : ks[0]].astype(spec_x.evecs.dtype)
    if tiles is not None:
        converter = partial(converter, tiles=tiles)
    T_xy = jnp.full(len(spec_x.mass), -1, jnp.int32)  # none yet
    inverse_x = _inverse_factor(spec_x, ks[-1])
    inverse_y = _inverse_factor(spec_y, ks[-1]) if both else None
    steps = zip(ks[:-1], ks[1:], strict=True)
    # A scan needs one shape, so the basis is masked to k inside it.
    for width, group in _scans(steps, ks[-1]):
        options = (width, converter, space, weighted, extra_weight)
        inverses = inverse_x, inverse_y
        step = _step(spec_x, spec_y, extra, fields, inverses, *options)
        size = len(C_yx)
        if size < width:
            C_yx = jnp.pad(C_yx, (0, width - size))
        start = C_yx[:width, :width], T_xy
        (C_yx, T_xy), _ = jax.lax.scan(step, start, jnp.asarray(group))
    return C_yx[: ks[-1], : ks[-1]]


def _scans(steps, last: int):
    """(width, steps) for each doubling of the width: little waste, few programs."""
    group = []
    for width, more in groupby(steps, lambda step: _width(step[1], last)):
        group += more
        # Fewer steps do not make up for the time that another scan takes to compile.
        if len(group) >= MANY or width == last:
            yield width, group
            group = []


def _width(k: int, last: int) -> int:
    return min(max(64, 1 << (k - 1).bit_length()), last)


def _step(
    spec_x,
    spec_y,
    extra,
    fields,
    inverses,
    width,
    converter,
    space,
    weighted,
    extra_weight,
):
    evecs_x, evecs_y = spec_x.evecs[:, :width], spec_y.evecs[:, :width]
    back_x, back_y = evecs_x.T * spec_x.mass[None], evecs_y.T * spec_y.mass[None]
    uniform_x, uniform_y = uniform(spec_x.mass), uniform(spec_y.mass)
    inverse_x, inverse_y = inverses
    column = jnp.arange(width)

    def step(state, ks):
        C_yx, T_xy = state
        small = (column < ks[0]).astype(evecs_x.dtype)
        emb_x, emb_y = embeddings(
            C_yx, evecs_x * small[None], evecs_y * small[None], space=space
        )
        emb_x = jnp.concatenate([emb_x, extra[0].astype(emb_x.dtype)], 1)
        emb_y = jnp.concatenate([emb_y, extra[1].astype(emb_y.dtype)], 1)
        if fields is not None:
            turn_x, turn_y = carried_fields(
                C_yx, fields[0], fields[1], spec_y.mass, ks[0]
            )
            emb_x = jnp.concatenate([emb_x, turn_x.astype(emb_x.dtype)], 1)
            emb_y = jnp.concatenate([emb_y, turn_y.astype(emb_y.dtype)], 1)
        weight = jnp.ones(emb_x.shape[1], emb_x.dtype).at[width:].set(extra_weight)
        if weighted:
            differ = spec_x.mass @ (emb_x - emb_y[T_xy]) ** 2
            weight *= jnp.where(T_xy[0] < 0, 1, 1 / jnp.sqrt(differ + SLACK))
        emb_x, emb_y = emb_x * weight[None], emb_y * weight[None]
        maps = converter(emb_x, emb_y, uniform_x, uniform_y)
        keep = column < ks[1]
        there = _least_squares(inverse_x, _dot(back_x, evecs_y[maps.T_xy]), keep)
        if inverse_y is not None:
            back = _dot(back_y, evecs_x[maps.T_yx])
            there = (there + _least_squares(inverse_y, back, keep).T) / 2
        return (there, maps.T_xy.astype(jnp.int32)), None

    return step


# Accelerators would round the factors otherwise.
_dot = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


def _inverse_factor(spec: Spectrum, k: int) -> Array:
    """L^-1 of the Gram matrix L L^T of k eigenfunctions, which samples make skew.

    Leading blocks are those of fewer eigenfunctions, so all rounds share it. A solver
    in each round would wake LAPACK's threads, whose waiting takes a core away.
    """
    evecs = spec.evecs[:, :k]
    gram = _dot(evecs.T * spec.mass[None], evecs)
    eye = jnp.eye(k, dtype=gram.dtype)
    return jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(gram), eye, lower=True)


def _least_squares(inverse: Array, right: Array, keep: Array) -> Array:
    """Coefficients in the first eigenfunctions, those to keep; zero elsewhere."""
    inside = keep[:, None] & keep[None, :]
    inverse = jnp.where(inside, inverse[: len(keep), : len(keep)], 0)
    return _dot(inverse.T, _dot(inverse, jnp.where(inside, right, 0)))
