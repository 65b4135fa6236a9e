"""Landmarks of `jfsf collection` beside those that people placed on some shapes.

Two simple methods stand beside the map. The best similarity of the template's landmarks
onto the people's own is no method, as it knows the answer: nothing that only moves,
turns and scales the template has a smaller root mean square error. The iterative
closest points of the two surfaces (`trimesh.registration.icp`) begin in the pose and
size that the map gives, and move and turn the template; its landmarks then go to the
nearest points of the surface.
"""

from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli._collection_jobs import file_of
from jfsf.apps.cli._collection_landmarks import (
    OnShapes,
)
from jfsf.apps.cli._collection_people import ByPeople
from jfsf.apps.cli._print import counted
from jfsf.apps.cli._runs import write_table
from jfsf.types import Mesh

CHECKED = "check.csv"  # for each landmark that people placed
COLUMNS = (
    "specimen",
    "landmark",
    "error",
    "similarity",
    "icp",
    "radius",
    "within",
    "centroid_size",
    "of_size",
)
SIMPLE = {"similarity": "the best similarity", "icp": "iterative closest points"}
SHOWN = 15  # rows of a table on the screen, the worst first


def checked_rows(
    out: Path, found: OnShapes, people: dict[str, ByPeople], shapes, base: str, given
) -> list[dict]:
    """A row for each landmark that people placed on a joined shape.

    Args:
        out: the folder of the results.
        found: the landmarks on all shapes.
        people: where people placed them, on the same meshes.
        shapes: what was kept of each, by name.
        base: name of the template.
        given: names of shapes whose landmarks were given, and do not count.
    """
    from jfsf.apps.morphometrics._procrustes import centroid_size

    own, rows = found.template, []
    for i, name in enumerate(found.specimens):
        if name == base or name in given or name not in people:
            continue
        number, true = people[name].rows, people[name].points
        with np.load(file_of(out, "registered", name)) as file:
            on_shape = file["vertices"]
        left = {
            "error": found.points[i, number] - true,
            "similarity": _similar(own[number], true) - true,
            "icp": _by_icp(shapes[base].mesh, shapes[name].mesh, on_shape, own[number])
            - true,
        }
        size, radius = float(centroid_size(true)), found.radius[i, number]
        length = {what: np.linalg.norm(away, axis=1) for what, away in left.items()}
        for j, at in enumerate(number.tolist()):
            error = length["error"][j]
            rows.append(
                {
                    "specimen": name,
                    "landmark": found.names[at],
                    **{what: lengths[j] for what, lengths in length.items()},
                    "radius": radius[j],
                    "within": float(error <= radius[j]) if radius[j] > 0 else np.nan,
                    "centroid_size": size,
                    "of_size": error / size if size > 0 else np.nan,
                }
            )
    return rows


