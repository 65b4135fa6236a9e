"""What a converter is: aligned embeddings -> point-to-point maps both ways.

Any function with this signature works wherever the package asks for a converter: in
ICP, ZoomOut, ARAP and `match`. `nearest`, `sinkhorn`, `jfsf.baselines.auction` and
`jfsf.baselines.cpd` are converters.
"""

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

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
    """(emb_x, emb_y, marginal_x, marginal_y) -> a record with T_xy and T_yx.

    emb_x (n_x, d) and emb_y (n_y, d) are rows of one Euclidean space. The marginals
    (n_x,) and (n_y,) each sum to 1 and are 0 on padding, which no map may choose. A
    converter is traced, so it is made of JAX operations, or calls back to the host
    (`jax.pure_callback`).

    A converter that also declares the keyword `tiles` is handed the tiles of both
    shapes where there are any. One that declares `neighbour_settings` is handed those.
    In the bending and the last conversion of `match`, one that declares `min_recall`
    is handed the recall that `Settings` ask for.
    """

    def __call__(
        self,
        emb_x: Float[Array, "n_x d"],
        emb_y: Float[Array, "n_y d"],
        marginal_x: Float[Array, " n_x"],
        marginal_y: Float[Array, " n_y"],
        /,
    ) -> HasMaps:
        """The maps between two aligned embeddings."""
        ...


def with_options(converter: Converter, **options: Any) -> Converter:
    """`converter` with those of `options` that it declares by name.

    Options that are None, or that a partial has already set, are left alone.
    """
    declared = _keywords(converter)
    given = {
        name: value
        for name, value in options.items()
        if value is not None and name in declared
    }
    return partial(converter, **given) if given else converter


def maps_of(record: HasMaps) -> Maps:
    """The maps of a converter's record, as int32."""
    return Maps(record.T_xy.astype(jnp.int32), record.T_yx.astype(jnp.int32))


def _keywords(function: Callable) -> set[str]:
    """Names that can be passed by keyword and that no partial has set."""
    set_already: set[str] = set()
    while isinstance(function, partial):
        set_already |= function.keywords.keys()
        function = function.func
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # a builtin without a signature
        return set()
    kinds = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
    return {p.name for p in parameters if p.kind in kinds} - set_already
