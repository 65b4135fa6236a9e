"""Neighbours in both directions: among tiles when they are given, else exhaustively."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.array._jit import jit
from jfsf.neighbours._among_tiles import tiled_neighbours
from jfsf.neighbours._mutual import mutual_neighbours
from jfsf.neighbours._search import NeighbourSearch
from jfsf.types import NeighboursBothWays


@jit(static_argnames="k0")
def neighbours_both_ways(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    k0: int,
) -> NeighboursBothWays:
    """The neighbours in y of each x and in x of each y.

    Args:
        x, y: rows of one Euclidean space.
        valid_x, valid_y: points that take part; all when absent.
        search: with tiles of x and of y `tiled_neighbours` searches among candidates;
            without, or when absent, `mutual_neighbours` compares all points.
        k0: neighbours of a point, at most the number of points in the smaller set.

    Returns:
        The neighbours; without tiles recall is 1 and searched_all is true.

    Raises:
        ValueError: widths differ, or k0 is not in 1..min(n, m).
    """
    search = NeighbourSearch() if search is None else search
    options = {"k0": k0, "settings": search.settings}
    if search.tiles is not None:
        recall = search.min_recall
        return tiled_neighbours(
            x, y, *search.tiles, valid_x, valid_y, min_recall=recall, **options
        )
    near_xy, near_yx = mutual_neighbours(x, y, valid_x, valid_y, **options)
    one = jnp.ones((), near_xy.dist.dtype)
    return NeighboursBothWays(near_xy, near_yx, one, jnp.ones((), bool))
