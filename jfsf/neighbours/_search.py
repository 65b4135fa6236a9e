"""How neighbours are searched: the tuned numbers, and one value with all of it."""

from dataclasses import dataclass, field, replace

import jax

from jfsf._exported import exported_dataclass
from jfsf.array._jit import check_types
from jfsf.types import Tiles

# Groups of each level of the tree of tiles whose children are ranked next, and children
# of a group, a power of two.
BEAM = 24
FAN_OUT = 8
# Relative difference between a distance and the smallest that still counts as found. On
# a mesh of 300 000 vertices the second nearest neighbour is 0.1 % farther than the
# nearest, which is less than the error of the map. It is no reason to compare all
# points.
TOLERANCE = 1e-3


@dataclass(frozen=True)
class NeighbourSettings:
    """Numbers that change which neighbours are found. Hashable, static under jit.

    With the defaults, the search among tiles finds 99.6 % or more of the nearest
    neighbours and 98 % of the others on aligned shapes of 1000 to 100 000 vertices
    (experiments/bench/bench_large.py). Its numbers were tuned together.

    bins: None finds all neighbours. A number asks for an approximate search, which
        divides the points into that many bins for each neighbour, or up to twice as
        many, and finds the nearest point of each bin. With 12, up to 4 % of the
        neighbours are missed (tests/test_mutual.py), never the nearest, and a filter
        takes two thirds of the time (experiments/bench/bench_filter.py).

    tiles: number of tiles whose points are compared with a block of queries; even. More
        are taken if there would be fewer than 6 candidates for each of k0 neighbours.
    checked: number of queries, in each direction, that are compared with the exhaustive
        search to estimate the recall. Its standard error is at most 0.5 /
        sqrt(checked).
    """

    bins: int | None = None
    tiles: int = 28
    checked: int = 64

    def __post_init__(self) -> None:
        """ValueError for values that no search can work with."""
        check_types(self)
        for name in ("bins", "tiles", "checked"):
            if (value := getattr(self, name)) is not None and value < 1:
                raise ValueError(
                    f"NeighbourSettings: {name} is {value}; it must be 1 or more"
                )
        most = BEAM * FAN_OUT
        if self.tiles % 2 or self.tiles > most:
            raise ValueError(
                f"NeighbourSettings: tiles is {self.tiles}; it must be even, and at "
                f"most {most}"
            )


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NeighbourSearch:
    """How the neighbours between two shapes X and Y are searched.

    A pytree: tiles are traced, the rest is static. So jit and vmap take it as they take
    an array, and equal static fields share a program.

    tiles: the tiles of X and of Y (`spectral_tiles`), to search among candidates at a
        cost that grows like n. None: all points are compared.
    min_recall: estimated recall among tiles below which all points are compared. 0
        leaves the comparison out of the program: for rounds of a refinement, where
        later rounds correct what is missed, and for shapes that are too large for it.
    settings: the parameters of the search.
    """

    tiles: tuple[Tiles, Tiles] | None = None
    min_recall: float = field(default=0.95, metadata={"static": True})
    settings: NeighbourSettings = field(
        default=NeighbourSettings(), metadata={"static": True}
    )

    def __post_init__(self) -> None:
        """ValueError if min_recall is not in [0, 1]."""
        # jax makes such values too, with placeholders for what is traced.
        number = isinstance(self.min_recall, int | float)
        if number and not 0 <= self.min_recall <= 1:
            raise ValueError(
                f"NeighbourSearch: min_recall is {self.min_recall}, not in [0, 1]"
            )

    def unchecked(self) -> "NeighbourSearch":
        """The same search, but that never compares all points because of the recall."""
        return replace(self, min_recall=0.0)


exported_dataclass(
    NeighbourSearch, min_recall=float, settings=lambda held: NeighbourSettings(**held)
)
