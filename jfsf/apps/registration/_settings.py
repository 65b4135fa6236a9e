"""The tuned numbers of a registration."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RegistrationSettings:
    """How a template is deformed onto a scan. Lengths are in sqrt(area) of the scan.

    A vertex is drawn with the force of its area over the square of a reach: the larger
    the reach, the stiffer the template.

    map_reaches: those of the rounds in which a vertex is drawn to its image.
    reaches: those of the rounds after these, to the nearest point of the scan.
    hold: reach with which the images go on to draw in these: the smaller, the less the
        template slides along the scan. Of 0.03, 0.05, 0.1 and none 0.05 had the least
        error on pairs of one body and of two.
    updates: rotations, each followed by a linear solve, of a round.
    rotation_rings, turn_reach: surroundings that the first rotations are read from, and
        how far they are smoothed.
    side_reach, min_side: where normals of the images look away from the scan's, over a
        region of this size, the map is inside out there and does not count. 1 is no
        angle between them, 0 a right one.
    max_distance: no point of the scan farther away draws a vertex.
    unmatched_distance: the same of a vertex that the map does not count for.
    min_alike: least cosine of the angle between the normals of a vertex and of the
        point that draws it.
    normal_weight: distance that normals at an angle of 1 count for, where nearest
        points are looked for.
    candidates: pieces of the scan that are looked at for each vertex.
    scale_neighbours: share of the vertices in a neighbourhood that scale and side are
        read from.
    mending_rounds: how often flaws are mended after the last round, at most. Where some
        are left, corners of their faces are moved (`jfsf.apps.registration._unfold`).
    mending_reach: how far rotations around a flaw come from.
    easing: factor of the force around a flaw, each time.
    """

    map_reaches: tuple[float, ...] = (0.1, 0.06, 0.04)
    reaches: tuple[float, ...] = (0.03, 0.02, 0.014, 0.01, 0.007, 0.005, 0.0035, 0.0025)
    updates: int = 3
    hold: float = 0.05
    rotation_rings: int = 2
    side_reach: float = 0.05
    min_side: float = 0.2
    turn_reach: float = 0.05
    max_distance: float = 0.1
    unmatched_distance: float = 0.02
    min_alike: float = 0.5
    normal_weight: float = 0.05
    candidates: int = 12
    scale_neighbours: float = 0.01
    mending_rounds: int = 2
    mending_reach: float = 0.005
    easing: float = 0.1

    def __post_init__(self) -> None:
        """ValueError for numbers that nothing can be registered with."""
        if not self.reaches or not min([*self.map_reaches, *self.reaches]) > 0:
            raise ValueError(
                f"RegistrationSettings: map_reaches are {self.map_reaches} and reaches "
                f"{self.reaches}; give one or more of these, all above 0"
            )
        for name in ("updates", "candidates", "rotation_rings"):
            if getattr(self, name) < 1:
                raise ValueError(
                    f"RegistrationSettings: {name} is {getattr(self, name)}; give 1 or "
                    "more"
                )
        for name in (
            *("hold", "side_reach", "turn_reach", "max_distance"),
            *("scale_neighbours", "mending_reach", "easing"),
        ):
            if not getattr(self, name) > 0:
                raise ValueError(
                    f"RegistrationSettings: {name} is {getattr(self, name)}; give more "
                    "than 0"
                )
