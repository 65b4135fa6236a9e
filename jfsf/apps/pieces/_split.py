"""Mesh -> its connected pieces: those that can be matched, and what is left out."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.matching import Settings, check_matchable
from jfsf.mesh import MeshError, surface_area, validate, vertex_areas, without_strays
from jfsf.mesh._edit import split_components
from jfsf.mesh._values import checked_mesh
from jfsf.types import ArrayLike, Mesh


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


class Pieces(NamedTuple):
    """The pieces of a mesh.

    kept: those that can be matched, the largest area first.
    left_out: the others, by reason.
    """

    kept: tuple[Piece, ...]
    left_out: tuple[LeftOut, ...]


def pieces_of(
    mesh: Mesh,
    *,
    min_share: float = 0.01,
    name: str = "mesh",
    settings: Settings = Settings(),
) -> Pieces:
    """The connected pieces of a mesh, those that can be matched and the others.

    Args:
        mesh: of any number of pieces, with faces. Vertices without a face are left out.
        min_share: of the area; smaller pieces are left out.
        name: opens the message of an error.
        settings: say how many vertices a piece needs (`Settings.min_vertices`).

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
            f"{name}: has no faces, so its pieces are not known; triangulate it, or "
            "match it as one shape"
        )
    whole, kept = surface_area(mesh), []
    lost: dict[str, LeftOut] = {}

    def leave(why: str, pieces: int, vertices: int, share: float):
        _, p, v, s = lost.get(why, LeftOut(why, 0, 0, 0.0))
        lost[why] = LeftOut(why, p + pieces, v + vertices, s + share)

    parts = split_components(mesh)
    for part, index in parts:
        share = surface_area(part) / whole
        if why := _unfit(part, share, min_share, settings):
            leave(why, 1, len(index), share)
            continue
        weight = vertex_areas(*part)
        place = weight @ np.asarray(part.vertices) / weight.sum()
        kept.append(Piece(part, index, share, place))
    strays = len(mesh.vertices) - sum(len(index) for _, index in parts)
    if strays:
        leave("without a face", 0, strays, 0.0)
    if not kept:
        reasons = "; ".join(f"{out.pieces} {out.why}" for out in lost.values())
        raise MeshError(
            f"{name}: none of its {len(parts)} pieces can be matched: {reasons}"
        )
    kept.sort(key=lambda piece: -piece.share)  # stable: equal ones stay in order
    return Pieces(tuple(kept), tuple(lost.values()))


def _unfit(part: Mesh, share: float, min_share: float, settings: Settings) -> str:
    """Why a piece is not matched; "" if it is."""
    if len(part.vertices) < settings.min_vertices:
        return f"of fewer than {settings.min_vertices} vertices"
    if share < min_share:
        return f"of less than {min_share:.4g} of the area"
    try:
        check_matchable(part, name="", settings=settings)
    except MeshError as error:
        return f"that cannot be matched ({str(error).removeprefix(': ')})"
    return ""
