"""The candidates of the search as maps of points, to look at."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.initial import Candidates, candidates, orientation_sign
from jfsf.initial._search import Orientation
from jfsf.matching import Settings, basis, shape_samples
from jfsf.runtime._runners import OneByOne
from jfsf.runtime._sizes import padded_pair
from jfsf.types import ArrayLike, Maps, Mesh

# Rows of a product of embeddings that are in memory at a time.
_ROWS = 1024


class CandidateMap(NamedTuple):
    """A candidate of the first search, before any refinement.

    maps: nearest neighbour in its embeddings, between the vertices asked for.
    energy: departure from an isometry that keeps the descriptors; lower is better.
    orientation: score in [-1, 1]; nan for point clouds without a surface.
    """

    maps: Maps
    energy: float
    orientation: float


def candidate_maps(
    mesh_x: Mesh,
    mesh_y: Mesh,
    at: tuple[Int[ArrayLike, " p"], Int[ArrayLike, " q"]],
    *,
    orientation: Orientation = "preserve",
    settings: Settings = Settings(),
    cache: bool = True,
) -> list[CandidateMap]:
    """The maps that `match` chooses from before it refines the best, best first.

    They are those of the first search, without landmarks, descriptors and further
    starts.

    Args:
        mesh_x, mesh_y, orientation, settings, cache: as `jfsf.match`.
        at: vertices of X and of Y between which the maps are.

    Returns:
        Candidates that differ; their maps count the vertices in `at`.

    Raises:
        MeshError, ValueError: as `jfsf.match`.
    """
    meshes = {"mesh_x": mesh_x, "mesh_y": mesh_y}
    options = {"settings": settings, "cache": cache}
    pair = padded_pair(*(basis(m, name=name, **options) for name, m in meshes.items()))
    # A cloud without a surface has no faces but padding.
    if not all(np.asarray(spec.faces).any() for spec in pair):
        orientation = "any"
    runner = OneByOne(keep=cache)
    inputs = [(spec, None, None, False) for spec in pair]
    # By the program of `match`.
    x, y = runner.map("features", partial(shape_samples, settings=settings), inputs)
    inputs = x.search, y.search, orientation_sign(orientation), False
    stage = partial(_candidates, settings=settings.search)
    (best,) = runner.map("search", stage, [inputs])
    evecs_x, evecs_y = (
        np.asarray(spec.evecs)[np.asarray(rows)]
        for spec, rows in zip(pair, at, strict=True)
    )
    return maps_of(best, evecs_x, evecs_y)


def maps_of(
    best: Candidates,
    evecs_x: Float[np.ndarray, "p k"],
    evecs_y: Float[np.ndarray, "q k"],
) -> list[CandidateMap]:
    """The candidates that are no copies of better ones, with maps between points.

    Args:
        best: of the search.
        evecs_x, evecs_y: eigenfunctions at the points of each shape.
    """
    made = []
    fields = map(np.asarray, (best.C_yx, best.energy, best.orientation))
    for C_yx, energy, score in zip(*fields, strict=True):
        if np.isfinite(energy):  # inf: a copy of a better one
            k_x, k_y = C_yx.shape
            # The direct space, as in the search.
            x, y = evecs_x[:, :k_x], evecs_y[:, :k_y] @ C_yx.T
            maps = Maps(_nearest(x, y), _nearest(y, x))
            made.append(CandidateMap(maps, float(energy), float(score)))
    return made


def _candidates(x, y, sign, self_map, *, settings):
    return candidates(x, y, sign, self_map, settings=settings)


def _nearest(points: Float[np.ndarray, "p k"], others: Float[np.ndarray, "q k"]) -> Any:
    """For each point the nearest of the others, some points at a time."""
    half = (others**2).sum(1) / 2
    parts = np.split(points, np.arange(_ROWS, len(points), _ROWS))
    near = [(part @ others.T - half).argmax(1) for part in parts]
    return np.concatenate(near).astype(np.int32)
