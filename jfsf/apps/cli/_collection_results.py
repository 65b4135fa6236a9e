"""The results of `jfsf collection`: a row for each shape, the model, and an index."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli._collection_jobs import file_of, picture_of_shape
from jfsf.apps.cli._pair import pages_of
from jfsf.apps.cli._print import counted
from jfsf.apps.cli._summary import INDEX
from jfsf.apps.report import write_model_page
from jfsf.apps.report._collection import shape_picture, write_collection_page
from jfsf.apps.report._html import Row, thumbnail
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import rms_size

LEFT_OUT = "left_out"  # a folder of pictures: a shape may have joined before
MODEL_PAGE = "model.html"

SHOWN = 10  # shapes in doubt that are named on the screen
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
    "rms_size",
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
                root, size = np.sqrt(surface_area(mesh)), rms_size(mesh)
                units = {"distance": root, "in_unit": 1.0, "of_size": size}
                for unit, length in units.items():
                    row[f"mean_{unit}"], row[f"most_{unit}"] = (far / length).tolist()
                row |= {
                    "confidence": float(file["confidence"]),
                    "rms_size": size,
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
    """A line for each shape, those to be looked at first."""
    joined = sum(not row["reason"] for row in rows)
    shapes = counted(len(rows), "shape", "shapes")
    shown = Table(title=f"{shapes}, {joined} joined; {escape(title)}")
    shown.add_column("shape", overflow="fold")
    titles = "confidence", "distance", "of size", "of √area", "bridged", "flipped"
    for name in titles:
        shown.add_column(name, justify="right")
    for row in rows:
        if not row["reason"]:
            likely = row["confidence"]
            # On the template itself there are only roundings.
            length = row["mean_in_unit"] if row["mean_of_size"] > 1e-9 else 0
            shown.add_row(
                escape(row["name"]),
                "unknown" if np.isnan(likely) else f"{likely:.2f}",
                f"{length:.3g}",
                f"{row['mean_of_size']:.2%}",
                f"{row['mean_distance']:.2%}",
                f"{row['bridged']:.1%}",
                str(row["flipped"]),
            )
    shown.caption = (
        "Mean distance of the template from the shape: in the unit of its file, as a "
        "share of its rms size (root mean square distance from its centroid), and "
        "as one of the square root of its area."
    )
    return shown


def in_doubt(rows) -> list[str]:
    """A line for each joined shape whose maps are in doubt, the least sure first."""
    from jfsf.apps.collections._grow import SURE

    found = [row for row in rows if not row["reason"] and row["trust"] < SURE]
    found.sort(key=lambda row: row["trust"])
    lines = [
        f"in doubt: {row['name']}: with {row['trust']:.0%} probability the maps that "
        "lead to it are right; look at it"
        for row in found[:SHOWN]
    ]
    more = len(found) - SHOWN
    return lines + ([f"  and {more} more: trust in summary.csv"] if more > 0 else [])


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


def forget_pages(out: Path) -> None:
    """Remove the pages of an earlier run, which say what is no longer so."""
    for page in (INDEX, MODEL_PAGE):
        (out / page).unlink(missing_ok=True)


def _lines(row, template: bool) -> list[str]:
    """What is said of a joined shape."""
    if template:
        return ["the template"]
    said = (
        f"The template lies {row['mean_in_unit']:.3g} from it in the mean, in the unit "
        f"of its file ({row['mean_of_size']:.2%} of its rms size, "
        f"{row['mean_distance']:.2%} of sqrt(area)), and {row['most_in_unit']:.3g} for "
        "95 % of the vertices"
    )
    if row["bridged"]:
        said += f"; {row['bridged']:.1%} of the vertices bridge holes"
    flaws = row["flipped"] + row["collapsed"]
    said += f"; {flaws} faces are flipped or collapsed" if flaws else ""
    return [said + ".", *(["It was mirrored back."] if row["mirrored"] else [])]
