"""Two aligned embeddings -> the kernel between their neighbours, and the marginals."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array._loops import map_sides
from jfsf.convert import _kernel as kernels
from jfsf.neighbours import NeighbourSearch
from jfsf.neighbours._both_ways import neighbours_both_ways
from jfsf.types import Kernel


class KernelAndMarginals(NamedTuple):
    """The kernel of two embeddings, the marginals, and the recall of the search."""

    kernel: Kernel
    marginal_x: Float[Array, " n_x"]
    marginal_y: Float[Array, " n_y"]
    recall: Float[Array, ""]


def kernel_between(
    emb_x: Array,
    emb_y: Array,
    marginal_x: Array | None,
    marginal_y: Array | None,
    search: NeighbourSearch | None,
    lam: Array | float,
    *,
    k0: int,
    scale: kernels.Scale,
    length_gradient: bool,
    power: float,
    unilateral_weight: float,
) -> KernelAndMarginals:
    """The kernel of eq. 12, and uniform marginals where there are none."""
    marginal_x, marginal_y = uniform_marginals(emb_x, emb_y, marginal_x, marginal_y)
    valid_x, valid_y = marginal_x > 0, marginal_y > 0
    k0 = min(k0, len(emb_x), len(emb_y))
    near_both = neighbours_both_ways(emb_x, emb_y, valid_x, valid_y, search, k0=k0)
    near_xy, near_yx = near_both.near_xy, near_both.near_yx
    length_xy, length_yx = map_sides(
        lambda near: kernels.length(near, scale, length_gradient),
        (near_xy,),
        (near_yx,),
    )
    # In this unit neither lengths times each other nor their powers leave the range of
    # the type; it is a power of two, so nothing is rounded.
    exponent = jnp.frexp(jax.lax.stop_gradient(length_xy))[1]
    unit = jnp.ldexp(jnp.ones_like(length_xy), exponent)
    near_xy, near_yx = (n._replace(dist=n.dist / unit) for n in (near_xy, near_yx))
    length_xy, length_yx = length_xy / unit, length_yx / unit
    if scale == "nearest":
        length_xy = length_yx = jnp.sqrt(length_xy * length_yx)
    lam = jnp.asarray(lam, emb_x.dtype)
    kernel = kernels.build(
        near_xy,
        near_yx,
        lam / length_xy**power,
        lam / length_yx**power,
        power=power,
        unilateral_weight=unilateral_weight,
    )
    return KernelAndMarginals(kernel, marginal_x, marginal_y, near_both.recall)


def uniform_marginals(
    emb_x: Array, emb_y: Array, marginal_x: Array | None, marginal_y: Array | None
) -> tuple[Array, Array]:
    """The marginals, uniform where there are none."""
    if marginal_x is None:
        marginal_x = jnp.full(len(emb_x), 1 / len(emb_x), emb_x.dtype)
    if marginal_y is None:
        marginal_y = jnp.full(len(emb_y), 1 / len(emb_y), emb_y.dtype)
    return marginal_x, marginal_y
