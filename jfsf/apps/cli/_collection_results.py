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
from jfsf.apps.cli._runs import INDEX
from jfsf.apps.report import write_model_page
from jfsf.apps.report._collection import shape_picture, write_collection_page
from jfsf.apps.report._html import Row, thumbnail
from jfsf.mesh import surface_area
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
                unit = np.sqrt(surface_area(shapes[name].mesh))
                away = file["distance"] / unit
                row |= {
                    "confidence": float(file["confidence"]),
                    "mean_distance": float(away.mean()),
                    "most_distance": float(np.quantile(away, 0.95)),
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
    for name in ("confidence", "mean distance", "95 %", "bridged", "flipped faces"):
        shown.add_column(name, justify="right")
    for row in rows:
        if not row["reason"]:
            likely = row["confidence"]
            shown.add_row(
                escape(row["name"]),
                "unknown" if np.isnan(likely) else f"{likely:.2f}",
                f"{row['mean_distance']:.2%}",
                f"{row['most_distance']:.2%}",
                f"{row['bridged']:.1%}",
                str(row["flipped"]),
            )
    shown.caption = "Distances between template and shape, in % of sqrt(area)."
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
        f"The template lies {row['mean_distance']:.2%} of sqrt(area) from it in the "
        f"mean, {row['most_distance']:.2%} for 95 % of the vertices"
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
    """Write the template's landmarks on each joined shape, in the format of their file.

    Args:
        out: the folder of the results.
        rows: of the summary.
        mesh: the template.
        landmarks: read from `path`.
    """
    from jfsf.apps.landmarks import Landmarks, write_landmarks
    from jfsf.apps.landmarks._place import on_surface

    found = on_surface(landmarks, mesh)
    suffix = SLICER if path.name.lower().endswith(SLICER) else path.suffix
    folder = out / "landmarks"
    folder.mkdir(exist_ok=True)
    for row in rows:
        if not row["reason"]:
            vertices = np.load(file_of(out, "registered", row["name"]))["vertices"]
            points = np.einsum("lc,lci->li", found.weights, vertices[found.corners])
            own = Landmarks(landmarks.names, points, None, landmarks.system)
            write_landmarks(folder / f"{row['name']}{suffix}", own)
    return [folder]


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
        ValueError: as `read_labels` and `read_values`.
    """
    from jfsf.apps.transfer._files import read_labels, read_values
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
