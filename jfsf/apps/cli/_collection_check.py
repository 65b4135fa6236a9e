"""Landmarks of `jfsf collection` beside those that people placed on some shapes.

Two simple methods stand beside the map. The best similarity of the template's landmarks
onto the people's own is no method, as it knows the answer: nothing that only moves,
turns and scales the template has a smaller root mean square error. The iterative
closest points of the two surfaces (`trimesh.registration.icp`) begin in the pose and
size that the map gives, and move and turn the template; its landmarks then go to the
nearest points of the surface.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli._collection_jobs import file_of
from jfsf.apps.cli._collection_landmarks import (
    OnShapes,
    nearest,
    size_of,
    write_numbers,
)
from jfsf.apps.cli._print import counted
from jfsf.types import Mesh

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


class Placed(NamedTuple):
    """Landmarks that people placed on a shape.

    path: of the file.
    rows: (p,) which landmarks of the template they are.
    points: (p, 3) in the coordinates of the shape's file.
    said: what was left out, a sentence each.
    """

    path: Path
    rows: np.ndarray
    points: np.ndarray
    said: list[str]


def placed_by_people(folder: Path | None, paths, landmarks) -> dict[str, Placed]:
    """The landmark files of a folder that are named as shapes, by these names.

    Args:
        folder: of files in any format of landmarks; others are passed over.
        paths: the file of each shape, by name.
        landmarks: of the template; None if there are none.

    Raises:
        ValueError: no template's landmarks, no folder, no such file, two of one shape,
            a file that cannot be read, landmarks that are not those of the template, or
            far from the shape.
    """
    from jfsf.apps.landmarks import pair_landmarks, read_landmarks
    from jfsf.apps.landmarks._files import SUFFIXES
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.mesh import read

    if folder is None:
        return {}
    if landmarks is None:
        raise ValueError(
            f"{folder}: --check-landmarks needs the same landmarks on the template; "
            "give --template and --landmarks"
        )
    if not folder.is_dir():
        raise ValueError(f"{folder}: is no folder; give one of landmark files")
    found: dict[str, Placed] = {}
    passed = []
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.suffix.lower() not in SUFFIXES:
            continue
        name = path.stem
        if name.lower().endswith(".mrk"):
            name = name[: -len(".mrk")]
        if name not in paths:
            passed.append(path.name)
            continue
        if name in found:
            raise ValueError(f"{path}: is of the same shape as {found[name].path.name}")
        marks = read_landmarks(path)
        try:
            at = on_surface(marks, read(paths[name], finite=False))
            pairs = pair_landmarks(landmarks, marks)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        points = np.asarray(at.points if marks.points is None else marks.points, float)
        alone = [line for line in pairs.said if "without a partner" in line]
        said = [f"{path}: {line}" for line in (*marks.said, *alone)]
        of_template, own = pairs.rows.T
        found[name] = Placed(path, of_template, points[own], said)
    if not found:
        raise ValueError(
            f"{folder}: has no landmark file that is named as a shape, such as "
            f"{next(iter(paths))}.fcsv; it has {', '.join(passed[:5]) or 'none at all'}"
        )
    return found


def checked_rows(
    out: Path, found: OnShapes, people: dict[str, Placed], shapes, graph
) -> list[dict]:
    """A row for each landmark that people placed on a joined shape.

    The template's own do not count: they were given.

    Args:
        out: the folder of the results.
        found: the landmarks on all shapes.
        people: where people placed them.
        shapes: what was kept of each, by name; mirror images mirrored back.
        graph: of these.
    """
    names = list(shapes)
    base = names[graph.paths.template]
    turned = {names[i] for i in graph.mirrored_back}
    own, rows = found.points[found.specimens.index(base)], []
    for i, name in enumerate(found.specimens):
        if name == base or name not in people:
            continue
        number, true = people[name].rows, people[name].points
        true = true * [-1, 1, 1] if name in turned else true
        with np.load(file_of(out, "registered", name)) as file:
            on_shape = file["vertices"]
        left = {
            "error": found.points[i, number] - true,
            "similarity": _similar(own[number], true) - true,
            "icp": _by_icp(shapes[base].mesh, shapes[name].mesh, on_shape, own[number])
            - true,
        }
        size, radius = size_of(true), found.radius[i, number]
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
    from trimesh.registration import procrustes

    known = np.isfinite(points).all(1)
    if known.sum() < 3:
        return np.full(points.shape, np.nan)
    moved = np.full(points.shape, np.nan)
    moved[known] = procrustes(points[known], goal[known], reflection=False)[1]
    return moved


def _by_icp(
    template: Mesh, mesh: Mesh, on_shape: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Points of the template on a shape, by iterative closest points."""
    from trimesh.registration import icp, procrustes
    from trimesh.transformations import transform_points

    vertices = np.asarray(template.vertices, float)
    goal = np.asarray(mesh.vertices, float)
    pose = procrustes(vertices, on_shape, reflection=False, return_cost=False)
    # Where it stops is a cost in the square of the unit.
    unit = size_of(goal) / np.sqrt(len(goal))
    scaled = np.diag([1 / unit] * 3 + [1])
    options = {"threshold": 1e-8, "max_iterations": 200}
    matrix, *_ = icp(
        vertices,
        goal / unit,
        initial=scaled @ pose,
        reflection=False,
        scale=False,
        **options,
    )
    moved = transform_points(np.nan_to_num(points), np.linalg.inv(scaled) @ matrix)
    moved[~np.isfinite(points).all(1)] = np.nan
    return nearest(mesh, moved).on(goal)


