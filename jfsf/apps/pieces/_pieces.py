"""The connected pieces of a mesh, and which pieces of two shapes belong together.

Costs c_ij come from the maps of pairs of pieces. The best assignment minimises their
sum (the Hungarian method, by scipy). Where other assignments are as good, the places of
the pieces decide.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from jfsf.matching import Settings, check_matchable
from jfsf.mesh import MeshError, surface_area, validate, without_strays
from jfsf.mesh._edit import split_components
from jfsf.mesh._geometry import vertex_areas
from jfsf.mesh._values import checked_mesh
from jfsf.types import ArrayLike, Mesh

# Sums of costs that differ by less are a tie. Exchanging two of three embedded bodies,
# each in two poses, costs 0.26.
TIE = 0.1
# More than any pair costs: two pieces that were not matched are no pair.
_NEVER = 1e3
# What places count beside signatures. Those of one body in two poses differ by 0.007 to
# 0.012, of two bodies by 0.011 to 0.020.
_PLACES = 0.002


class Piece(NamedTuple):
    """A connected piece of a mesh.

    mesh: the piece alone, in the coordinates of the whole.
    index: the vertex of the whole for each of its vertices, ascending.
    share: of the area of the whole.
    place: centroid of its surface.
    """

    mesh: Mesh
    index: Int[ArrayLike, " n"]
    share: float
    place: Float[ArrayLike, " 3"]


class LeftOut(NamedTuple):
    """Pieces that cannot be matched, for one reason.

    why: the reason, in words.
    pieces, vertices: how many; `pieces` is 0 for vertices without a face.
    share: of the area of the whole.
    """

    why: str
    pieces: int
    vertices: int
    share: float


def pieces_of(
    mesh: Mesh,
    *,
    min_share: float = 0.01,
    name: str = "mesh",
    settings: Settings = Settings(),
) -> tuple[tuple[Piece, ...], tuple[LeftOut, ...]]:
    """The connected pieces of a mesh, those that can be matched and the others.

    Args:
        mesh: of any number of pieces, with faces. Vertices without a face are left out.
        min_share: of the area; smaller pieces are left out.
        name: opens the message of an error.
        settings: say how many vertices a piece needs (`Settings.min_vertices`).

    Returns:
        The pieces that can be matched, the largest area first; and the others, by
        reason.

    Raises:
        MeshError: bad values, no faces, or no piece that can be matched.
        ValueError: min_share is not in [0, 1).
    """
    if not 0 <= min_share < 1:
        raise ValueError(
            f"min_share is {min_share}; give a share of the area, from 0 to below 1"
        )
    mesh = checked_mesh(mesh, name)
    validate(without_strays(mesh).mesh, name=name, components=False)
    if len(mesh.faces) == 0:
        raise MeshError(
            "has no faces, so its pieces are not known",
            "triangulate it, or match it as one shape",
            name,
        )
    whole, parts = surface_area(mesh), split_components(mesh)
    pieces: list[Piece] = []
    left_out: dict[str, LeftOut] = {}

    def leave(why: str, number: int, vertices: int, share: float) -> None:
        so_far = left_out.get(why, LeftOut(why, 0, 0, 0.0))
        left_out[why] = LeftOut(
            why,
            so_far.pieces + number,
            so_far.vertices + vertices,
            so_far.share + share,
        )

    for part, index in parts:
        share = surface_area(part) / whole
        if why := _unfit(part, share, min_share, settings):
            leave(why, 1, len(index), share)
        else:
            weight = vertex_areas(*part)
            place = weight @ np.asarray(part.vertices) / weight.sum()
            pieces.append(Piece(part, index, share, place))
    strays = len(mesh.vertices) - sum(len(index) for _, index in parts)
    if strays:
        leave("without a face", 0, strays, 0.0)
    if not pieces:
        reasons = "; ".join(f"{out.pieces} {out.why}" for out in left_out.values())
        raise MeshError(
            f"none of its {len(parts)} pieces can be matched: {reasons}", name=name
        )
    pieces.sort(key=lambda piece: -piece.share)  # stable: equal ones stay in order
    return tuple(pieces), tuple(left_out.values())


def _unfit(part: Mesh, share: float, min_share: float, settings: Settings) -> str:
    """Why a piece is not matched; "" if it is."""
    if len(part.vertices) < settings.min_vertices:
        return f"of fewer than {settings.min_vertices} vertices"
    if share < min_share:
        return f"of less than {min_share:.4g} of the area"
    try:
        check_matchable(part, name="", settings=settings)
    except MeshError as error:
        return f"that cannot be matched ({error})"
    return ""


def candidates(
    unlike: Float[ArrayLike, "s t"],
    apart: Float[ArrayLike, "s t"],
    *,
    nearest: int = 3,
) -> Bool[np.ndarray, "s t"]:
    """Which pairs are worth a match.

    Each piece of the shape that has fewer with the `nearest` ones that it is most like,
    and the pairs of the assignment that is best by the signatures alone. All pairs, if
    there are no more than `nearest` squared.

    Args:
        unlike: of s pieces of X and t of Y (`jfsf.apps.collections.unlikeness`).
        apart: how far apart their places are, see `places_apart`.
        nearest: 1 or more.
    """
    score = np.asarray(unlike, float) + _PLACES * np.asarray(apart)
    if score.size <= nearest**2:
        return np.ones(score.shape, bool)
    axis = 1 if score.shape[0] <= score.shape[1] else 0
    order = np.argsort(score, axis=axis, kind="stable")
    chosen = np.zeros(score.shape, bool)
    np.put_along_axis(chosen, order.take(range(nearest), axis), True, axis)
    chosen[linear_sum_assignment(score)] = True
    return chosen


def places_apart(
    places_x: Float[ArrayLike, "s 3"], places_y: Float[ArrayLike, "t 3"]
) -> Float[np.ndarray, "s t"]:
    """How far apart the places of pieces are, in [0, 1].

    Each shape's are centred, and divided by their spread. They are not turned: the axes
    of both shapes have to agree for this to mean anything.
    """
    one, two = (_centred(np.asarray(places, float)) for places in (places_x, places_y))
    apart = cdist(one, two)
    return apart / (apart.max() or 1)


def best_assignment(
    cost: Float[ArrayLike, "s t"], apart: Float[ArrayLike, "s t"]
) -> tuple[list[tuple[int, int]], list[float]]:
    """The best assignment of pieces; places decide between those that are as good.

    Args:
        cost: of s pieces of X and t of Y; inf for a pair that was not matched.
        apart: in [0, 1], see `places_apart`. It counts `TIE` / 2 a pair at most.

    Returns:
        Pairs of numbers of the pieces of X and Y, in the order of those of X: as many
        as the smaller number of pieces, fewer if too few were matched. And for each by
        how much the sum of the costs grows if the pair is forbidden: inf if there is no
        other assignment of as many pieces. Below `TIE` another one is as good, and
        places have decided.
    """
    matched = np.isfinite(cost)
    cost = np.where(matched, cost, _NEVER)
    best = np.stack(linear_sum_assignment(cost + TIE / 2 * np.asarray(apart)), 1)
    total = cost[tuple(best.T)].sum()
    pairs = [(i, j) for i, j in best.tolist() if matched[i, j]]
    margins = []
    for pair in pairs:
        without = cost.copy()
        without[pair] = _NEVER
        more = without[linear_sum_assignment(without)].sum() - total
        margins.append(float(more) if more < _NEVER / 2 else np.inf)
    return pairs, margins


def _centred(places):
    places = places - places.mean(axis=0)
    spread = np.sqrt((places**2).sum(axis=1).mean())
    return places / (spread or 1)
