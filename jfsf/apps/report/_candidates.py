"""The candidates of the search as maps of points, to look at."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.initial import Candidates, Orientation, candidates, orientation_sign
from jfsf.matching import Settings, basis, shape_samples
from jfsf.runtime._runners import OneByOne
from jfsf.runtime._sizes import padded_pair
from jfsf.types import ArrayLike, Maps, Mesh

# Rows of a product of embeddings that are in memory at a time.
_ROWS = 4096


class Considered(NamedTuple):
    """A candidate of the first search, before any refinement.

    maps: nearest neighbour in its embeddings, between the vertices asked for.
    energy: departure from an isometry that keeps the descriptors; lower is better.
    orientation: score in [-1, 1]; nan for point clouds without a surface.
    """

    maps: Maps
    energy: float
    orientation: float


def considered(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    at: tuple[Int[ArrayLike, " p"], Int[ArrayLike, " q"]] | None = None,
    orientation: Orientation = "preserve",
    settings: Settings = Settings(),
    cache: bool = True,
) -> list[Considered]:
    """The maps that `match` chooses from before it refines the best, best first.

    Without landmarks, descriptors and further starts: those of the first search.

    Args:
        mesh_x, mesh_y, orientation, settings, cache: as `jfsf.match`.
        at: vertices of X and of Y between which the maps are; all when absent.

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
    sizes = len(mesh_x.vertices), len(mesh_y.vertices)
    at_x, at_y = at if at is not None else map(np.arange, sizes)
    evecs_x, evecs_y = (
        np.asarray(spec.evecs)[np.asarray(rows)]
        for spec, rows in zip(pair, (at_x, at_y), strict=True)
    )
    return with_maps(best, evecs_x, evecs_y)


def with_maps(
    best: Candidates,
    evecs_x: Float[np.ndarray, "p k"],
    evecs_y: Float[np.ndarray, "q k"],
) -> list[Considered]:
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
            maps = _nearest(evecs_x[:, :k_x], evecs_y[:, :k_y] @ C_yx.T)
            made.append(Considered(maps, float(energy), float(score)))
    return made


def _candidates(x, y, sign, self_map, *, settings):
    return candidates(x, y, sign, self_map, settings=settings)


def _nearest(emb_x: Float[np.ndarray, "p k"], emb_y: Float[np.ndarray, "q k"]) -> Maps:
    """Nearest neighbours both ways, block by block of X."""
    half_x, half_y = (emb_x**2).sum(1) / 2, (emb_y**2).sum(1) / 2
    T_xy: Any = np.zeros(len(emb_x), np.int32)
    T_yx: Any = np.zeros(len(emb_y), np.int32)
    best = np.full(len(emb_y), -np.inf)
    for start in range(0, len(emb_x), _ROWS):
        rows = slice(start, start + _ROWS)
        near = emb_x[rows] @ emb_y.T
        T_xy[rows] = (near - half_y).argmax(1)
        near = near - half_x[rows, None]
        top = near.max(0)
        T_yx = np.where(top > best, near.argmax(0) + start, T_yx).astype(np.int32)
        best = np.maximum(best, top)
    return Maps(T_xy, T_yx)
