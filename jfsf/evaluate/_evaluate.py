"""All figures of one map between two meshes, by the metrics of this package."""

from collections.abc import Callable, Collection
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jfsf.evaluate._functional_metrics import orthogonality, zoomout_energy
from jfsf.evaluate._map_metrics import (
    bijectivity,
    coverage,
    geodesic_error,
    smoothness,
)
from jfsf.geometry._geodesics import Progress
from jfsf.spectral._laplacian import operators
from jfsf.types import ArrayLike, Mesh


class Figures(NamedTuple):
    """The figures of a map: Python floats, nan if a figure was not measured.

    Distances are geodesic and relative to sqrt(area of the shape they are measured on).

    error: (p,) float64, one for each point of the ground truth; see `geodesic_error`.
        Measured on Y. (0,) without ground truth.
    error_mean: mean of `error` over the points whose error is not nan.
    error_median: median of `error` over the points whose error is not nan.
    error_max: largest `error` of the points whose error is not nan.
    error_left_out: number of points whose vertex of Y belongs to no face; their error
        is nan.
    bijectivity_x: mean distance on X from x to T_yx[T_xy[x]]; see `bijectivity`.
        Vertices that belong to no face are left out.
    bijectivity_y: mean distance on Y from y to T_xy[T_yx[y]]; see `bijectivity`.
        Vertices that belong to no face are left out.
    coverage_xy: share of Y's area that T_xy hits, in [0, 1].
    coverage_yx: share of X's area that T_yx hits, in [0, 1].
    smoothness: mean Dirichlet energy on X of Y's coordinates pulled back by T_xy.
    orthogonality: |C^T C - I|_2 of C_yx.
    zoomout_energy: sum over k of |C_k^T C_k - I|_F / k of C_yx.
    """

    error: np.ndarray = np.zeros(0)
    error_mean: float = np.nan
    error_median: float = np.nan
    error_max: float = np.nan
    error_left_out: float = np.nan
    bijectivity_x: float = np.nan
    bijectivity_y: float = np.nan
    coverage_xy: float = np.nan
    coverage_yx: float = np.nan
    smoothness: float = np.nan
    orthogonality: float = np.nan
    zoomout_energy: float = np.nan


MEASURED = tuple(name for name in Figures._fields if not name.startswith("error_"))
"""The figures that can be asked for; the others are summaries of "error"."""


def evaluate(
    maps: Any,
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    every: int = 1,
    exact: bool = False,
    only: Collection[str] = MEASURED,
    operators_x: tuple[Any, ArrayLike] | None = None,
    operators_y: tuple[Any, ArrayLike] | None = None,
    progress: Callable[[str, int, int], object] | None = None,
) -> Figures:
    """Measure a map from X to Y: error, bijectivity, coverage, smoothness.

    Args:
        maps: a record with T_xy, the vertex of Y for each vertex of X, such as `Maps`
            or `Match`. If it has T_yx, the other way, or C_yx, the functional map, the
            figures of these are measured too.
        mesh_x, mesh_y: the shapes, in any units; point clouds have no faces.
        truth: (gt_x, gt_y), (p,) vertices each, from 0: point i of the ground truth is
            gt_x[i] on X and gt_y[i] on Y.
        every: measure the error at every Nth point of `truth` and the bijectivity at
            every Nth vertex, from 0 on.
        exact: exact geodesics, as for `jfsf.geometry.geodesics`.
        only: the figures to measure, of `MEASURED`; geodesics take nearly all the time.
        operators_x, operators_y: (stiffness, mass) of the meshes, as `operators`
            returns them, for callers that measure several maps; the mass is in any
            unit.
        progress: called with the name of the figure, the number of geodesic sources
            done, and their total number.

    Returns:
        The figures; nan for those that are not in `only` or that lack their input.

    Raises:
        ValueError: `every` is below 1, `only` holds an unknown name, all points of the
            ground truth are left out, or as the metrics.
    """
    if every < 1:
        raise ValueError(f"evaluate: every is {every}, it must be 1 or more")
    if unknown := set(only) - set(MEASURED):
        raise ValueError(
            f"evaluate: only holds {sorted(unknown)}, the figures are {list(MEASURED)}"
        )
    T_xy = np.asarray(maps.T_xy)
    T_yx, C_yx = (getattr(maps, name, None) for name in ("T_yx", "C_yx"))
    wanted = set(only)
    if T_yx is None:
        wanted -= {"bijectivity_x", "bijectivity_y", "coverage_yx"}
    else:
        T_yx = np.asarray(T_yx)
    if C_yx is None:
        wanted -= {"orthogonality", "zoomout_energy"}

    def report(name: str) -> Progress | None:
        return None if progress is None else partial(progress, name)

    figures: dict[str, Any] = {}
    if truth is not None and "error" in wanted:
        if len(truth) != 2:
            raise ValueError(
                f"evaluate: truth has {len(truth)} rows; give two arrays (p,), of "
                "vertices of X and of Y (pairs (p, 2) transposed)"
            )
        points = (np.asarray(side)[::every] for side in truth)
        error = geodesic_error(
            T_xy, mesh_y, *points, exact=exact, progress=report("error")
        )
        figures["error"] = error
        measured = error[~np.isnan(error)]
        if len(measured):
            figures["error_mean"] = measured.mean()
            figures["error_median"] = np.median(measured)
            figures["error_max"] = measured.max()
            figures["error_left_out"] = len(error) - len(measured)
        elif len(error):
            raise ValueError(
                f"evaluate: all {len(error)} points of the ground truth are vertices "
                "of Y that belong to no face; give ground truth on its surface"
            )
    for name, forward, back, mesh in (
        ("bijectivity_x", T_xy, T_yx, mesh_x),
        ("bijectivity_y", T_yx, T_xy, mesh_y),
    ):
        if name in wanted:
            at = np.arange(0, len(mesh.vertices), every)
            away = bijectivity(
                forward, back, mesh, at=at, exact=exact, progress=report(name)
            )
            measured = away[~np.isnan(away)]
            figures[name] = measured.mean() if len(measured) else np.nan
    if "coverage_xy" in wanted:
        _, mass_y = operators_y or operators(mesh_y)
        figures["coverage_xy"] = coverage(T_xy, mass_y)
    if wanted & {"coverage_yx", "smoothness"}:
        stiffness_x, mass_x = operators_x or operators(mesh_x)
        if "coverage_yx" in wanted:
            figures["coverage_yx"] = coverage(T_yx, mass_x)
        if "smoothness" in wanted:
            figures["smoothness"] = smoothness(T_xy, mesh_y.vertices, stiffness_x)
    if C_yx is not None and "orthogonality" in wanted:
        figures["orthogonality"] = orthogonality(C_yx)
    if C_yx is not None and "zoomout_energy" in wanted:
        figures["zoomout_energy"] = zoomout_energy(C_yx)
    error = figures.pop("error", np.zeros(0))
    return Figures(error, **{name: float(value) for name, value in figures.items()})
