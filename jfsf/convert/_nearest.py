"""Nearest neighbour: aligned embeddings -> maps both ways (eqs. 5, 6 of Pai et al.)."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.neighbours import (
    NeighbourSettings,
    neighbours,
    tiled_neighbours,
    tiled_one_way,
)
from jfsf.types import Maps, Tiles


@partial(jax.jit, static_argnames=("min_recall", "neighbour_settings"))
def nearest(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    *,
    tiles: tuple[Tiles, Tiles] | None = None,
    min_recall: float = 0.95,
    neighbour_settings: NeighbourSettings = NeighbourSettings(),
) -> Maps:
    """T_xy[i] is the row of `emb_y` nearest to emb_x[i], and T_yx the other way.

    Args:
        emb_x, emb_y: aligned embeddings.
        marginal_x, marginal_y: only where they are 0 matters: padding, never chosen.
        tiles: of X and of Y (`jfsf.neighbours.spectral_tiles`), to search among
            candidates.
        min_recall: recall among tiles below which all points are compared. 0 leaves the
            check out, and searches both ways in one loop: half the program. For rounds
            of a refinement, where later rounds correct what is missed.
        neighbour_settings: of the search among tiles.

    Raises:
        ValueError: the embeddings differ in width, or min_recall is not in [0, 1].
    """
    valid_x = None if marginal_x is None else marginal_x > 0
    valid_y = None if marginal_y is None else marginal_y > 0
    if tiles is None:
        near_xy = neighbours(emb_x, emb_y, valid_y, k0=1, settings=neighbour_settings)
        near_yx = neighbours(emb_y, emb_x, valid_x, k0=1, settings=neighbour_settings)
    else:
        there = emb_x, emb_y, *tiles, valid_x, valid_y
        back = emb_y, emb_x, *tiles[::-1], valid_y, valid_x
        options = {"k0": 1, "settings": neighbour_settings}
        if min_recall == 0:
            found = tiled_neighbours(*there, min_recall=0.0, **options)
            near_xy, near_yx = found.near_xy, found.near_yx
        else:
            # Two searches, so that XLA leaves out the direction that is not used.
            near_xy, _ = tiled_one_way(*there, min_recall=min_recall, **options)
            near_yx, _ = tiled_one_way(*back, min_recall=min_recall, **options)
    T_xy, T_yx = near_xy.idx[:, 0], near_yx.idx[:, 0]
    return Maps(T_xy.astype(jnp.int32), T_yx.astype(jnp.int32))


quick_nearest: partial[Maps] = partial(nearest, min_recall=0.0)
