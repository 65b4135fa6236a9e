"""ZoomOut: alternate map and functional map while the basis grows.

Melzi et al. (SIGGRAPH Asia 2019), as an instance of algorithm 1 of Pai et al. (CVPR
2021), over any converter.
"""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.fmap import Space, embeddings, uniform
from jfsf.types import Spectrum

# (emb_x, emb_y, marginal_x, marginal_y) -> a record with T_xy and T_yx.
Converter = Callable[..., Any]


@partial(jax.jit, static_argnames=("ks", "converter", "space", "vote"))
def zoomout(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"],
    *,
    ks: tuple[int, ...],
    converter: Converter,
    space: Space = "direct",
    vote: bool = True,
) -> Float[Array, "K K"]:
    """Refine C_yx from ks[0] to ks[-1] eigenfunctions."""
    if not ks or list(ks) != sorted(ks):
        raise ValueError(f"zoomout: ks must increase, got {ks}")
    widest = min(len(spec_x.evals), len(spec_y.evals))
    if ks[-1] > widest:
        raise ValueError(f"zoomout: ks ends at {ks[-1]}, there are {widest} eigenpairs")
    if min(C_yx.shape) < ks[0]:
        raise ValueError(f"zoomout: C_yx is {C_yx.shape}, ks starts at {ks[0]}")
    C_yx = C_yx[: ks[0], : ks[0]]
    steps = list(zip(ks[:-1], ks[1:], strict=True))
    # A scan needs one shape: the basis is masked to k inside it. Grouping the steps by
    # doubling widths keeps the waste below a factor of two.
    for width, group in groupby(steps, lambda step: _width(step[1], ks[-1])):
        here = jnp.asarray(list(group))
        C_yx = _grow(
            spec_x, spec_y, C_yx, here, width, converter=converter, space=space, vote=vote
        )
    return C_yx[: ks[-1], : ks[-1]]


def _width(k: int, last: int) -> int:
    return min(max(32, 1 << (k - 1).bit_length()), last)


def _grow(spec_x, spec_y, C_yx, steps, width, *, converter, space, vote):
    evecs_x, evecs_y = spec_x.evecs[:, :width], spec_y.evecs[:, :width]
    back_x = _weighted(evecs_x, spec_x.mass)
    back_y = _weighted(evecs_y, spec_y.mass)
    gram_x, gram_y = back_x @ evecs_x, back_y @ evecs_y
    uniform_x, uniform_y = uniform(spec_x.mass), uniform(spec_y.mass)
    column = jnp.arange(width)

    def step(C_yx, ks):
        small, large = column < ks[0], column < ks[1]
        emb_x, emb_y = embeddings(
            C_yx, evecs_x * small, evecs_y * small, space=space
        )
        maps = converter(emb_x, emb_y, uniform_x, uniform_y)
        there = _solve(gram_x, back_x @ evecs_y[maps.T_xy], large)
        if vote:
            back = _solve(gram_y, back_y @ evecs_x[maps.T_yx], large)
            there = (there + back.T) / 2
        return there, None

    size = min(width, len(C_yx))
    start = jnp.zeros((width, width), evecs_x.dtype)
    start = start.at[:size, :size].set(C_yx[:size, :size].astype(evecs_x.dtype))
    return jax.lax.scan(step, start, steps)[0]


def _weighted(evecs, mass):
    return evecs.T * mass


def _solve(gram, right, keep):
    """Least squares in the first eigenfunctions only; zero elsewhere."""
    inside = keep[:, None] & keep[None, :]
    gram = jnp.where(inside, gram, jnp.eye(len(gram), dtype=gram.dtype))
    return jax.scipy.linalg.solve(gram, jnp.where(inside, right, 0), assume_a="pos")

