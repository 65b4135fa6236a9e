"""The pages of `jfsf collection`: its index, that of the model, and pictures."""

import math
from pathlib import Path

from jfsf.apps.cli._pages import INDEX, pages_of
from jfsf.apps.report import write_model_page
from jfsf.apps.report._collection import shape_picture, write_collection_page
from jfsf.apps.report._html import thumbnail
from jfsf.apps.report._index import Row
from jfsf.types import Maps, Mesh

PICTURES = "pictures"
LEFT_OUT = "left_out"  # a folder within: a shape may have joined before
MODEL_PAGE = "model.html"


def picture_of_shape(out: Path, name: str) -> Path:
    """The file of the picture of a shape that was joined."""
    return out / PICTURES / f"{name}.png"


def write_picture(out: Path, name: str, template: Mesh, mesh: Mesh, maps: Maps) -> None:
    """Write a picture of a joined shape in the template's colours."""
    path = picture_of_shape(out, name)
    path.parent.mkdir(exist_ok=True)
    thumbnail(shape_picture(mesh, template, maps.T_xy, maps.T_yx), path)


def write_model_pages(out: Path, model, names) -> Path:
    """Write the page of the model."""
    path = out / MODEL_PAGE
    write_model_page(path, model, names)
    return path


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
                picture = out / PICTURES / LEFT_OUT / f"{name}.png"
                picture.parent.mkdir(parents=True, exist_ok=True)
                thumbnail(shape_picture(shapes[name].mesh), picture)
        else:
            lines, picture = _lines(row, name == base), picture_of_shape(out, name)
            if name != base:
                page = pages_of(out / "maps" / f"{name}.npz")[0]
        likely = math.nan if row["confidence"] is None else row["confidence"]
        at, drawn = (p and p.relative_to(out).as_posix() for p in (page, picture))
        listed.append(Row(name, at, drawn, likely, lines, bool(row["reason"])))
    links = {"The model": MODEL_PAGE, "Table": "summary.csv"}
    links = {text: to for text, to in links.items() if (out / to).exists()}
    write_collection_page(out / INDEX, listed, graph, names, links=links)
    return out / INDEX


def has_pages(maps: Path, picture: Path, itself: bool) -> bool:
    """Whether the page and the pictures of a joined shape are there."""
    pages = [] if itself else pages_of(maps)
    return all(page.exists() for page in (*pages, picture))


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
