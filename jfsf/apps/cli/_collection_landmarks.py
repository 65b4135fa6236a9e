"""The template's landmarks on all shapes of `jfsf collection`, and how sure they are.

A landmark lies where the registered template has it. With other templates it is carried
to each of these and on; it then lies at the median of all places, on the surface.

The square of its radius is the sum of two: of what the map from the template says there
(`jfsf.matching.vertex_radius`), and of the root mean square distance of all ways to the
shape from where it lies. A way is the template by its own map, by way of each shape
whose map to this one is trusted, and by way of each other template. Of the experts'
landmarks on heel bones of carnivores 0.71 are within it, and 0.87 with three templates
of theirs (experiments/accuracy/morphometry.py).
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.apps.cli._collection_carried import SLICER
from jfsf.apps.cli._collection_jobs import file_of
from jfsf.apps.cli._collection_people import ByPeople
from jfsf.apps.cli._collection_runner import TEMPLATES
from jfsf.apps.cli._runs import write_table
from jfsf.types import Mesh

if TYPE_CHECKING:
    from jfsf.apps.landmarks._place import Placed

# The landmarks to be checked first: as many as are beyond their radius if it is right.
CHECK = 0.1
TO_CHECK = "to_check.csv"
SHOWN = 10  # lines of such on the screen


class OnShapes(NamedTuple):
    """The template's landmarks on the joined shapes, in the unit of each file.

    specimens: names of the shapes.
    names: of the landmarks; numbers from 1 on for those without.
    points: nan where a shape has no surface, and the template only bridges the gap.
    radius: the true place is nearer with 90 % probability; 0 for a landmark that people
        placed, nan without a point, and where the map has no radius.
    template: the landmarks on the template, which need not be one of the shapes.
    """

    specimens: list[str]
    names: list[str]
    points: Float[np.ndarray, "s l 3"]
    radius: Float[np.ndarray, "s l"]
    template: Float[np.ndarray, "l 3"]


def landmarks_on(
    out: Path,
    landmarks,
    shapes,
    graph,
    joined: Sequence[str],
    others: Sequence[str],
    given: dict[str, ByPeople],
) -> OnShapes:
    """Find the template's landmarks on the joined shapes.

    Args:
        out: the folder of the results.
        landmarks: of the template.
        shapes: what was kept of each, by name; mirror images mirrored back.
        graph: of these.
        joined: names of the shapes that the template is on.
        others: names of the other templates.
        given: landmarks that people placed on other shapes: there they stay, and from
            templates among these they are carried on.
    """
    from jfsf.apps.landmarks._place import nearest, on_surface
    from jfsf.apps.landmarks._record import titles_of

    names = list(shapes)
    base = names[graph.paths.template]
    at = on_surface(landmarks, shapes[base].mesh)
    there = {
        name: nearest(shapes[name].mesh, _registered(out, "placed", name, at))
        for name in joined
    }
    starts = {}
    for name in others:
        place = _registered(out, "registered", name, at)
        if own := given.get(name):
            place[own.rows] = own.points
        starts[out / TEMPLATES / name] = nearest(shapes[name].mesh, place)
    points, radius = [], []
    for name in sorted(joined):
        mesh = shapes[name].mesh
        place = _registered(out, "registered", name, at)
        if name == base:
            points.append(place)
            radius.append(np.zeros(len(place)))
            continue
        ways = [_registered(out, "placed", name, at)]
        for number, T in graph.trusted_maps(names.index(name)):
            if way := there.get(names[number]):
                ways.append(way.on(np.asarray(mesh.vertices)[np.asarray(T)]))
        if others:
            votes = [
                _registered(folder, "registered", name, start)
                for folder, start in starts.items()
            ]
            ways += votes
            place = nearest(mesh, _median([place, *votes])).points
        length = np.hypot(_of_map(out, name, at, mesh), _spread(ways, place))
        if own := given.get(name):
            place[own.rows], length[own.rows] = own.points, 0.0
        points.append(place)
        radius.append(length)
    titles, every = titles_of(landmarks.names), (np.stack(points), np.stack(radius))
    return OnShapes(sorted(joined), titles, *every, at.points)


def _registered(out: Path, part: str, name: str, at: "Placed") -> np.ndarray:
    """Points of a template on a shape; nan where it bridges a gap, or is not there."""
    path = file_of(out, part, name)
    if not path.exists():
        return np.full((len(at.corners), 3), np.nan)
    with np.load(path) as file:
        points = at.on(file["vertices"])
        points[file["bridged"][at.corners].all(1)] = np.nan
    return points


def _median(places: Sequence[np.ndarray]) -> np.ndarray:
    """The median of each coordinate; nan where most places are missing."""
    stacked = np.stack(places)
    known = np.isfinite(stacked).all(2).mean(0) >= 0.5
    found = np.full(stacked.shape[1:], np.nan)
    found[known] = np.nanmedian(stacked[:, known], 0)
    return found


def _spread(ways: Sequence[np.ndarray], place: np.ndarray) -> np.ndarray:
    """Root mean square distance of the ways from the place; nan without a place."""
    apart = ((np.stack(ways) - place) ** 2).sum(2)
    count = np.isfinite(apart).sum(0)
    mean = np.nansum(apart, 0) / np.maximum(count, 1)
    return np.where(np.isfinite(place).all(1), np.sqrt(mean), np.nan)


def _of_map(out: Path, name: str, at: "Placed", mesh: Mesh) -> np.ndarray:
    """The radius that the map from the template has, in the unit of the shape."""
    from jfsf.mesh import surface_area

    with np.load(file_of(out, "maps", name)) as file:
        if "radius_x" not in file:
            return np.full(len(at.corners), np.nan)
        radius = file["radius_x"]
    root = np.sqrt(surface_area(mesh))
    return root * (at.weights * radius[at.corners]).sum(1)


def write_landmarks_of(out: Path, found: OnShapes, landmarks, path: Path) -> list[Path]:
    """Write the landmarks on each joined shape, one array of all, and the radii.

    For each shape: in the format of their file, and as .mrk.json and .fcsv. Of all:
    landmarks.csv, landmarks.tps and landmarks_radius.csv.

    Args:
        out: the folder of the results.
        found: the landmarks on all shapes.
        landmarks: of the template, read from `path`.
    """
    from jfsf.apps.landmarks import Landmarks, write_landmarks
    from jfsf.apps.landmarks._morphometrics import specimens_csv, specimens_tps
    from jfsf.apps.landmarks._record import csv_text
    from jfsf.storage._atomic import write_text

    suffix = SLICER if path.name.lower().endswith(SLICER) else path.suffix
    folder = out / "landmarks"
    folder.mkdir(exist_ok=True)
    for name, points in zip(found.specimens, found.points, strict=True):
        there = np.flatnonzero(np.isfinite(points).all(1))
        own = tuple(landmarks.names[at] for at in there)
        for end in dict.fromkeys((suffix, SLICER, ".fcsv")):
            to = folder / f"{name}{end}"
            if len(there):
                kept = Landmarks(own, points[there], None, landmarks.system)
                write_landmarks(to, kept)
            else:
                to.unlink(missing_ok=True)
    names = ("landmarks.csv", "landmarks.tps", "landmarks_radius.csv")
    tables = [out / name for name in names]
    write_text(tables[0], specimens_csv(found.specimens, found.names, found.points))
    write_text(tables[1], specimens_tps(found.specimens, found.points))
    rows = zip(found.specimens, *found.radius.T.tolist(), strict=True)
    write_text(tables[2], csv_text(["specimen", *found.names], rows))
    return [*tables, folder]


def doubtful(found: OnShapes) -> list[dict]:
    """The tenth of the landmarks (`CHECK`) that are to be checked first, in order.

    It is the radius over the centroid size of the landmarks of its shape, relative to
    the median of that landmark in the collection, by which they are chosen.
    """
    from jfsf.apps.morphometrics._procrustes import centroid_size

    size = centroid_size(found.points)[:, None]
    known = np.isfinite(found.radius) & (found.radius > 0) & (size > 0)
    share = np.ma.array(found.radius, mask=~known) / np.where(size > 0, size, 1)
    times = (share / np.ma.median(share, axis=0)).filled(0.0)
    # In one shape alone each is its own median.
    first = np.lexsort((-share.filled(0.0).ravel(), -times.ravel()))
    rows = []
    for i, j in zip(*np.unravel_index(first, times.shape), strict=True):
        rows.append(
            {
                "specimen": found.specimens[i],
                "landmark": found.names[j],
                "radius": found.radius[i, j],
                "of_size": share[i, j],
                "times_median": times[i, j],
            }
        )
    return rows[: math.ceil(CHECK * known.sum())]


def write_doubtful(out: Path, found: OnShapes) -> list[str]:
    """Write the landmarks to be checked as to_check.csv; what to say of them."""
    rows = doubtful(found)
    columns = "specimen", "landmark", "radius", "of_size", "times_median"
    write_table(out / TO_CHECK, columns, rows)
    if not rows:
        return ["how sure the landmarks are is not known: the maps have no radius"]
    lines = [
        f"check these landmarks first, the {len(rows)} with the largest radius over "
        "centroid size, relative to the median of that landmark in the collection:"
    ]
    lines += [
        f"  {row['specimen']}, {row['landmark']}: within {row['radius']:.3g} "
        f"({row['of_size']:.1%} of the size), {row['times_median']:.1f} times the "
        "median"
        for row in rows[:SHOWN]
    ]
    if len(rows) > SHOWN:
        lines.append(f"  and {len(rows) - SHOWN} more, in {TO_CHECK}")
    return lines
