"""Nearest neighbour: aligned embeddings -> maps both ways (eqs. 5, 6 of Pai et al.)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.neighbours import NeighbourSearch, neighbours
from jfsf.neighbours._among_tiles import tiled_neighbours, tiled_one_way
from jfsf.neighbours._exhaustive import check_point_sets
from jfsf.types import Maps


@jit
def nearest(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    search: NeighbourSearch | None = None,
) -> Maps:
    """T_xy[i] is the row of `emb_y` nearest to emb_x[i], and T_yx the other way.

    T_xy[i] = argmin_j |x_i - y_j|, T_yx[j] = argmin_i |x_i - y_j| (eqs. 5 and 6 of Pai
    et al., CVPR 2021).

    Args:
        emb_x, emb_y: aligned embeddings.
        marginal_x, marginal_y: only where they are 0 matters: padding, never chosen.
        search: how neighbours are searched; when absent, all points are compared. With
            a `min_recall` of 0 one loop searches both ways: half the program.

    Raises:
        ValueError: the embeddings differ in width, or are no rows of floating numbers.
    """
    check_point_sets("nearest", emb_x=emb_x, emb_y=emb_y)
    valid_x = None if marginal_x is None else marginal_x > 0
    valid_y = None if marginal_y is None else marginal_y > 0
    search = NeighbourSearch() if search is None else search
    if search.tiles is None:
        near_xy = neighbours(emb_x, emb_y, valid_y, k0=1)
        near_yx = neighbours(emb_y, emb_x, valid_x, k0=1)
    else:
        options = {"k0": 1, "settings": search.settings}
        tiles_x, tiles_y = search.tiles
        there = emb_x, emb_y, tiles_x, tiles_y, valid_x, valid_y
        back = emb_y, emb_x, tiles_y, tiles_x, valid_y, valid_x
        if search.min_recall == 0:
            near = tiled_neighbours(*there, min_recall=0.0, **options)
            near_xy, near_yx = near.near_xy, near.near_yx
        else:
            options["min_recall"] = search.min_recall
            # Two searches, so that XLA leaves out the direction that is not used.
            near_xy = tiled_one_way(*there, **options)[0]
            near_yx = tiled_one_way(*back, **options)[0]
    T_xy, T_yx = near_xy.idx[:, 0], near_yx.idx[:, 0]
    return Maps(T_xy.astype(jnp.int32), T_yx.astype(jnp.int32))
