"""What one may set of the search for the region that two shapes share."""

from dataclasses import dataclass

import numpy as np

from jfsf.array._jit import check_types

# Groups of scales that keep their share of all starts where units may differ.
ANY_UNIT_BANDS = 3
SCALES = tuple(float(scale) for scale in np.exp(np.linspace(-0.45, 0.45, 10)))


@dataclass(frozen=True)
class PartSettings:
    """How `match(partial=True)` finds the region. Hashable.

    Of the two shapes the one that is deformed is called the whole, the other the part.
    More samples, starts or places in the beam take longer and find more regions.

    samples_of_part: number of farthest points of the part, among which anchors are
        chosen.
    samples_of_whole: number of farthest points of the whole, among which the partners
        of anchors are searched.
    anchors: number of samples of the part that are assigned to samples of the whole, 3
        or more. At most as many landmarks are assigned in addition.
    scales: factors of the part's lengths that are tried if both shapes are in one unit.
        Their range bounds how much bodies may differ in size.
    beam: number of assignments of the first few anchors that are kept while the next
        anchor is assigned.
    assignments: most finished assignments that are starts of a registration.
    alignments: number of rigid motions that are starts of a registration; 0 for none.
    registered_again: number of starts, those of least cost, that are registered a
        second time, from where the first registration ended.
    refined: most starts, those of least cost first, whose map between the regions is
        refined.
    sure: log odds (`jfsf.types.Certificate`) from which on a refined map is kept, and
        no other start is refined. Below, the map by deformation of the whole is kept. 2
        is seven to one.
    """

    samples_of_part: int = 80
    samples_of_whole: int = 300
    anchors: int = 16
    scales: tuple[float, ...] = SCALES
    beam: int = 2500
    assignments: int = 32
    alignments: int = 8
    registered_again: int = 12
    refined: int = 2
    sure: float = 2.0

    def __post_init__(self) -> None:
        """ValueError for numbers that no region can be found with."""
        check_types(self)
        for name in ("samples_of_whole", "beam", "assignments", "refined"):
            if getattr(self, name) < 1:
                raise ValueError(
                    f"PartSettings: {name} is {getattr(self, name)}; give 1 or more"
                )
        if not 3 <= self.anchors <= self.samples_of_part:
            raise ValueError(
                f"PartSettings: anchors is {self.anchors}, samples_of_part "
                f"{self.samples_of_part}; assign 3 or more, and no more than there are"
            )
        if not self.scales or min(self.scales) <= 0:
            raise ValueError(
                f"PartSettings: scales is {self.scales}; give one or more above 0"
            )
