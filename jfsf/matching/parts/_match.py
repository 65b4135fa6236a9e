"""Two shapes of which one is a part of the other, or that overlap. Host side.

A cut changes all eigenfunctions, but where the region that both share is known, and cut
out of both, the shapes are whole again: the usual refinement then is as accurate as for
whole shapes. So the work is to find that region.

1. Assign a few samples by what a cut leaves (`_beam`): many assignments. Landmarks are
   samples whose partners are known. And lay coarse copies on each other by rigid
   motions (`_alignments`). Of people, a network says where on a person the vertices lie
   (`jfsf.learned`): one more start. A map that is given is the only one.
2. Draw a coarse copy of Y, the shape that is whole or the greater part of it, onto X by
   each of these (`_register`), by the best of them twice. What is left apart, the
   energy, and what the network says rank the starts (`_starts`).
3. Draw all of Y onto X by the best few (`_region`): this gives a map and a region.
4. Cut both shapes to the region, refine the map between the cuts, and draw again. The
   refinement spreads the one region over all of the other: where its own evidence
   (`Certificate.log_odds`) is poor the regions differ, and the map by drawing stays. Of
   several maps that of the best evidence is kept: before the refinement, and after it.
5. How clearly a vertex is in the region (`memberships`) is read from the last drawing.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.learned._places import Places
from jfsf.matching.parts._region import (
    Drawn,
    Target,
    covered_by,
    draw_onto,
    memberships,
    nearest,
    target,
)
from jfsf.matching.parts._register import Registered
from jfsf.matching.parts._settings import PartSettings
from jfsf.matching.parts._sides import Sides, both_sides, landmarks_within
from jfsf.matching.parts._starts import WEIGHTS, Start, first_starts
from jfsf.matching.parts._surfaces import (
    cut,
    inverse_map,
    openness,
    scaled,
    wound,
)
from jfsf.refine._rest import follow
from jfsf.types import ArrayLike, Certificate, Mesh

CARRIED_BY = 4  # vertices of the coarse copy whose motion carries one of the whole
# A region with fewer vertices is no result: it must be matched as a whole shape.
MIN_VERTICES = 160
# (part of X, part of Y, T_xy) -> a match of these. Where there are landmarks in both
# parts, they are a fourth argument: rows (vertex of the part of X, of that of Y).
Refine = Callable[..., Any]


class Parts(NamedTuple):
    """Maps between shapes that share a region.

    T_xy, T_yx: of all vertices; outside of the region the nearest after bending.
    membership_x, membership_y: how clearly a vertex is in the region, in [0, 1].
    certificate: of the map between the regions, refined, even where it is not kept.
        Without a confidence, which depends on landmarks outside of the region too.
    scale: factor that brings X to the size of Y.
    """

    T_xy: np.ndarray
    T_yx: np.ndarray
    membership_x: np.ndarray
    membership_y: np.ndarray
    certificate: Certificate
    scale: float

    @property
    def matched_x(self) -> np.ndarray:
        """Whether a vertex of X is in the region."""
        return self.membership_x > 0.5

    @property
    def matched_y(self) -> np.ndarray:
        """Whether a vertex of Y is in the region."""
        return self.membership_y > 0.5


class _State(NamedTuple):
    """A map on the way.

    x: X at the size of Y.
    start: what it was drawn by first.
    T_xy, T_yx: the map so far.
    inside: the vertices of Y that X covers.
    match: between the regions, once it is refined.
    """

    x: Target
    drawn: Drawn
    scale: float
    start: Start
    T_xy: np.ndarray
    T_yx: np.ndarray
    inside: np.ndarray
    match: Any = None

    @property
    def log_odds(self) -> float:
        """Of the map between the regions."""
        return float(np.nan_to_num(self.match.certificate.log_odds, nan=-np.inf))

    @property
    def score(self) -> float:
        """Small is good: the evidence before the refinement and that after it."""
        return self.start.rank + WEIGHTS.log_odds * self.log_odds


def match_parts(
    mesh_x: Mesh,
    mesh_y: Mesh,
    refine: Refine,
    sign: int = 1,
    *,
    T_xy: ArrayLike | None = None,
    T_yx: ArrayLike | None = None,
    landmarks: ArrayLike | None = None,
    descriptors: tuple[ArrayLike, ArrayLike] | None = None,
    places: Places | None = None,
    same_unit: bool = True,
    settings: PartSettings = PartSettings(),
    progress: Callable[[str], object] | None = None,
) -> Parts:
    """Find the region that two shapes share, and the maps.

    Args:
        mesh_x, mesh_y: one connected piece each, with faces.
        refine: makes a match of two meshes from a map between their vertices, and rows
            of landmarks if there are any (`Refine`).
        sign: 1 for a map that keeps left and right, -1 for its mirror image, 0 for the
            better one.
        T_xy: a map to begin with, in place of the search: the vertex of Y for each
            vertex of X. It keeps left and right or not, whatever `sign` says.
        T_yx: that map the other way, read where Y is the part; when absent,
            `inverse_map`.
        landmarks: rows (vertex of X, vertex of Y) that correspond.
        descriptors: (n_x, d) and (n_y, d), what else the samples are compared by.
        places: where on a person each vertex of both lies, if it is known.
        same_unit: whether both are in one unit. Then bodies may differ in size by a
            factor of 1.57 either way, see `PartSettings.scales`; else their sizes are
            not read, and X is first made as long as Y.
        settings: the numbers of the search.
        progress: called with the name of each step as it begins.

    Raises:
        ValueError: no region of enough vertices was found.
    """
    # The shape that is open, or the smaller one, is called X from here on.
    if openness(mesh_x, same_unit) < openness(mesh_y, same_unit):
        if T_xy is not None and T_yx is None:
            T_yx = inverse_map(np.asarray(T_xy), mesh_y)
        other = match_parts(
            mesh_y,
            mesh_x,
            refine,
            sign,
            T_xy=None if T_xy is None else T_yx,
            landmarks=None if landmarks is None else np.asarray(landmarks)[:, ::-1],
            descriptors=None if descriptors is None else descriptors[::-1],
            places=None if places is None else places[::-1],
            same_unit=same_unit,
            settings=settings,
            progress=progress,
        )
        return _swapped(other)
    both = both_sides(
        mesh_x,
        mesh_y,
        landmarks=landmarks,
        descriptors=descriptors,
        places=places,
        same_unit=same_unit,
        settings=settings,
    )
    begin = first_starts(both, sign, T_xy, progress)
    tried = []
    for sides, start in begin[: settings.refined]:
        state = _refined(_drawn(sides, start), sides, refine)
        tried += [] if state is None else [(state, sides)]
        if state is not None and state.log_odds >= settings.sure:
            break
    if not tried:
        raise ValueError(
            f"match: found no region of {MIN_VERTICES} vertices "
            "that both shapes share; finer meshes, or one unit for both, may help"
        )
    tried.sort(key=lambda pair: pair[0].score)
    state, sides = tried[0]
    margin = state.log_odds - tried[1][0].log_odds if tried[1:] else np.inf
    if state.log_odds >= settings.sure:
        again = _refined(state, sides, refine)
        if again is not None and again.log_odds > state.log_odds:
            state = again
    return _result(state, sides, margin)


def _swapped(parts: Parts) -> Parts:
    certificate = parts.certificate
    other = {"x": "y", "y": "x", "xy": "yx", "yx": "xy"}
    both = {
        f"{name}_{end}": getattr(certificate, f"{name}_{other[end]}")
        for name, ends in (("coverage", ("xy", "yx")), ("bijectivity", ("x", "y")))
        for end in ends
    }
    return Parts(
        parts.T_yx,
        parts.T_xy,
        parts.membership_y,
        parts.membership_x,
        certificate._replace(**both),
        1 / parts.scale,
    )


def _drawn(sides: Sides, start: Start) -> _State:
    """All of Y drawn onto X, which is brought to the size that was found."""
    scale = start.scale / start.registered.scale
    x = scaled(sides.x.mesh, scale)
    x = target(x, sides.curvature_x(scale))
    moved = _moved(sides, start.registered)
    bent = target(wound(Mesh(moved, sides.y.mesh.faces), sides.sign))
    T_xy = nearest(bent, x.mesh.vertices, x.normal)[0]
    return _state(sides, x, scale, start, moved, T_xy)


def _moved(sides: Sides, registered: Registered) -> np.ndarray:
    """Positions of Y, each moved like the near vertices of its coarse copy."""
    y = sides.y.mesh.vertices
    rest = sides.whole.mesh.vertices
    flip = np.array([sides.sign, 1, 1])
    away, near = KDTree(rest).query(y * flip, CARRIED_BY)
    moved = registered.moved / registered.scale
    return follow(y * flip, rest, moved, registered.rotation, np.asarray(near), away)


def _state(sides: Sides, x: Target, scale, start: Start, moved, T_xy) -> _State:
    """Draw, and read the map and the region."""
    y = sides.y.mesh
    drawn = draw_onto(y, x, moved, T_xy, sides.sign, sides.curvature_y)
    T_yx, inside = covered_by(x, y, drawn, sides.sign)
    return _State(x, drawn, scale, start, drawn.T_xy, T_yx, inside)


def _refined(state: _State, sides: Sides, refine: Refine) -> _State | None:
    """Cut both shapes to the region, refine the map between the cuts, draw again.

    Of a refined map with log odds below `PartSettings.sure` only the evidence is kept.
    """
    y, drawn = sides.y.mesh, state.drawn
    part_x, part_y = cut(state.x.mesh, drawn.matched_x), cut(y, state.inside)
    if min(len(part_x.index), len(part_y.index)) < MIN_VERTICES:
        return None
    # A partner outside of the cut gives way to the nearest inside.
    tree = KDTree(part_y.mesh.vertices)
    start = tree.query(y.vertices[drawn.T_xy[part_x.index]])[1]
    within = landmarks_within(sides, part_x.index, part_y.index)
    given = (within,) if len(within) else ()
    match = refine(part_x.mesh, part_y.mesh, np.asarray(start, np.int32), *given)
    refined = state._replace(match=match)
    if refined.log_odds < sides.settings.sure:
        return refined
    T_xy = drawn.T_xy.copy()
    T_xy[part_x.index] = part_y.index[np.asarray(match.T_xy)]
    after = _state(sides, state.x, state.scale, state.start, drawn.moved, T_xy)
    T_yx = after.T_yx.copy()
    T_yx[part_y.index] = part_x.index[np.asarray(match.T_yx)]
    outside = np.ones(len(T_xy), bool)
    outside[part_x.index] = False
    T_xy[outside] = after.drawn.T_xy[outside]
    return after._replace(T_xy=T_xy, T_yx=T_yx, match=match)


def _result(state: _State, sides: Sides, margin: float) -> Parts:
    certificate = state.match.certificate
    dtype = certificate.gap.dtype
    cost, agreement = state.start.cost, state.start.agreement
    values = {"gap": margin, "region_cost": cost, "person_agreement": agreement}
    values["confidence"] = np.nan
    values = {name: np.asarray(value, dtype) for name, value in values.items()}
    return Parts(
        state.T_xy.astype(np.int32),
        state.T_yx.astype(np.int32),
        *memberships(state.x, sides.y.mesh, state.drawn.moved, sides.sign),
        certificate._replace(**values),
        state.scale * sides.factor,
    )
