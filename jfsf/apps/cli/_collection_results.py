"""The results of `jfsf collection`: a row a shape, the model, and an index.

Carried to each shape are landmarks, labels and values of the template.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli._collection_jobs import file_of, picture_of_shape
from jfsf.apps.cli._pair import pages_of
from jfsf.apps.cli._summary import INDEX
from jfsf.apps.report import write_model_page
from jfsf.apps.report._collection import shape_picture, write_collection_page
from jfsf.apps.report._html import thumbnail
from jfsf.apps.report._index import Row
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import centroid_size
from jfsf.types import ArrayLike, Mesh

LEFT_OUT = "left_out"  # a folder of pictures: a shape may have joined before
MODEL_PAGE = "model.html"

SLICER = ".mrk.json"  # Slicer takes a file that ends in .json alone for no landmarks
COLUMNS = (
    "name",
    "trust",
    "confidence",
    "mean_distance",
    "most_distance",
    "mean_in_unit",
    "most_in_unit",
    "mean_of_size",
    "most_of_size",
    "centroid_size",
    "bridged",
    "flipped",
    "collapsed",
    "mirrored",
    "reason",
)


def rows_of(out, paths, shapes, graph, reasons) -> list[dict[str, Any]]:
    """What is known of each shape: those left out first, then the least confident."""
    number = {name: i for i, name in enumerate(shapes)}
    rows = []
    for name in paths:
        row = dict.fromkeys(COLUMNS) | {"name": name, "reason": reasons.get(name, "")}
        if name in number:
            row["trust"] = float(graph.paths.trust[number[name]])
            row["mirrored"] = int(number[name] in graph.mirrored)
        if not row["reason"]:
            with np.load(file_of(out, "registered", name)) as file:
                away, mesh = file["distance"], shapes[name].mesh
                far = np.array([away.mean(), np.quantile(away, 0.95)])
                root, size = np.sqrt(surface_area(mesh)), centroid_size(mesh)
                units = {"distance": root, "in_unit": 1.0, "of_size": size}
                for unit, length in units.items():
                    row[f"mean_{unit}"], row[f"most_{unit}"] = (far / length).tolist()
                row |= {
                    "confidence": float(file["confidence"]),
                    "centroid_size": size,
                    "bridged": float(file["bridged"].mean()),
                    "flipped": int(file["flipped"]),
                    "collapsed": int(file["collapsed"]),
                }
        rows.append(row)
    sure = lambda row: (row["confidence"] is not None, row["confidence"] or 0.0)
    return sorted(rows, key=sure)


def write_model_of(
    out: Path, rows, faces, *, scale: bool, report: bool
) -> tuple[list[Path], list]:
    """Write the model of the joined shapes; the files, and what to say of it."""
    from jfsf.apps.model import fit_model, write_model, write_modes, write_scores

    names = sorted(row["name"] for row in rows if not row["reason"])
    if len(names) < 2:
        return [], ["a model needs two shapes or more, and there is none"]
    shapes = np.stack(
        [np.load(file_of(out, "registered", n))["vertices"] for n in names]
    )
    centred = shapes - shapes.mean(1, keepdims=True)
    model = fit_model(centred, faces, scale=scale)
    write_model(out / "model.npz", model)
    write_scores(out / "scores.csv", names, model)
    written = [out / "model.npz", out / "scores.csv", *write_modes(out, model)]
    if report:
        write_model_page(out / MODEL_PAGE, model, names)
        written.append(out / MODEL_PAGE)
    return written, []


def table(rows, title: str) -> Table:
    """A line a shape, those to be looked at first."""
    joined = sum(not row["reason"] for row in rows)
    shown = Table(title=f"{len(rows)} shapes, {joined} joined; {escape(title)}")
    shown.add_column("shape")
    titles = "confidence", "distance", "of size", "of √area", "bridged", "flipped"
    for name in titles:
        shown.add_column(name, justify="right")
    for row in rows:
        if not row["reason"]:
            likely = row["confidence"]
            shown.add_row(
                escape(row["name"]),
                "unknown" if np.isnan(likely) else f"{likely:.2f}",
                f"{row['mean_in_unit']:.3g}",
                f"{row['mean_of_size']:.2%}",
                f"{row['mean_distance']:.2%}",
                f"{row['bridged']:.1%}",
                str(row["flipped"]),
            )
    shown.caption = (
        "Mean distance of the template from the shape: in the unit of its file, as a "
        "share of its centroid size (root mean square distance from the centroid), and "
        "as one of the square root of its area."
    )
    return shown


def write_index_page(out: Path, rows, shapes, graph) -> Path:
    """Write the index of the collection, and pictures of the shapes left out.

    Args:
        out: folder of the results.
        rows: of `rows_of`.
        shapes: what was kept of each, by name.
        graph: of these.
    """
    names = list(shapes)
    base = names[graph.paths.template]
    listed = []
    for row in rows:
        name, page, picture = row["name"], None, None
        if row["reason"]:
            lines = [row["reason"]]
            if name in shapes:
                picture = picture_of_shape(out, name).parent / LEFT_OUT / f"{name}.png"
                picture.parent.mkdir(parents=True, exist_ok=True)
                thumbnail(shape_picture(shapes[name].mesh), picture)
        else:
            lines, picture = _lines(row, name == base), picture_of_shape(out, name)
            if name != base:
                page = pages_of(file_of(out, "maps", name))[0]
        likely = math.nan if row["confidence"] is None else row["confidence"]
        at, drawn = (p and p.relative_to(out).as_posix() for p in (page, picture))
        listed.append(Row(name, at, drawn, likely, lines, bool(row["reason"])))
    links = {"The model": MODEL_PAGE, "Table": "summary.csv"}
    links = {text: to for text, to in links.items() if (out / to).exists()}
    write_collection_page(out / INDEX, listed, graph, names, links=links)
    return out / INDEX


def _lines(row, template: bool) -> list[str]:
    """What is said of a joined shape."""
    if template:
        return ["the template"]
    said = (
        f"The template lies {row['mean_in_unit']:.3g} from it in the mean, in the unit "
        f"of its file ({row['mean_of_size']:.2%} of its centroid size, "
        f"{row['mean_distance']:.2%} of sqrt(area)), and {row['most_in_unit']:.3g} for "
        "95 % of the vertices"
    )
    if row["bridged"]:
        said += f"; {row['bridged']:.1%} of the vertices bridge holes"
    flaws = row["flipped"] + row["collapsed"]
    said += f"; {flaws} faces are flipped or collapsed" if flaws else ""
    return [said + ".", *(["It was mirrored back."] if row["mirrored"] else [])]


def points_of(landmarks: Path | None, template: Path | None):
    """The landmarks as points of the template; None without any.

    Their vertices, if they are such, are those of its file: of what is kept of it they
    would be others.
    """
    from jfsf.apps.landmarks import read_landmarks
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.mesh import read

    if landmarks is None or template is None:
        return None
    found = read_landmarks(landmarks)
    mesh = read(template, finite=False)  # --repair leaves them out
    at = on_surface(found, mesh)
    if found.vertices is None:
        return found
    return found._replace(points=at.points, vertices=None)


def write_landmarks_of(
    out: Path, rows, mesh: Mesh, landmarks, path: Path
) -> list[Path]:
    """Write the template's landmarks on each joined shape, and one array of all.

    For each shape: in the format of their file, and as .mrk.json and .fcsv. Of all:
    landmarks.csv and landmarks.tps. A landmark is missing where the shape has no
    surface, and the template only bridges the gap.

    Args:
        out: the folder of the results.
        rows: of the summary.
        mesh: the template.
        landmarks: read from `path`.
    """
    from jfsf.apps.landmarks import Landmarks, write_landmarks
    from jfsf.apps.landmarks._morphometrics import specimens_csv, specimens_tps
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.storage._atomic import write_text

    found = on_surface(landmarks, mesh)
    suffix = SLICER if path.name.lower().endswith(SLICER) else path.suffix
    folder = out / "landmarks"
    folder.mkdir(exist_ok=True)
    names = sorted(row["name"] for row in rows if not row["reason"])
    points = np.empty((len(names), len(landmarks.names), 3))
    for i, name in enumerate(names):
        with np.load(file_of(out, "registered", name)) as file:
            vertices, bridged = file["vertices"], file["bridged"]
        points[i] = np.einsum("lc,lci->li", found.weights, vertices[found.corners])
        points[i, bridged[found.corners].all(1)] = np.nan
        there = np.flatnonzero(np.isfinite(points[i]).all(1))
        own = tuple(landmarks.names[at] for at in there)
        for end in dict.fromkeys((suffix, SLICER, ".fcsv")):
            to = folder / f"{name}{end}"
            if len(there):
                kept = Landmarks(own, points[i, there], None, landmarks.system)
                write_landmarks(to, kept)
            else:
                to.unlink(missing_ok=True)
    tables = out / "landmarks.csv", out / "landmarks.tps"
    write_text(tables[0], specimens_csv(names, landmarks.names, points))
    write_text(tables[1], specimens_tps(names, points))
    return [*tables, folder]


class Carried(NamedTuple):
    """A file of the template.

    what: "labels" or "values"; the folder of the results has that name.
    suffix: of the file, and of the results.
    column: what it has for each vertex or face (`Column`).
    """

    what: str
    suffix: str
    column: ArrayLike


def carried_of(template: Path | None, **files: Path | None) -> list[Carried]:
    """The files to carry, read and checked against the template.

    Args:
        template: its file.
        files: labels and values, by these names; None where there is none.

    Raises:
        ValueError: as `jfsf.apps.transfer.read_labels` and `read_values`.
    """
    from jfsf.apps.transfer import read_labels, read_values
    from jfsf.mesh import read

    found = []
    for what, path in files.items():
        if path is None or template is None:
            continue
        mesh = read(template, finite=False)  # --repair leaves them out
        n, m = len(mesh.vertices), len(mesh.faces)
        is_labels = what == "labels"
        column = read_labels(path, n, m) if is_labels else read_values(path, n)
        found.append(Carried(what, path.suffix.lower(), column))
    return found


def write_carried(
    out: Path, rows, paths, shapes, template: str, carried, turned
) -> list[Path]:
    """Write them for the vertices or faces of the file of each joined shape.

    Args:
        out: the folder of the results.
        rows: of the summary.
        paths, shapes: the file, and what was kept of it, by name.
        template: its name.
        carried: of `carried_of`.
        turned: names of the shapes that were mirrored back.

    Returns:
        The folders that were written to.
    """
    from jfsf.apps.registration import Registration
    from jfsf.apps.transfer import labels, values
    from jfsf.apps.transfer._files import write_column
    from jfsf.apps.transfer._overlay import extended, overlay_template
    from jfsf.mesh import read
    from jfsf.mesh._edit import mirror_image

    carry = {"labels": labels, "values": values}
    for one in carried:
        (out / one.what).mkdir(exist_ok=True)
    # What is not finite is left out by --repair; without it there is none.
    source = read(paths[template], finite=False)
    for row in rows:
        if not carried or row["reason"]:
            continue
        name = row["name"]
        with np.load(file_of(out, "registered", name)) as file:
            found = Registration(*(file[field] for field in Registration._fields))
        part = overlay_template(shapes[template].mesh, shapes[name].mesh, found)
        file = read(paths[name], finite=False)
        scan = mirror_image(file) if name in turned else file
        whole = extended(part, scan, source)
        for one in carried:
            result = one.column._replace(rows=carry[one.what](whole, one.column.rows))
            write_column(out / one.what / f"{name}{one.suffix}", result)
    return [out / one.what for one in carried]


def carried_files(out: Path, name: str) -> list[Path]:
    """The files of what was carried to a shape, landmarks included, that are there."""
    from jfsf.apps.landmarks._files import SUFFIXES
    from jfsf.apps.transfer._files import FORMATS, LABEL_FORMATS

    columns = {"labels": LABEL_FORMATS, "values": FORMATS}
    kinds = {"landmarks": (SLICER, *SUFFIXES), **columns}
    paths = [out / kind / f"{name}{end}" for kind in kinds for end in kinds[kind]]
    return [path for path in paths if path.exists()]
