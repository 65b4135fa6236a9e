"""ZoomOut: alternate map and functional map while the basis grows.

Melzi et al. (SIGGRAPH Asia 2019), as an instance of algorithm 1 of Pai et al. (CVPR
2021), with any converter. Descriptors and oriented products of gradients may be
appended to the eigenfunctions. Each column can be weighted by how well it corresponds
under the map so far.
"""

from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._loops import varying_as
from jfsf.convert import Converter, maps_of
from jfsf.neighbours import NeighbourSearch
from jfsf.spectral import embeddings, uniform
from jfsf.spectral._functional_maps import Space
from jfsf.spectral._orientation import carried_fields
from jfsf.types import Spectrum

# Steps that are worth a scan of their own: with fewer, the narrower products do not
# make up for the time that another scan takes to compile.
MIN_SCAN_STEPS = 6
# Mean square by which a column may differ under the map so far before it loses weight;
# an eigenfunction's own mean square is 1. Chosen with the other numbers of `Settings`.
SLACK = 0.05


class _Columns(NamedTuple):
    """What is compared beside eigenfunctions."""

    extra_x: Float[Array, "n_x d"]
    extra_y: Float[Array, "n_y d"]
    field_x: Float[Array, "n_x s s"] | None
    field_y: Float[Array, "n_y t t"] | None
    extra_weight: Float[Array, ""] | float


@jit(
    static_argnames=(
        "ks",
        "converter",
        "space",
        "weighted",
        "bidirectional",
    ),
)
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
    bidirectional: bool = False,
    extra_weight: Float[Array, ""] | float = 1.0,
    search: NeighbourSearch | None = None,
) -> Float[Array, "k k"]:
    """Refine C_yx from ks[0] to ks[-1] eigenfunctions.

    Algorithm 1 of Pai et al. (CVPR 2021), in a basis that grows from round to round.
    Each step converts the map at one k and reads the functional map at the next, which
    makes len(ks) - 1 conversions. Convert the result once more for the final map. For
    speed, refine spectra restricted to samples (`jfsf.spectral.restrict`) and make the
    last conversion in full.

    Args:
        spec_x, spec_y: spectra with ks[-1] eigenpairs or more; mass 0 is padding.
        C_yx: the start; its leading ks[0] x ks[0] block is used.
        extra_x, extra_y: columns to append to both embeddings, such as descriptors
            (`standardise`). At small k they add what the basis lacks.
        field_x, field_y: `bracket_fields`, to append columns that tell
            front from back under the map so far. Negate one of them to ask for a map
            that mirrors.
        ks: sizes of the basis, increasing; equal ones iterate in place.
        converter: any `jfsf.convert.Converter`.
        space: "direct" is the usual one of ZoomOut and works while C_yx is still rough.
        weighted: from the second conversion on, divide each column by the root of its
            mean squared difference under the map so far. A function that one shape does
            not share with the other (an eigenfunction of a hand that is a fist there)
            then counts for little.
        bidirectional: average the functional map of T_xy with the adjoint of that of
            T_yx.
        extra_weight: factor of all appended columns; with 0 they do not count. Traced,
            so candidates may differ in it under one vmap.
        search: how neighbours are searched, handed to the converter. With tiles, every
            round searches among candidates, at a cost that grows like n; later rounds
            correct what it misses, so `min_recall` may be 0.

    Returns:
        C_yx at ks[-1].

    Raises:
        ValueError: ks is empty, decreases, does not fit C_yx or the spectra, or ends
            above the number of points of a shape; only one of extra_x and extra_y, or
            of field_x and field_y, is given.
    """
    if not ks or list(ks) != sorted(ks):
        raise ValueError(f"zoomout: ks must not be empty or decrease, got {ks}")
    widest = min(len(spec_x.evals), len(spec_y.evals))
    if ks[-1] > widest:
        raise ValueError(f"zoomout: ks ends at {ks[-1]}, there are {widest} eigenpairs")
    if (fewest := min(len(spec_x.mass), len(spec_y.mass))) < ks[-1]:
        raise ValueError(
            f"zoomout: ks ends at {ks[-1]}, and {fewest} points do not tell so many "
            "functions apart; take more samples, or end ks before"
        )
    if not 1 <= ks[0] <= min(C_yx.shape):
        raise ValueError(f"zoomout: C_yx is {C_yx.shape}, ks starts at {ks[0]}")
    if (extra_x is None) != (extra_y is None):
        raise ValueError("zoomout: give both extra_x and extra_y, or neither")
    if (field_x is None) != (field_y is None):
        raise ValueError("zoomout: give both field_x and field_y, or neither")
    columns = _Columns(
        (spec_x.evecs[:, :0] if extra_x is None else extra_x),
        (spec_y.evecs[:, :0] if extra_y is None else extra_y),
        field_x,
        field_y,
        extra_weight,
    )
    C_yx = C_yx[: ks[0], : ks[0]].astype(spec_x.evecs.dtype)
    T_xy = jnp.full(len(spec_x.mass), -1, jnp.int32)  # no map yet
    inverse_x = _inverse_factor(spec_x, ks[-1])
    inverse_y = _inverse_factor(spec_y, ks[-1]) if bidirectional else None
    steps = zip(ks[:-1], ks[1:], strict=True)
    # A scan needs one shape, so the basis is masked to k inside it.
    for width, group in _scans(steps, ks[-1]):
        step = _step(
            spec_x,
            spec_y,
            columns,
            (inverse_x, inverse_y),
            width,
            converter=converter,
            search=search,
            space=space,
            weighted=weighted,
        )
        size = len(C_yx)
        if size < width:
            C_yx = jnp.pad(C_yx, (0, width - size))
        start = varying_as(
            (C_yx[:width, :width], T_xy), spec_x, spec_y, C_yx, columns, search
        )
        (C_yx, T_xy), _ = jax.lax.scan(step, start, jnp.asarray(group))
    return C_yx[: ks[-1], : ks[-1]]