def _similar(points: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Points moved, turned and scaled to fit others best; nan with fewer than three."""
    from jfsf.apps.morphometrics._procrustes import similarity

    known = np.isfinite(points).all(1)
    if known.sum() < 3:
        return np.full(points.shape, np.nan)
    scale, turn, shift = similarity(points[known], goal[known])
    return scale * points @ turn + shift


def _by_icp(
    template: Mesh, mesh: Mesh, on_shape: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Points of the template on a shape, by iterative closest points."""
    from trimesh.registration import icp, procrustes
    from trimesh.transformations import transform_points

    from jfsf.apps.landmarks._place import nearest
    from jfsf.apps.morphometrics._procrustes import centroid_size

    vertices = np.asarray(template.vertices, float)
    goal = np.asarray(mesh.vertices, float)
    unit = centroid_size(goal) / np.sqrt(len(goal))  # the threshold is in its square
    pose = procrustes(vertices, on_shape / unit, reflection=False, return_cost=False)
    options = {"threshold": 1e-8, "max_iterations": 200}
    # The scale is that of the map.
    options |= {"reflection": False, "scale": False}
    matrix, *_ = icp(vertices, goal / unit, initial=pose, **options)
    return nearest(mesh, unit * transform_points(points, matrix)).points


def write_check(
    out: Path, found: OnShapes, people: dict[str, ByPeople], shapes, base: str, given
) -> tuple[list[Table], list[str]]:
    """Write the errors as check.csv; what to show and to say of them.

    Without people's landmarks the table of an earlier run, which may be of others, is
    removed.

    Args:
        out, found, people, shapes, base, given: as `checked_rows`.
    """
    if not people:
        (out / CHECKED).unlink(missing_ok=True)
        return [], []
    rows = checked_rows(out, found, people, shapes, base, given)
    write_table(out / CHECKED, COLUMNS, rows, missing="NA")
    by = {"shape": _means(rows, "specimen"), "landmark": _means(rows, "landmark")}
    tables = [_table(by[of], of) for of in by if by[of]]
    return tables, _said_of(rows)


def _said_of(rows: list[dict]) -> list[str]:
    """What the errors mean, a sentence a line; it says where the map is no better."""
    known = [row for row in rows if np.isfinite(row["of_size"])]
    if not known:
        return ["no landmark that people placed is on a joined shape and not missing"]
    (whole,) = _means([{**row, "all": "all"} for row in known], "all")
    shapes = len({row["specimen"] for row in known})
    percent = {what: _percent(whole[what]) for what in ("error", "median", *SIMPLE)}
    ratio = [row["error"] / row["radius"] for row in known if row["radius"] > 0]
    times = np.quantile(ratio, 0.9) if ratio else np.nan
    lines = [
        f"{counted(len(known), 'landmark', 'landmarks')} that people placed on "
        f"{counted(shapes, 'shape', 'shapes')}: the map is {percent['error']} of the "
        f"centroid size off in the mean, {percent['median']} in the median; "
        f"{_percent(whole['within'], 0)} of the errors are within the radius, where "
        f"90% are expected; 90% are within {times:.1f} times the radius",
        f"the best similarity of the landmarks themselves leaves "
        f"{percent['similarity']} (nothing that only moves, turns and scales the "
        f"template leaves less in root mean square), iterative closest points leave "
        f"{percent['icp']}",
    ]
    for what, name in SIMPLE.items():
        where = [] if whole["error"] < whole[what] else ["all in the mean"]
        for by, of in (("specimen", "shape"), ("landmark", "landmark")):
            means = _means(known, by)
            found = [own["name"] for own in means if own["error"] >= own[what]]
            if found:
                many = "" if len(found) == 1 else "s"
                where.append(f"the {of}{many} {', '.join(found)}")
        if where:
            lines.append(f"the map is no better than {name} for {'; '.join(where)}")
    if len(lines) == 2:
        lines.append("the map is better than both on each shape and for each landmark")
    return lines


def _mean(values: np.ndarray) -> float:
    """Of those that are known; nan if none is."""
    return float(np.ma.filled(np.ma.masked_invalid(values).mean(), np.nan))


def _percent(share: float, digits: int = 2) -> str:
    return f"{share:.{digits}%}" if np.isfinite(share) else "unknown"


def _means(rows: list[dict], by: str) -> list[dict]:
    """Of the rows with the same name, shares of the centroid size; the worst first."""
    groups: dict[str, list[dict]] = {}
    for row in rows:
        if np.isfinite(row["of_size"]):
            groups.setdefault(row[by], []).append(row)
    found = []
    for name, group in groups.items():
        size = np.array([row["centroid_size"] for row in group])
        column = {what: np.array([row[what] for row in group]) for what in COLUMNS[2:]}
        found.append(
            {
                "name": name,
                "number": len(group),
                "in_unit": column["error"].mean(),
                "error": column["of_size"].mean(),
                "median": np.median(column["of_size"]),
                **{what: _mean(column[what] / size) for what in SIMPLE},
                "within": _mean(column["within"]),
            }
        )
    return sorted(found, key=lambda own: -own["error"])


def _table(groups: list[dict], of: str) -> Table:
    shown = Table(title=f"error of the landmarks that people placed, by {of}")
    shown.add_column(of, overflow="fold")
    titles = (
        "number",
        "mean",
        "of size",
        "median",
        "similarity",
        "ICP",
        "within\nradius",
    )
    for title in titles:
        widest = max(map(len, title.split()))
        shown.add_column(title, justify="right", min_width=widest)
    for own in groups[:SHOWN]:
        of_size = (own[what] for what in ("error", "median", "similarity", "icp"))
        shown.add_row(
            escape(own["name"]),
            str(own["number"]),
            f"{own['in_unit']:.3g}",
            *map(_percent, of_size),
            _percent(own["within"], 0),
        )
    shown.caption = (
        "Mean error in the unit of the files, and over the centroid size of these "
        "landmarks, as are the next three."
    )
    if len(groups) > SHOWN:
        shown.caption += f" The worst {SHOWN} of {len(groups)}."
    return shown
