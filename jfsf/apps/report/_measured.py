"""Figures of a map for the page: means for a table, and a number for each vertex."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.evaluate import auc, bijectivity, error_curve, evaluate, geodesic_error
from jfsf.matching._vertices import WITHIN
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import rms_size, vertex_areas
from jfsf.types import ArrayLike, Match, Mesh

SOURCES = 500  # geodesics are measured from about so many vertices,
FEWER_ABOVE = 20_000  # and from fewer in shapes of more vertices: each takes longer
MOST = 100_000  # vertices of a shape; geodesics on larger ones take minutes
_AMONG = 4
LIMITS = (0.02, 0.05, 0.1)  # of the error, for the table


class Measured(NamedTuple):
    """Figures of a map; distances are geodesic, over sqrt(area).

    rows: name, value as text, and what it means.
    truth_rows: rows of figures against the ground truth; empty without one.
    back: (n_x,) distance from x to T_yx[T_xy[x]], the mean of those measured nearby. Of
        parts nan where a vertex is not matched. None for large shapes.
    error: (n_x,) error, the mean of those measured nearby; None without ground truth.
    errors: (p,) at the points of the ground truth that were measured.
    doubt: (n_x,) 1 minus the confidence of each vertex; None where it is not known.
    """

    rows: list[tuple[str, str, str]]
    truth_rows: list[tuple[str, str, str]]
    back: Float[np.ndarray, " n_x"] | None
    error: Float[np.ndarray, " n_x"] | None
    errors: Float[np.ndarray, " p"] | None
    doubt: Float[np.ndarray, " n_x"] | None


def measure(
    mesh_x: Mesh,
    mesh_y: Mesh,
    found: Match,
    truth: tuple[Int[ArrayLike, " p"], Int[ArrayLike, " p"]] | None = None,
) -> Measured:
    """Measure a match, against ground truth if there is one.

    Of parts the distances are those of matched vertices; the others have nan.

    Args:
        mesh_x, mesh_y: the shapes. Of shapes above `MOST` vertices only figures without
            geodesics are measured.
        found: their match.
        truth: vertices of X and of Y that correspond; none is as without one.

    Raises:
        ValueError: as `jfsf.evaluate.geodesic_error`.
    """
    T_xy, T_yx = np.asarray(found.T_xy), np.asarray(found.T_yx)
    n_x, n_y = len(T_xy), len(T_yx)
    only = "coverage_xy", "coverage_yx", "smoothness", "orthogonality"
    figures = evaluate(found, mesh_x, mesh_y, only=only)
    rows = []
    back = None
    small = max(n_x, n_y) <= MOST
    inside_x, inside_y = found.matched_x, found.matched_y
    for name, mesh, inside in (("X", mesh_x, inside_x), ("Y", mesh_y, inside_y)):
        if inside is not None:
            area = vertex_areas(*mesh)
            share = area[np.asarray(inside)].sum() / area.sum()
            meaning = "share of the area that the other has too; the rest is grey"
            rows.append((f"matched of {name}", f"{share:.1%}", meaning))
    if small:
        at_x, at_y = _matched_spread(inside_x, n_x), _matched_spread(inside_y, n_y)
        there = bijectivity(T_xy, T_yx, mesh_x, at=at_x)
        other = bijectivity(T_yx, T_xy, mesh_y, at=at_y)
        back = _only_inside(_everywhere(mesh_x, at_x, there), inside_x)
        meaning = "mean distance from a vertex to its image there and back"
        rows += [
            _distance("bijectivity on X", there.mean(), mesh_x, meaning),
            _distance("bijectivity on Y", other.mean(), mesh_y, meaning),
        ]
    for name, form, meaning in (
        ("coverage_xy", ".1%", "share of Y's area that is hit"),
        ("coverage_yx", ".1%", "share of X's area that is hit"),
        ("smoothness", ".2f", "mean Dirichlet energy; less is smoother"),
        ("orthogonality", ".2f", "|C^T C - I|; 0 keeps areas"),
    ):
        value = f"{getattr(figures, name):{form}}"
        rows.append((name.replace("_", " "), value, meaning))
    likely = doubt = None
    if found.confidence_x is not None and np.isfinite(found.confidence_x).all():
        likely = np.asarray(found.confidence_x, float)
        doubt = 1 - likely
        meaning = f"share of X within {WITHIN} of its partner, by the confidence"
        rows.append(("vertices expected right", f"{likely.mean():.1%}", meaning))
    radius, area = found.radius_x, surface_area(mesh_y)
    if radius is not None and area and np.isfinite(radius).all():
        middle, most = np.quantile(np.asarray(radius) * np.sqrt(area), (0.5, 0.95))
        value = f"{middle:.3g}, 95 %: {most:.3g}"
        meaning = "within this of their partners with 90 %, in the unit of Y's file"
        rows.append(("half of the vertices", value, meaning))
    at_x, at_y = (np.asarray(side) for side in truth or ([], []))
    if at_x.shape != at_y.shape:
        raise ValueError(
            f"measure: truth has vertices {at_x.shape} of X and {at_y.shape} of Y; "
            "give (p,) of each"
        )
    if len(at_x) == 0 or not small:
        return Measured(rows, [], back, None, None, doubt)
    some = _spread(len(at_x), n_y)
    errors = geodesic_error(T_xy, mesh_y, at_x[some], at_y[some])
    shares = error_curve(errors, LIMITS)
    truth_rows = [
        _distance(f"{name} error", value, mesh_y, meaning)
        for name, value, meaning in (
            ("mean", errors.mean(), "geodesic distance / sqrt(area of Y)"),
            ("median", np.median(errors), ""),
            ("largest", errors.max(), ""),
        )
    ]
    truth_rows += [
        ("AUC to 0.25", f"{auc(errors):.3f}", "area under the curve; 1 is perfect"),
        *(
            (f"within {limit}", f"{share:.1%}", "share of the points")
            for limit, share in zip(LIMITS, shares, strict=True)
        ),
        ("points measured", f"{len(some)} of {len(at_x)}", ""),
    ]
    if likely is not None:
        sure = likely[at_x[some]]
        meaning = f"within {WITHIN}, by the confidence"
        truth_rows.append(("expected", f"{sure.mean():.1%}", meaning))
    error = _only_inside(_everywhere(mesh_x, at_x[some], errors), inside_x)
    return Measured(rows, truth_rows, back, error, errors, doubt)


def _distance(
    name: str, value: float, mesh: Mesh, meaning: str
) -> tuple[str, str, str]:
    """The row of a distance over sqrt(area), with what it is in other units."""
    if len(mesh.faces):
        away = float(value) * float(np.sqrt(surface_area(mesh)))
        of_size = away / rms_size(mesh)
        units = f"{away:.3g} in its unit, {of_size:.2%} of its rms size"
        meaning = f"{meaning}; {units}" if meaning else units
    return name, f"{value:.4f}", meaning


def _spread(n: int, vertices: int) -> np.ndarray:
    """Of n points those to measure at, on a shape of so many vertices."""
    sources = int(SOURCES * min(1, FEWER_ABOVE / vertices))
    return np.arange(0, n, -(-n // sources) or 1)


def _matched_spread(inside, n: int) -> np.ndarray:
    """Of n vertices, of which those inside count, those to measure at."""
    if inside is None or not np.any(inside):
        return _spread(n, n)
    at = np.flatnonzero(inside)
    return at[_spread(len(at), n)]


def _only_inside(values: np.ndarray, inside) -> np.ndarray:
    return values if inside is None else np.where(inside, values, np.nan)


def _everywhere(mesh: Mesh, at: np.ndarray, values: np.ndarray) -> Any:
    """At each vertex the mean of the nearest ones that have a value."""
    points, values = np.asarray(mesh.vertices), np.asarray(values)
    near = KDTree(points[at]).query(points, k=min(_AMONG, len(at)))[1]
    return values[near.reshape(len(points), -1)].mean(1)