def write_check(
    out: Path, found: OnShapes, people: dict[str, Placed], shapes, graph
) -> tuple[list[Table], list[str]]:
    """Write the errors as check.csv; what to show and to say of them.

    Args:
        out, found, people, shapes, graph: as `checked_rows`.
    """
    if not people:
        return [], []
    rows = checked_rows(out, found, people, shapes, graph)
    table = [[row[name] for name in COLUMNS] for row in rows]
    write_numbers(out / "check.csv", COLUMNS, table)
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
    percent = {what: f"{whole[what]:.2%}" for what in whole if what != "name"}
    ratio = np.array([row["error"] / row["radius"] for row in known if row["radius"]])
    lines = [
        f"{counted(len(known), 'landmark', 'landmarks')} that people placed on "
        f"{counted(shapes, 'shape', 'shapes')}: the map is {percent['error']} of the "
        f"centroid size off in the mean, {percent['median']} in the median; "
        f"{whole['within']:.0%} of the errors are within the radius, where 90 % are "
        f"expected; within {np.quantile(ratio, 0.9):.1f} times the radius are 90 %",
        f"the best similarity of the landmarks themselves leaves "
        f"{percent['similarity']} (no rigid method can leave less in root mean "
        f"square), iterative closest points leave {percent['icp']}",
    ]
    for what, name in SIMPLE.items():
        worse = lambda own: own["error"] >= own[what]  # noqa: B023
        where = []
        for by, many in (("specimen", "the shapes"), ("landmark", "the landmarks")):
            found = [own["name"] for own in _means(known, by) if worse(own)]
            if found:
                where.append(f"{many} {', '.join(found)}")
        if worse(whole):
            lines.append(f"the map is no better than {name} as a whole")
        if where:
            lines.append(f"the map is no better than {name} for {'; '.join(where)}")
    if len(lines) == 2:
        lines.append("the map is better than both on each shape and for each landmark")
    return lines


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
                "similarity": (column["similarity"] / size).mean(),
                "icp": (column["icp"] / size).mean(),
                "within": column["within"].mean(),
            }
        )
    return sorted(found, key=lambda own: -own["error"])


def _table(groups: list[dict], of: str) -> Table:
    shown = Table(title=f"error of the landmarks that people placed, by {of}")
    shown.add_column(of)
    titles = "number", "mean", "of size", "median", "similarity", "ICP", "within radius"
    for title in titles:
        shown.add_column(title, justify="right")
    for own in groups[:SHOWN]:
        of_size = (own[what] for what in ("error", "median", "similarity", "icp"))
        shown.add_row(
            escape(own["name"]),
            str(own["number"]),
            f"{own['in_unit']:.3g}",
            *(f"{share:.2%}" for share in of_size),
            f"{own['within']:.0%}",
        )
    if len(groups) > SHOWN:
        shown.caption = f"The worst {SHOWN} of {len(groups)}."
    return shown
