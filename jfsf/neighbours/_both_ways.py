"""Neighbours in both directions: among tiles when they are given, else exhaustively."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jfsf.neighbours._among_tiles import tiled_neighbours
from jfsf.neighbours._mutual import mutual_neighbours
from jfsf.neighbours._settings import NeighbourSettings
from jfsf.types import NeighboursBothWays, Tiles


@partial(jax.jit, static_argnames=("k0", "min_recall", "settings"))
def neighbours_both_ways(
    x: Float[Array, "n d"],
    y: Float[Array, "m d"],
    valid_x: Bool[Array, " n"] | None = None,
    valid_y: Bool[Array, " m"] | None = None,
    *,
    k0: int,
    tiles: tuple[Tiles, Tiles] | None = None,
    min_recall: float = 0.95,
    settings: NeighbourSettings = NeighbourSettings(),
) -> NeighboursBothWays:
    """The neighbours in y of each x and in x of each y.

    Args:
        x, y: rows of one Euclidean space.
        valid_x, valid_y: points that take part; all when absent.
        k0: neighbours of a point, at most the number of points in the smaller set.
        tiles: of x and of y, for `tiled_neighbours`; without them `mutual_neighbours`
            compares all points.
        min_recall: as for `tiled_neighbours`; unused without tiles.

    Returns:
        The neighbours; without tiles recall is nan and searched_all is true.

    Raises:
        ValueError: widths differ, k0 is not in 1..min(n, m), or min_recall is not in
            [0, 1].
    """
    options = {"k0": k0, "settings": settings}
    if tiles is not None:
        return tiled_neighbours(
            x, y, *tiles, valid_x, valid_y, min_recall=min_recall, **options
        )
    near_xy, near_yx = mutual_neighbours(x, y, valid_x, valid_y, **options)
    recall = jnp.full((), jnp.nan, x.dtype)
    return NeighboursBothWays(near_xy, near_yx, recall, jnp.ones((), bool))
