"""The results of `jfsf collection`: a row a shape, the model, landmarks, an index."""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli._collection_pages import write_model_pages
from jfsf.mesh import surface_area
from jfsf.types import Mesh

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
            with np.load(registered(out, name)) as file:
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


def write_summary(out: Path, rows) -> Path:
    """Write summary.csv: a row a shape."""
    from jfsf.storage._atomic import write_text

    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    path = out / "summary.csv"
    write_text(path, text.getvalue())
    return path


def write_model_of(
    out: Path, rows, faces, *, scale: bool, report: bool
) -> tuple[list[Path], list]:
    """Write the model of the joined shapes; the files, and what to say of it."""
    from jfsf.apps.model import fit_model, write_model, write_modes, write_scores

    names = sorted(row["name"] for row in rows if not row["reason"])
    if len(names) < 2:
        return [], ["a model needs two shapes or more, and there is none"]
    shapes = np.stack([np.load(registered(out, n))["vertices"] for n in names])
    centred = shapes - shapes.mean(1, keepdims=True)
    model = fit_model(centred, faces, scale=scale)
    write_model(out / "model.npz", model)
    write_scores(out / "scores.csv", names, model)
    written = [out / "model.npz", out / "scores.csv", *write_modes(out, model)]
    if report:
        written.append(write_model_pages(out, model, names))
    return written, []


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
            vertices = np.load(registered(out, row["name"]))["vertices"]
            points = np.einsum("lc,lci->li", found.weights, vertices[found.corners])
            own = Landmarks(landmarks.names, points, None, landmarks.system)
            write_landmarks(folder / f"{row['name']}{suffix}", own)
    return [folder]


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


def registered(out: Path, name: str) -> Path:
    """The file of the template on a shape."""
    return out / "registered" / f"{name}.npz"
