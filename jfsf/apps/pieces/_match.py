"""Two meshes of several connected pieces -> one map of all, and its file."""

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf._figures import FIGURES
from jfsf.apps.collections import unlikeness
from jfsf.apps.collections._cycles import sketch
from jfsf.apps.mapfiles import MapFileError
from jfsf.apps.pieces._pieces import (
    TIE,
    LeftOut,
    Piece,
    best_assignment,
    candidates,
    pieces_of,
    places_apart,
)
from jfsf.initial._search import Orientation
from jfsf.matching import Settings, basis, confidence, match
from jfsf.storage._atomic import write_atomically
from jfsf.types import ArrayLike, Certificate, Match, Mesh


class PiecePair(NamedTuple):
    """A piece of X and the one of Y that it goes to.

    x: the piece of X, with its vertices' numbers in the whole (`Piece.index`).
    y: the piece of Y, with its vertices' numbers in the whole.
    match: of the two alone: its maps count the vertices of the pieces.
    margin: by how much the sum of the costs grows if this pair is forbidden; inf if
        there is no other assignment of as many pieces.
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
    T_yx: the vertex of X for each vertex of Y, -1 where a vertex belongs to no piece
        that has a partner.
    pair_x: the number in `pairs` of the pair of each vertex of X, -1 without a partner.
    pair_y: the number in `pairs` of the pair of each vertex of Y, -1 without a partner.
    pairs: the pairs of pieces, the largest piece of X first.
    alone_x: pieces of X that could be matched, but have no partner.
    alone_y: pieces of Y that could be matched, but have no partner.
    left_out_x: pieces of X that could not be matched.
    left_out_y: pieces of Y that could not be matched.
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
    assignment of the pieces minimises the sum of `cost`, so their order and place do
    not matter. If several assignments are equally good, as for equal pieces, the one
    whose pieces lie in the most similar places is taken, and `PiecePair.tied` says so:
    the axes of both shapes should then agree.

    Args:
        mesh_x, mesh_y: meshes of any number of pieces. `weld` joins pieces that seams
            of equal points have split.
        orientation, settings, cache, progress: as `match`, for each pair of pieces.
            Without the cache a spectrum is computed again for each pair of its piece.
        min_share: share of the area of a shape below which a piece is left out; so are
            pieces of fewer than `Settings.min_vertices` vertices.
        nearest: number of pieces, the most similar by their spectra alone
            (`jfsf.apps.collections.unlikeness`), with which each piece of the shape
            with fewer pieces is matched. All pairs are matched if there are at most
            `nearest` squared.

    Returns:
        Maps both ways between all vertices, the pairs of pieces with their matches, and
        what has no partner. There are as many pairs as the shape with fewer pieces has;
        `PiecePair.confidence` says how good each is.

    Raises:
        MeshError: bad values, no faces, or no piece that can be matched.
        ValueError: min_share, nearest, or another word for orientation.
    """
    if nearest < 1:
        raise ValueError(f"match_components: nearest is {nearest}; give 1 or more")
    (x, left_out_x), (y, left_out_y) = (
        pieces_of(mesh, min_share=min_share, name=name, settings=settings)
        for name, mesh in (("mesh_x", mesh_x), ("mesh_y", mesh_y))
    )
    say = progress or (lambda stage: None)
    options = {"settings": settings, "cache": cache}
    apart = places_apart(*([piece.place for piece in side] for side in (x, y)))
    chosen = np.ones(apart.shape, bool)
    if chosen.size > nearest**2:
        say("spectra of the pieces")
        rows = [sketch(basis(p.mesh, **options)).signature for p in (*x, *y)]
        unlike = unlikeness(rows)[: len(x), len(x) :]
        chosen = candidates(unlike, apart, nearest=nearest)
    costs, matches = np.full(apart.shape, np.inf), {}
    numbers = [(int(i), int(j)) for i, j in np.argwhere(chosen)]
    for number, (i, j) in enumerate(numbers, 1):
        say(f"piece {i} of X, {j} of Y: pair {number} of {len(numbers)}")
        matches[i, j] = match(x[i].mesh, y[j].mesh, orientation=orientation, **options)
        costs[i, j] = cost(matches[i, j].certificate)
    best = zip(*best_assignment(costs, apart), strict=True)
    pairs = tuple(PiecePair(x[i], y[j], matches[i, j], m) for (i, j), m in best)
    # The maps of the pieces as maps between all vertices.
    sizes = [len(mesh.vertices) for mesh in (mesh_x, mesh_y)]
    T_xy, T_yx, pair_x, pair_y = (np.full(n, -1, np.int32) for n in (*sizes, *sizes))
    for number, pair in enumerate(pairs):
        on_x, on_y = np.asarray(pair.x.index), np.asarray(pair.y.index)
        T_xy[on_x] = on_y[np.asarray(pair.match.T_xy)]
        T_yx[on_y] = on_x[np.asarray(pair.match.T_yx)]
        pair_x[on_x] = pair_y[on_y] = number
    alone_x, alone_y = (
        tuple(piece for piece in side if taken[piece.index[0]] < 0)
        for side, taken in ((x, pair_x), (y, pair_y))
    )
    return MatchedComponents(
        T_xy,
        T_yx,
        pair_x,
        pair_y,
        pairs,
        alone_x,
        alone_y,
        left_out_x,
        left_out_y,
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


def write_components(
    path: str | Path, matched: MatchedComponents, *, notes: Sequence[str] = ()
) -> None:
    """Write what `match_components` returns as `.npz`.

    The file has T_xy and T_yx (int32, 0-based, -1 for a vertex without a partner),
    pair_x and pair_y (the number of its pair for each vertex, or -1), confidence_x and
    confidence_y, radius_x and radius_y (nan for a vertex without a partner; a radius is
    in sqrt(area) of the partner's piece), and for each pair pair_margin and pair_NAME
    for each figure of the certificate, such as pair_confidence. `jfsf evaluate`,
    `transfer` and `register` read it. It appears complete or not at all.

    Args:
        path: `.npz`.
        matched: the result.
        notes: sentences on how it was made, for `jfsf.apps.mapfiles.read_notes`.

    Raises:
        MapFileError: the suffix is not `.npz`, or a folder that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise MapFileError(f"{path}: pieces are written as .npz, not {path.suffix!r}")
    arrays = {name: getattr(matched, name) for name in matched._fields[:4]}
    for kind, side in product(("confidence", "radius"), "xy"):
        name = f"{kind}_{side}"
        arrays[name] = np.full(len(arrays[f"pair_{side}"]), np.nan)
        for pair in matched.pairs:
            if (known := getattr(pair.match, name)) is not None:
                arrays[name][getattr(pair, side).index] = np.asarray(known)
    arrays["pair_margin"] = np.array([pair.margin for pair in matched.pairs])
    for name in FIGURES:
        figures = [
            np.asarray(getattr(p.match.certificate, name)) for p in matched.pairs
        ]
        arrays[f"pair_{name}"] = np.array(figures)
    if notes:
        arrays["notes"] = np.array(list(notes))
    try:
        write_atomically(path, lambda file: np.savez_compressed(file, **arrays))
    except OSError as error:
        raise MapFileError(
            f"{path}: cannot be written ({error.strerror}); check the folder"
        ) from None
