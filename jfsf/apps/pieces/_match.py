"""Two meshes of several connected pieces -> the best assignment, and one map of all."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.apps.collections import unlikeness
from jfsf.apps.collections._sketch import sketch
from jfsf.apps.pieces._assign import TIE, assign, candidates, places_apart
from jfsf.apps.pieces._split import LeftOut, Piece, Pieces, pieces_of
from jfsf.initial import Orientation
from jfsf.matching import Settings, basis, confidence, match
from jfsf.types import ArrayLike, Certificate, Match, Mesh


class PiecePair(NamedTuple):
    """A piece of X and the one of Y that it goes to.

    x, y: the pieces, with their vertices' numbers in the whole (`Piece.index`).
    match: of the two alone: its maps count the vertices of the pieces.
    margin: by how much the sum of the costs grows if this pair is forbidden, see
        `jfsf.apps.pieces.Assignment`.
    """

    x: Piece
    y: Piece
    match: Match
    margin: float

    @property
    def confidence(self) -> float:
        """Of the map between both, if they belong together."""
        return float(self.match.certificate.confidence)

    @property
    def tied(self) -> bool:
        """Whether another assignment is as good, so that the places decided."""
        return self.margin < TIE


class MatchedComponents(NamedTuple):
    """Two shapes matched piece to piece.

    T_xy: the vertex of Y for each vertex of X, -1 where a vertex belongs to no piece
        that has a partner. As an index of numpy, -1 is the last vertex: ask first.
    T_yx: the vertex of X for each vertex of Y, likewise.
    pair_x, pair_y: the number in `pairs` for each vertex, -1 likewise.
    pairs: of pieces, the largest piece of X first.
    alone_x, alone_y: pieces that could be matched, and have no partner.
    left_out_x, left_out_y: what could not be matched.
    """

    T_xy: Int[ArrayLike, " n_x"]
    T_yx: Int[ArrayLike, " n_y"]
    pair_x: Int[ArrayLike, " n_x"]
    pair_y: Int[ArrayLike, " n_y"]
    pairs: tuple[PiecePair, ...]
    alone_x: tuple[Piece, ...]
    alone_y: tuple[Piece, ...]
    left_out_x: tuple[LeftOut, ...]
    left_out_y: tuple[LeftOut, ...]


def match_components(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    orientation: Orientation = "preserve",
    min_share: float = 0.01,
    nearest: int = 3,
    settings: Settings = Settings(),
    cache: bool = True,
    progress: Callable[[str], object] | None = None,
) -> MatchedComponents:
    """Match two shapes of several connected pieces, piece to piece.

    Pairs of pieces are matched by `match`, each scaled to area 1 on its own. The
    assignment of the pieces minimises the sum of `cost`, so pieces need not be in the
    same order or place. Where assignments are as good, as of equal pieces, the one
    whose pieces lie more alike is taken, and `PiecePair.tied` says so: axes of both
    shapes should agree then.

    Args:
        mesh_x, mesh_y: any number of pieces, with faces. `weld` joins pieces that seams
            of equal points have split.
        orientation, settings, cache, progress: as `match`, for each pair of pieces.
            Without the cache a spectrum is computed again for each pair of its piece.
        min_share: of the area of a shape; smaller pieces are left out, and so are those
            of fewer than `Settings.min_vertices` vertices.
        nearest: each piece of the shape that has fewer is matched with so many, those
            that it is most like by the spectra alone
            (`jfsf.apps.collections.unlikeness`). All pairs are matched if there are no
            more than `nearest` squared.

    Returns:
        Maps both ways between all vertices, the pairs of pieces with their matches, and
        what has no partner. As many pairs as the shape with fewer pieces has; how good
        each is `PiecePair.confidence` says.

    Raises:
        MeshError: bad values, no faces, or no piece that can be matched.
        ValueError: min_share, nearest, or another word for orientation.
    """
    if nearest < 1:
        raise ValueError(f"match_components: nearest is {nearest}; give 1 or more")
    x, y = (
        pieces_of(mesh, min_share=min_share, name=name, settings=settings)
        for name, mesh in (("mesh_x", mesh_x), ("mesh_y", mesh_y))
    )
    say = progress or (lambda stage: None)
    apart = places_apart(*([piece.place for piece in side.kept] for side in (x, y)))
    sizes, options = apart.shape, {"settings": settings, "cache": cache}
    chosen = np.ones(sizes, bool)
    if chosen.size > nearest**2:
        say("spectra of the pieces")
        rows = [
            sketch(basis(piece.mesh, **options)).signature
            for piece in (*x.kept, *y.kept)
        ]
        unlike = unlikeness(rows)[: sizes[0], sizes[0] :]
        chosen = candidates(unlike, apart, nearest=nearest)
    costs, found = np.full(sizes, np.inf), {}
    pairs = [(int(i), int(j)) for i, j in np.argwhere(chosen)]
    for number, (i, j) in enumerate(pairs, 1):
        say(f"piece {i} of X, {j} of Y: pair {number} of {len(pairs)}")
        both = x.kept[i].mesh, y.kept[j].mesh
        found[i, j] = match(*both, orientation=orientation, **options)
        costs[i, j] = cost(found[i, j].certificate)
    best = assign(costs, apart)
    return _joined(
        (len(mesh_x.vertices), len(mesh_y.vertices)),
        (x, y),
        tuple(
            PiecePair(x.kept[i], y.kept[j], found[i, j], float(margin))
            for i, j, margin in zip(*best, strict=True)
        ),
    )


def cost(certificate: Certificate) -> float:
    """How little two pieces belong together, in [0, 2], from the map between them.

    1 minus the confidence, plus the `spectrum_gap`, 1 at most. What is unknown counts
    1. The confidence is that of the map alone: other maps of the same two pieces that
    fit as well, as of a sphere, do not speak against these pieces. The mirror image
    does, as of a left hand and a right one. The energy is left out: of spheres with
    other vertices it is anything from 0.2 to 0.8.

    Two embedded bodies of one person have gaps of 0.03 to 0.10, of two persons 0.12 to
    0.22, all with confidences above 0.9.
    """
    likely = confidence(
        certificate.log_odds,
        mirrored=certificate.mirrored,
        spectrum_gap=certificate.spectrum_gap,
    )
    misfit = min(float(np.nan_to_num(certificate.spectrum_gap, nan=1.0)), 1.0)
    return 1 - float(np.nan_to_num(likely)) + misfit


def _joined(
    sizes: tuple[int, int],
    sides: tuple[Pieces, Pieces],
    pairs: tuple[PiecePair, ...],
) -> MatchedComponents:
    """The maps of the pieces as maps between all vertices."""
    T_xy, T_yx, pair_x, pair_y = (np.full(n, -1, np.int32) for n in (*sizes, *sizes))
    for number, (x, y, matched, _) in enumerate(pairs):
        T_xy[x.index] = np.asarray(y.index)[np.asarray(matched.T_xy)]
        T_yx[y.index] = np.asarray(x.index)[np.asarray(matched.T_yx)]
        pair_x[x.index] = pair_y[y.index] = number
    alone_x, alone_y = (
        tuple(piece for piece in side.kept if taken[piece.index[0]] < 0)
        for side, taken in zip(sides, (pair_x, pair_y), strict=True)
    )
    return MatchedComponents(
        T_xy,
        T_yx,
        pair_x,
        pair_y,
        pairs,
        alone_x,
        alone_y,
        sides[0].left_out,
        sides[1].left_out,
    )