def _scans(steps, last: int) -> Iterator[tuple[int, list]]:
    """(width, steps) for each doubling of the width: little waste, few programs."""
    group = []
    for width, more in groupby(steps, lambda step: _width(step[1], last)):
        group += more
        if len(group) >= MIN_SCAN_STEPS or width == last:
            yield width, group
            group = []


def _width(k: int, last: int) -> int:
    return min(max(64, 1 << (k - 1).bit_length()), last)


def _step(
    spec_x: Spectrum,
    spec_y: Spectrum,
    columns: _Columns,
    inverses,
    width: int,
    *,
    converter: Converter,
    search: NeighbourSearch | None,
    space: Space,
    weighted: bool,
):
    evecs_x, evecs_y = spec_x.evecs[:, :width], spec_y.evecs[:, :width]
    back_x, back_y = evecs_x.T * spec_x.mass[None], evecs_y.T * spec_y.mass[None]
    uniform_x, uniform_y = uniform(spec_x.mass), uniform(spec_y.mass)
    inverse_x, inverse_y = inverses
    column = jnp.arange(width)

    def step(state, ks):
        C_yx, T_xy = state
        inside = (column < ks[0]).astype(evecs_x.dtype)
        emb_x, emb_y = embeddings(
            C_yx, evecs_x * inside[None], evecs_y * inside[None], space=space
        )
        emb_x = jnp.concatenate([emb_x, columns.extra_x.astype(emb_x.dtype)], 1)
        emb_y = jnp.concatenate([emb_y, columns.extra_y.astype(emb_y.dtype)], 1)
        if columns.field_x is not None and columns.field_y is not None:
            oriented_x, oriented_y = carried_fields(
                C_yx,
                columns.field_x,
                columns.field_y,
                spec_y.mass,
                ks[0],
            )
            emb_x = jnp.concatenate([emb_x, oriented_x.astype(emb_x.dtype)], 1)
            emb_y = jnp.concatenate([emb_y, oriented_y.astype(emb_y.dtype)], 1)
        weight = jnp.ones(emb_x.shape[1], emb_x.dtype)
        weight = weight.at[width:].set(columns.extra_weight)
        if weighted:
            differ = matmul(spec_x.mass, (emb_x - emb_y[T_xy]) ** 2)
            known = 1 / jnp.sqrt(differ + SLACK)
            weight *= jnp.where(T_xy[0] < 0, 1, known)
        emb_x, emb_y = emb_x * weight[None], emb_y * weight[None]
        maps = maps_of(converter(emb_x, emb_y, uniform_x, uniform_y, search))
        keep = column < ks[1]
        there = _least_squares(inverse_x, matmul(back_x, evecs_y[maps.T_xy]), keep)
        if inverse_y is not None:
            back = matmul(back_y, evecs_x[maps.T_yx])
            there = (there + _least_squares(inverse_y, back, keep).T) / 2
        return (there, maps.T_xy), None

    return step


def _inverse_factor(spec: Spectrum, k: int) -> Array:
    """L^-1 of the Gram matrix L L^T of k eigenfunctions, not orthonormal at samples.

    Its leading blocks are those of fewer eigenfunctions, so all rounds share it. A
    solver in each round would start LAPACK's threads, which busy-wait on another core.
    """
    evecs = spec.evecs[:, :k]
    gram = matmul(evecs.T * spec.mass[None], evecs)
    eye = jnp.eye(k, dtype=gram.dtype)
    return jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(gram), eye, lower=True)


def _least_squares(inverse: Array, right: Array, keep: Array) -> Array:
    """Coefficients in the first eigenfunctions, those to keep; zero elsewhere."""
    inside = keep[:, None] & keep[None, :]
    inverse = jnp.where(inside, inverse[: len(keep), : len(keep)], 0)
    return matmul(inverse.T, matmul(inverse, jnp.where(inside, right, 0)))
