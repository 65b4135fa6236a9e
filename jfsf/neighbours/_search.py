"""How neighbours are searched, as one value that goes from function to function."""

from dataclasses import dataclass, field, replace

import jax

from jfsf.neighbours._settings import NeighbourSettings
from jfsf.types import Tiles


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NeighbourSearch:
    """How the neighbours between two shapes X and Y are searched.

    A pytree: tiles are traced, the rest is static. So jit and vmap take it as they take
    an array, and equal static fields share a program.

    tiles: of X and of Y (`spectral_tiles`), to search among candidates at a cost that
        grows like n. None: all points are compared.
    min_recall: estimated recall among tiles below which all points are compared. 0
        leaves the comparison out of the program: for rounds of a refinement, where
        later rounds correct what is missed, and for shapes that are too large for it.
    settings: the tuned numbers of the search.
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
