"""The settings of the searches for neighbours."""

from dataclasses import dataclass

FAN_OUT = 8  # children of a group in the tree of tiles, a power of two
BEAM = 24  # groups of each level of the tree whose children are ranked next
MOST_TILES = BEAM * FAN_OUT


@dataclass(frozen=True)
class NeighbourSettings:
    """Which neighbours are found, and how sure that is. Hashable, static under jit.

    With the defaults, the search among tiles finds 99.6 % or more of the nearest
    neighbours and 98 % of the others on aligned shapes of 1000 to 100 000 vertices
    (experiments/bench_large.py).

    bins: bins of points for each neighbour of `mutual_neighbours`, at least; twice as
        many at most. One point of a bin is found. On average, one neighbour in 2 `bins`
        or fewer shares a bin with a nearer one; tests/test_mutual.py measures it. A
        number above that of the points makes the search exact.
    tiles: tiles whose points are compared with a block of queries; even. More are taken
        for many neighbours.
    checked: queries of each direction that are compared with the exhaustive search to
        estimate the recall. The standard error is 0.5 / sqrt(checked) at most.
    tolerance: relative difference between a distance and the smallest that still counts
        as found. On a mesh of 300 000 vertices the second nearest neighbour is 0.1 %
        farther than the nearest, which is less than the error of the map. It is no
        reason to compare all points.
    """

    bins: int = 12
    tiles: int = 28
    checked: int = 64
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        """ValueError for values that no search can work with."""
        for name, least in (
            ("bins", 1),
            ("tiles", 2),
            ("checked", 1),
            ("tolerance", 0),
        ):
            value = getattr(self, name)
            if not value >= least:
                raise ValueError(
                    f"NeighbourSettings: {name} is {value}; it must be {least} or more"
                )
        if self.tiles % 2 or self.tiles > MOST_TILES:
            raise ValueError(
                f"NeighbourSettings: tiles is {self.tiles}; it must be even, and at "
                f"most {MOST_TILES}"
            )
