"""What a converter is: aligned embeddings -> point-to-point maps both ways.

Any function with this signature works wherever the package asks for a converter: in
ICP, ZoomOut, ARAP and `match`. `nearest` and `sinkhorn` are converters, and so are the
auction and CPD of `experiments/paper/baselines`.
"""

from typing import Protocol

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.neighbours import NeighbourSearch
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
