"""Nearest neighbour: aligned embeddings -> maps both ways (eqs. 5, 6 of Pai et al.)."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.candidates import tiled_neighbours, tiled_one_way
from jfsf.knn import neighbours
from jfsf.types import Maps, Tiles


@partial(jax.jit, static_argnames="brief")
def nearest(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    *,
    tiles: tuple[Tiles, Tiles] | None = None,
    brief: bool = False,
) -> Maps:
    """T_xy[i] is the row of `emb_y` nearest to emb_x[i], and T_yx the other way.

    Args:
        emb_x, emb_y: aligned embeddings.
        marginal_x, marginal_y: only where they are 0 matters: padding, never chosen.
        tiles: of X and of Y (`jfsf.tiles.spectral_tiles`), to search among candidates.
        brief: search tiles unchecked, and both ways in one loop: half the program, for
            the rounds of a refiner, which mend what is missed.

    Raises:
        ValueError: the embeddings differ in width.
    """
    valid_x = None if marginal_x is None else marginal_x > 0
    valid_y = None if marginal_y is None else marginal_y > 0
    if tiles is None:
        near_xy = neighbours(emb_x, emb_y, valid_y, k0=1)
        near_yx = neighbours(emb_y, emb_x, valid_x, k0=1)
    elif brief:
        near_xy, near_yx, *_ = tiled_neighbours(
            emb_x, emb_y, *tiles, valid_x, valid_y, k0=1, least=0.0
        )
    else:
        # Apart from each other, so that one that is not asked for is left out.
        near_xy, _ = tiled_one_way(emb_x, emb_y, *tiles, valid_x, valid_y, k0=1)
        near_yx, _ = tiled_one_way(emb_y, emb_x, *tiles[::-1], valid_y, valid_x, k0=1)
    T_xy, T_yx = near_xy.idx[:, 0], near_yx.idx[:, 0]
    return Maps(T_xy.astype(jnp.int32), T_yx.astype(jnp.int32))


brief_nearest = partial(nearest, brief=True)
