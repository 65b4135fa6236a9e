"""What a converter is: aligned embeddings -> point-to-point maps both ways.

Any function with this signature works wherever the package asks for a converter: in
ICP, ZoomOut, ARAP and `match`. `nearest` and `sinkhorn` are converters, and so are the
auction and CPD of `experiments/paper/baselines`.
"""

from typing import Protocol

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array._jit import jit
from jfsf.neighbours import NeighbourSearch, neighbours
from jfsf.neighbours._among_tiles import tiled_neighbours, tiled_one_way
from jfsf.neighbours._exhaustive import check_point_sets
from jfsf.types import Maps


class HasMaps(Protocol):
    """A record with a point-to-point map each way."""

    @property
    def T_xy(self) -> Int[Array, " n_x"]:
        """The vertex of Y for each vertex of X."""
        ...

    @property
    def T_yx(self) -> Int[Array, " n_y"]:
        """The vertex of X for each vertex of Y."""
        ...


class Converter(Protocol):
    """(emb_x, emb_y, marginal_x, marginal_y, search) -> a record with T_xy and T_yx.

    emb_x (n_x, d) and emb_y (n_y, d) are rows of one Euclidean space. The marginals
    (n_x,) and (n_y,) each sum to 1 and are 0 on padding, which no map may choose. A
    converter is traced, so it is made of JAX operations, or calls back to the host
    (`jax.pure_callback`).

    search says how neighbours are searched: their tiles, and the recall to check. None
    means that all points are compared. A converter that searches no neighbours, or in a
    way of its own, ignores it.
    """

    def __call__(
        self,
        emb_x: Float[Array, "n_x d"],
        emb_y: Float[Array, "n_y d"],
        marginal_x: Float[Array, " n_x"],
        marginal_y: Float[Array, " n_y"],
        search: NeighbourSearch | None,
        /,
    ) -> HasMaps:
        """The maps between two aligned embeddings."""
        ...


def maps_of(record: HasMaps) -> Maps:
    """T_xy and T_yx of the record that a converter returned, as int32."""
    return Maps(record.T_xy.astype(jnp.int32), record.T_yx.astype(jnp.int32))


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
