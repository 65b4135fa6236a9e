"""The tuned numbers of the searches for neighbours."""

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class NeighbourSettings:
    """Numbers that change which neighbours are found. Hashable, static under jit.

    With the defaults, the search among tiles finds 99.6 % or more of the nearest
    neighbours and 98 % of the others on aligned shapes of 1000 to 100 000 vertices
    (experiments/bench_large.py). Its numbers were tuned together.

    Exhaustive search:

    margin: candidates beyond k0 of `neighbours`. float32 selects them, and the input's
        precision ranks them again.
    bins: bins of points for each neighbour of `mutual_neighbours`, at least; twice as
        many at most. One point of a bin is found. On average, one neighbour in 2 `bins`
        or fewer shares a bin with a nearer one; tests/test_mutual.py measures it.
    product_rows: points of X in one product of `mutual_neighbours`, a power of two. A
        bin has at most so many points.

    Tiles:

    tile_size: points of a tile, at most.
    tile_eigenpairs: eigenpairs whose eigenfunctions place a vertex. Higher ones vary
        within a tile and make it less compact.
    power_iterations: steps to the principal axis of a part. A rough axis is enough: it
        need only be a long side of the part.

    Search among tiles:

    tiles: tiles whose points are compared with a block of queries; even. More are
        taken where `candidates_per_neighbour` asks for them.
    candidates_per_neighbour: candidates for each of the k0 neighbours, at least.
    block_queries: queries that share their candidates, at most: as many tiles as fit,
        at least one.
    ranking_stride: one in so many queries of a block ranks the tiles.
    spread: share of a tile's mean square radius that is subtracted from its squared
        distance, because points of a wide tile may be nearer than its centre.
    root_tiles: the largest number of tiles, or groups of tiles, that are all ranked.
        Larger numbers are grouped into a tree.
    fan_out: children of a group in that tree, a power of two, at most `root_tiles`.
    beam: groups of each level whose children are ranked next. They must have `tiles`
        children or more.
    checked: queries of each direction that are compared with the exhaustive search to
        estimate the recall. The standard error is 0.5 / sqrt(checked) at most.
    tolerance: relative difference between a distance and the smallest that still counts
        as found. On a mesh of 300 000 vertices the second nearest neighbour is 0.1 %
        farther than the nearest, which is less than the error of the map. It is no
        reason to compare all points.
    """

    margin: int = 3
    bins: int = 12
    product_rows: int = 128
    tile_size: int = 16
    tile_eigenpairs: int = 60
    power_iterations: int = 3
    tiles: int = 28
    candidates_per_neighbour: int = 6
    block_queries: int = 64
    ranking_stride: int = 2
    spread: float = 0.5
    root_tiles: int = 64
    fan_out: int = 8
    beam: int = 24
    checked: int = 64
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        """ValueError for values that no search can work with."""
        at_least_0 = "margin", "spread", "tolerance", "power_iterations"
        for name in (f.name for f in fields(self)):
            value, least = getattr(self, name), 0 if name in at_least_0 else 1
            if not value >= least:
                raise ValueError(
                    f"NeighbourSettings: {name} is {value}; it must be {least} or more"
                )
        for name in ("product_rows", "fan_out"):
            value = getattr(self, name)
            if value & (value - 1) or value < 2:
                raise ValueError(
                    f"NeighbourSettings: {name} is {value}; it must be a power of two"
                )
        if self.tile_eigenpairs < 2:
            raise ValueError(
                f"NeighbourSettings: tile_eigenpairs is {self.tile_eigenpairs}; the "
                "first is constant, so it must be 2 or more"
            )
        most = self.beam * self.fan_out
        if self.tiles % 2 or self.tiles > most:
            raise ValueError(
                f"NeighbourSettings: tiles is {self.tiles}; it must be even, and at "
                f"most beam * fan_out = {most}"
            )
        if self.fan_out > self.root_tiles:
            raise ValueError(
                f"NeighbourSettings: fan_out is {self.fan_out}, above root_tiles = "
                f"{self.root_tiles}"
            )
