"""The tuned numbers of the search for the region that two shapes share."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from jfsf.refine import ArapSettings

REACHES = (0.3, 0.3, 0.2, 0.2, 0.14, 0.14, 0.1, 0.1, 0.07, 0.07, 0.05, 0.05)
CURVATURE_WEIGHTS = (*(0.1,) * 6, *(0.03,) * 3, 0.0)
SCALES = tuple(float(scale) for scale in np.exp(np.linspace(-0.45, 0.45, 10)))
ANY_SCALES = tuple(float(scale) for scale in np.exp(np.linspace(-0.9, 0.9, 19)))
ANY_ALIGNED_SCALES = tuple(float(s) for s in np.exp(np.linspace(-0.75, 0.75, 6)))


class RegisterWeights(NamedTuple):
    """Of what ranks maps; a small sum is good.

    The first three make `Certificate.region_cost`, and the confidence of parts was
    fitted to it by these numbers.

    residual, energy, share: of the logarithms of what is read of a whole that was drawn
        onto a part (`jfsf.matching.parts._register`).
    log_odds: of those of the map between the regions, once it is refined.
    size: of the logarithm of the factor of the part's lengths, read only where units
        may differ. A small part leaves little apart, wherever it lies.
    """

    residual: float = 6.95
    energy: float = 1.0
    share: float = -1.04
    log_odds: float = -0.06
    size: float = -2.23


@dataclass(frozen=True)
class PartSettings:
    """How `match(partial=True)` finds the region. Hashable.

    Of the two shapes the one that is bent is called the whole, the other the part.
    Lengths are in the square root of the area of the whole. Factors have no unit.

    Samples:

    samples_of_part: farthest points of the part, among which anchors are chosen.
    samples_of_whole: farthest points of the whole, in which their partners are looked
        for.
    boundary_samples: vertices on a boundary, at most, from which the distance to it is
        measured.
    along_cut_factor: a shortest path between two samples may run along the cut, and so
        be shorter in the whole, if a path by the boundary is at most so many times as
        long,
    along_cut_slack: and this length.

    Descriptors, each of the ball of points within a distance of a sample:

    ball_radii: these distances, the greatest last. Balls that reach the boundary are
        not compared.
    ball_steepness: of the border of a ball, which is soft because few vertices lie in a
        small one. A vertex at radius r (1 + 1 / ball_steepness) has weight 0.27.
    ball_reach: in greatest radii, the distance beyond which a vertex has no weight.
    max_ball_difference: in standard deviations; a greater difference counts as this.
    ball_difference_unit: standard deviations that count as 1.
    unread_ball_difference: of all samples, if no two can be compared.
    descriptor_weight: of the difference of descriptors that are given, beside that of
        the balls.

    Assignment of anchors, which are samples of the part, to samples of the whole:

    anchors: samples that are assigned, beside as many landmarks at most.
    boundary_margin: distance from the boundary from which on a sample counts in full
        when anchors are chosen far apart.
    boundary_worth: how much one on the boundary counts.
    scales: factors of the part's lengths that are tried where both are in one unit.
        Their range bounds how much bodies may differ in size.
    any_scales: those where units may differ, once the geodesic diameters are the same.
    scale_bands: into so many the factors fall, in their order; each keeps its share of
        the assignments. A small part fits in many places, and would crowd out others.
    any_scale_bands: the same where units may differ,
    any_unit_factor: and then so many times `assignments`, `alignments` and
        `registered_again`: there are more sizes to try.
    distance_slack: length by which two distances differ that counts half,
    distance_share: beside this share of the distance in the part.
    shorter_weight: factor of that difference where the path in one runs along its cut
        and the distance in the other is shorter.
    direction_weight: of the directions in which anchors see each other, beside the
        distances.
    ball_weight: of the difference of the balls, beside the distances.
    scale_weight: cost of a scale e times as large or small, per anchor, where both are
        in one unit.
    partners: samples of the whole that an assignment is followed with for the next
        anchor.
    beam: assignments that are followed.
    beam_candidates: of these per place in the beam, the best that are sorted into
        groups.
    cells: samples of the whole around which its other samples form a cell.
    grouped_anchors: assignments whose first partners, so many, share cells are a group.
    min_groups: groups in the beam, at least, if there are so many: else one would crowd
        out the others before it is known to be wrong.
    unassigned_cost: of an anchor without a partner, beside a closed whole.
    unassigned_cost_open: the same beside an open whole, which may lack the partner.
    assignments: the best ones, at most, by which the whole is drawn.
    min_partner_distance: mean distance of their partners, in which two of these differ.

    Rigid alignment of coarse copies, by which the whole is drawn too:

    rotations: that are tried, spread over all.
    aligned_scales: factors of the part's lengths that are tried with each.
    any_aligned_scales: the same where units may differ; in the bands of assignments.
    alignment_cell: of the grid of shifts.
    alignment_blur: width of the Gaussian by which both surfaces are blurred.
    alignment_density: how much a surface counts beside its normals.
    alignments: the best ones, by which the whole is drawn; 0 leaves them out.
    min_alignment_distance: mean distance of where two of these lay the part.

    Registration, where a coarse copy of the whole is drawn onto one of the part by each
    of these starts:

    max_landmark_distance: a start misses a landmark whose image is further away than
        this from where it should be. Those that miss more than others are dropped.
    anchor_radius: distance from an anchor below which its weight for the first dense
        map levels off.
    coarse_whole: vertices of the copy of the whole.
    coarse_part: vertices of that of the part.
    first_reach: length in which the first step smooths the motion of the whole; the
        assignment is trusted.
    first_updates: deformations in the first step.
    reaches: of the steps that follow, each with a search for the nearest vertices. When
        all starts are drawn, every second one.
    updates: deformations in each of these.
    registered_normal_weight: of normals in that search, as in `ArapSettings`.
    curvature_times: heat times of the curvature that is compared beside positions and
        normals, see `jfsf.matching.parts._curvature`. In squared lengths.
    max_curvature: in standard deviations; a greater one counts as this.
    registered_curvature_weight: length that a difference of one standard deviation
        counts as.
    covered_distance: in a step, what is further away than this is not covered by an
        open whole,
    covered_reach: beside this share of the reach.
    trimmed_reach: from this reach on, what lies beyond the whole's boundary is not.
    registered_again: the best starts, by which it is drawn again from where it came to.
    register_weights: of what ranks the starts.

    Region:

    refined: the best starts, by which all of the whole is drawn onto the part, and
        the map between the regions refined: at most.
    sure: log odds (`jfsf.types.Certificate`) from which on a refined map is kept, and
        no other is tried. Below, the map by drawing stays. 2 is seven to one.
    carried_by: vertices of the copy whose motion carries one of the whole.
    bend: how the whole is deformed, and the weight of normals in the search for the
        nearest vertices.
    drawn_curvature_weights: one a deformation, each with such a search: the length that
        a difference of curvature of one standard deviation counts as.
    draw_steps: of conjugate gradients in each, at most.
    cover_distance: a surface further away covers nothing.
    rim_width: length over which a surface ceases to cover, at its rim. About an edge.
    uncovered_weight: how much vertices that nothing covers draw, beside 1 for the
        others.
    refinements: of the map between the regions of the best, if it is sure; its rivals
        get one.
    min_vertices: a region with fewer is no result: it must be matched, see
        `jfsf.Settings.min_vertices`.
    """

    samples_of_part: int = 80
    samples_of_whole: int = 300
    boundary_samples: int = 80
    along_cut_factor: float = 1.02
    along_cut_slack: float = 0.01
    ball_radii: tuple[float, ...] = (0.05, 0.08, 0.12, 0.17, 0.23, 0.3)
    ball_steepness: float = 12.0
    ball_reach: float = 1.2
    max_ball_difference: float = 3.0
    ball_difference_unit: float = 1.5
    unread_ball_difference: float = 0.5
    descriptor_weight: float = 1.0
    anchors: int = 16
    boundary_margin: float = 0.15
    boundary_worth: float = 0.3
    scales: tuple[float, ...] = SCALES
    any_scales: tuple[float, ...] = ANY_SCALES
    scale_bands: int = 1
    any_scale_bands: int = 3
    any_unit_factor: float = 1.5
    distance_slack: float = 0.03
    distance_share: float = 0.12
    shorter_weight: float = 0.4
    direction_weight: float = 1.0
    ball_weight: float = 1.2
    scale_weight: float = 0.15
    partners: int = 6
    beam: int = 2500
    beam_candidates: int = 8
    cells: int = 24
    grouped_anchors: int = 3
    min_groups: int = 120
    unassigned_cost: float = 1.1
    unassigned_cost_open: float = 0.75
    assignments: int = 32
    min_partner_distance: float = 0.1
    rotations: int = 400
    aligned_scales: tuple[float, ...] = (0.9, 1.15)
    any_aligned_scales: tuple[float, ...] = ANY_ALIGNED_SCALES
    alignment_cell: float = 0.1
    alignment_blur: float = 0.1
    alignment_density: float = 0.3
    alignments: int = 8
    min_alignment_distance: float = 0.15
    max_landmark_distance: float = 0.15
    anchor_radius: float = 0.05
    coarse_whole: int = 1000
    coarse_part: int = 600
    first_reach: float = 0.15
    first_updates: int = 20
    reaches: tuple[float, ...] = REACHES
    updates: int = 3
    registered_normal_weight: float = 0.1
    curvature_times: tuple[float, ...] = (0.0003, 0.001, 0.003)
    max_curvature: float = 3.0
    registered_curvature_weight: float = 0.15
    covered_distance: float = 0.03
    covered_reach: float = 0.5
    trimmed_reach: float = 0.14
    registered_again: int = 12
    register_weights: RegisterWeights = RegisterWeights()
    refined: int = 1
    sure: float = 2.0
    carried_by: int = 4
    bend: ArapSettings = field(default_factory=ArapSettings)
    drawn_curvature_weights: tuple[float, ...] = CURVATURE_WEIGHTS
    draw_steps: int = 150
    cover_distance: float = 0.1
    rim_width: float = 0.02
    uncovered_weight: float = 1e-3
    refinements: int = 2
    min_vertices: int = 160

    def __post_init__(self) -> None:
        """ValueError for numbers that no region can be found with."""
        for name in (
            *("scale_bands", "any_scale_bands"),
            *("samples_of_whole", "boundary_samples", "partners", "beam_candidates"),
            *("cells", "grouped_anchors", "min_groups", "assignments", "rotations"),
            *("first_updates", "updates", "draw_steps"),
            *("carried_by", "refined", "refinements", "min_vertices"),
        ):
            if getattr(self, name) < 1:
                raise ValueError(
                    f"PartSettings: {name} is {getattr(self, name)}; give 1 or more"
                )
        for name in (
            *("ball_steepness", "ball_reach", "ball_difference_unit"),
            *("boundary_margin", "distance_slack", "anchor_radius", "cover_distance"),
            *(
                *("rim_width", "uncovered_weight", "first_reach"),
                *("max_landmark_distance", "max_curvature", "any_unit_factor"),
                *("alignment_cell", "alignment_blur", "alignment_density"),
            ),
        ):
            if getattr(self, name) <= 0:
                raise ValueError(
                    f"PartSettings: {name} is {getattr(self, name)}; give more than 0"
                )
        for name in (
            *("ball_radii", "scales", "any_scales", "aligned_scales"),
            *("any_aligned_scales", "reaches", "curvature_times"),
        ):
            values = getattr(self, name)
            if not values or min(values) <= 0:
                raise ValueError(
                    f"PartSettings: {name} is {values}; give one or more above 0"
                )
        weights = self.drawn_curvature_weights
        facts = {
            f"drawn_curvature_weights is {weights}; give one or more, none below 0": (
                len(weights) > 0 and min(weights) >= 0
            ),
            f"ball_radii is {self.ball_radii}; let them increase": (
                list(self.ball_radii) == sorted(self.ball_radii)
            ),
            f"anchors is {self.anchors}, samples_of_part {self.samples_of_part}; "
            "assign 3 or more, and no more than there are": (
                3 <= self.anchors <= self.samples_of_part
            ),
            f"boundary_worth is {self.boundary_worth}; give 0 to 1": (
                0 <= self.boundary_worth <= 1
            ),
            f"beam is {self.beam}, min_groups {self.min_groups}; follow no fewer": (
                self.beam >= self.min_groups
            ),
            f"coarse_whole is {self.coarse_whole}, coarse_part {self.coarse_part}; "
            "give 4 or more": min(self.coarse_whole, self.coarse_part) >= 4,
        }
        for message, holds in facts.items():
            if not holds:
                raise ValueError(f"PartSettings: {message}")
