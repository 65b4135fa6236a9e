"""Two shapes of which one is a part of the other, or that overlap. Host side.

A cut changes all eigenfunctions, but where the region that both share is known, and cut
out of both, the shapes are whole again: the usual refinement then is as accurate as for
whole shapes. So the work is to find that region.

1. Assign a few samples by what a cut leaves (`_beam`): several assignments.
2. Bend X onto Y by each (`_region`), and rank them by evidence (`_evidence`).
3. Cut both shapes to the region, refine the map between the cuts, bend again: twice for
   the best, once for its rivals.

`PartSettings` holds the numbers of all of it.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.mesh import boundary_edges, orient, surface_area
from jfsf.parts._beam import assign
from jfsf.parts._evidence import curvatures, evidence
from jfsf.parts._region import (
    Bent,
    Target,
    bend_onto,
    covered_by,
    cut,
    dense_map,
    target,
)
from jfsf.parts._settings import PartSettings
from jfsf.parts._shape import PartSamples, part_samples
from jfsf.types import Certificate, Mesh

# (part of X, part of Y, T_xy) -> a match of these.
Refine = Callable[[Mesh, Mesh, np.ndarray], Any]


class Parts(NamedTuple):
    """Maps between shapes that share a region.

    T_xy, T_yx: of all vertices; outside of the region the nearest after bending.
    matched_x, matched_y: whether a vertex is in the region.
    certificate: of the map between the regions.
    scale: factor that brings X to the size of Y.
    """

    T_xy: np.ndarray
    T_yx: np.ndarray
    matched_x: np.ndarray
    matched_y: np.ndarray
    certificate: Certificate
    scale: float


class _Sides(NamedTuple):
    """Both shapes in the unit of Y, and what is read of them once.

    curved_x: `curvatures` by step of the scale, filled when they are needed.
    """

    x: PartSamples
    y: PartSamples
    onto: Target
    curved_x: dict[int, np.ndarray]
    curved_y: np.ndarray
    sign: int
    settings: PartSettings


class _State(NamedTuple):
    """A map on the way; `score` is the weighted evidence, small is good."""

    bent: Bent
    scale: float
    score: float
    match: Any = None
    T_xy: Any = None
    T_yx: Any = None


def match_parts(
    mesh_x: Mesh,
    mesh_y: Mesh,
    refine: Refine,
    sign: int = 1,
    *,
    settings: PartSettings = PartSettings(),
) -> Parts:
    """Find the region that two shapes share, and the maps.

    Args:
        mesh_x, mesh_y: one connected piece each, with faces, in one unit: bodies may
            differ in size by a factor of 1.57 either way, see `PartSettings.scales`.
        refine: makes a match of two meshes from a map between their vertices.
        sign: 1 for a map that keeps left and right, -1 for its mirror image, 0 for the
            better one.
        settings: the numbers of the search.

    Raises:
        ValueError: no region of enough vertices was found.
    """
    # An open shape is bent onto a closed one, and of two open ones the smaller, so a
    # swap changes nothing.
    if _openness(mesh_x) < _openness(mesh_y):
        return _swapped(match_parts(mesh_y, mesh_x, refine, sign, settings=settings))
    states = []
    for way in (1, -1) if sign == 0 else (sign,):
        sides = _sides(mesh_x, mesh_y, way, settings=settings)
        states += [(state, sides) for state in _candidates(sides)]
    states.sort(key=lambda pair: pair[0].score)
    best = states[0][0].score
    refined = []
    for state, sides in states[: settings.refined]:
        if state.score < best + settings.max_score_difference:
            better = _refined(state, sides, refine)
            refined += [] if better is None else [(better, sides)]
    if not refined:
        raise ValueError(
            f"match: partial=True found no region of {settings.min_vertices} vertices "
            "that both shapes share; finer meshes, or one unit for both, may help"
        )
    refined.sort(key=lambda pair: pair[0].score)
    state, sides = refined[0]
    rivals = refined[1:] + states[settings.refined :]
    others = [rival.score for rival, _ in rivals]
    margin = min(others, default=np.inf) - state.score
    for _ in range(settings.refinements - 1):
        state = _refined(state, sides, refine) or state
    return _result(state, sides, margin)


def _openness(mesh: Mesh) -> tuple[float, float]:
    return len(boundary_edges(mesh.faces)) > 0, -surface_area(mesh)


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
        parts.matched_y,
        parts.matched_x,
        certificate._replace(**both),
        1 / parts.scale,
    )


def _sides(mesh_x: Mesh, mesh_y: Mesh, sign: int, *, settings: PartSettings) -> _Sides:
    unit = np.sqrt(surface_area(mesh_y))

    def scaled(mesh):
        wound = orient(mesh)
        return Mesh(np.asarray(wound.vertices, float) / unit, np.asarray(wound.faces))

    x = part_samples(scaled(mesh_x), settings.samples_of_part, settings=settings)
    y = part_samples(scaled(mesh_y), settings.samples_of_whole, settings=settings)
    onto, curved_y = target(y.mesh, settings), curvatures(y.mesh, settings=settings)
    return _Sides(x, y, onto, {}, curved_y, sign, settings)


def _curved_x(sides: _Sides, scale: float) -> np.ndarray:
    settings = sides.settings
    step = round(float(np.log(scale)) / settings.curvature_scale_step)
    if step not in sides.curved_x:
        near = float(np.exp(step * settings.curvature_scale_step))
        sides.curved_x[step] = curvatures(sides.x.mesh, near, settings=settings)
    return sides.curved_x[step]


def _candidates(sides: _Sides) -> list[_State]:
    x, y, settings = sides.x, sides.y, sides.settings
    assigned = assign(x, y, orientation=sides.sign, settings=settings)
    states, rounds = [], settings.first_bend_rounds
    for partner, scale in zip(assigned.partner, assigned.scale, strict=True):
        T_xy = dense_map(x, y, assigned.which, partner, scale, settings=settings)
        states.append(_bent(sides, T_xy, float(scale), rounds))
    states.sort(key=lambda state: state.score)
    again = [_bent(sides, s.bent.T_xy, s.scale) for s in states[: settings.bent_twice]]
    return again + states[settings.bent_twice :]


def _bent(sides: _Sides, T_xy, scale: float, rounds: int | None = None) -> _State:
    """Bend X, score it, and correct the scale."""
    mesh = _scaled(sides.x.mesh, scale)
    bent = bend_onto(mesh, sides.onto, T_xy, sides.sign, rounds=rounds)
    settings, curved_x = sides.settings, _curved_x(sides, scale)
    figures, ratio = evidence(
        *(sides.x, sides.y, curved_x, sides.curved_y, bent, scale), settings=settings
    )
    *weights, covered_weight = settings.weights
    score = sum(w * np.log(f + 1e-4) for w, f in zip(weights, figures, strict=True))
    mass = sides.x.mass
    covered = max(mass[bent.matched_x].sum() / mass.sum(), 1e-3)
    score -= covered_weight * np.log(covered)
    corrected = scale * float(np.clip(ratio, *settings.scale_correction))
    return _State(bent, corrected, float(score))


def _refined(state: _State, sides: _Sides, refine: Refine) -> _State | None:
    """Cut both shapes to the region, refine the map between the cuts, bend again."""
    x, y = _scaled(sides.x.mesh, state.scale), sides.y.mesh
    near, inside = covered_by(state.bent, x, sides.onto, sides.sign)
    part_x, part_y = cut(x, state.bent.matched_x), cut(y, inside)
    if min(len(part_x.index), len(part_y.index)) < sides.settings.min_vertices:
        return None
    # A partner outside of the cut gives way to the nearest inside.
    tree = KDTree(part_y.mesh.vertices)
    start = tree.query(y.vertices[state.bent.T_xy[part_x.index]])[1]
    match = refine(part_x.mesh, part_y.mesh, np.asarray(start, np.int32))
    T_xy = state.bent.T_xy.copy()
    T_xy[part_x.index] = part_y.index[np.asarray(match.T_xy)]
    after = _bent(sides, T_xy, state.scale)
    T_yx, _ = covered_by(after.bent, x, sides.onto, sides.sign)
    T_yx[part_y.index] = part_x.index[np.asarray(match.T_yx)]
    outside = np.ones(len(T_xy), bool)
    outside[part_x.index] = False
    T_xy[outside] = after.bent.T_xy[outside]
    return after._replace(match=match, T_xy=T_xy, T_yx=T_yx)


def _result(state: _State, sides: _Sides, margin: float) -> Parts:
    x = _scaled(sides.x.mesh, state.scale)
    _, inside = covered_by(state.bent, x, sides.onto, sides.sign)
    certificate = state.match.certificate
    gap = np.asarray(np.expm1(max(margin, 0)), certificate.gap.dtype)
    # It is fitted to whole shapes.
    unknown = np.full_like(np.asarray(certificate.confidence), np.nan)
    certificate = certificate._replace(confidence=unknown, gap=gap)
    return Parts(
        state.T_xy.astype(np.int32),
        state.T_yx.astype(np.int32),
        state.bent.matched_x,
        inside,
        certificate,
        state.scale,
    )


def _scaled(mesh: Mesh, scale: float) -> Mesh:
    return Mesh(mesh.vertices * scale, mesh.faces)
