"""Reports of the commands: of one pair, of the demo, and of a batch."""

import math
from pathlib import Path
from typing import Any

from jfsf.apps.cli._files import can_write, kept_points, need_matplotlib
from jfsf.apps.report import Side, write_report
from jfsf.apps.report._html import thumbnail
from jfsf.apps.report._index import Row, write_index
from jfsf.mesh._read import stem_of

FOLDER = "report"  # of a batch: pages and pictures of its pairs
INDEX = "index.html"


def can_report(path: Path | None, gt_x: Path | None, gt_y: Path | None) -> None:
    """ValueError or ImportError if the page, or its ground truth, cannot be made."""
    if (gt_x is None) != (gt_y is None):
        raise ValueError("ground truth takes both --gt-x and --gt-y")
    if path is not None:
        can_write(path, ".html")
        need_matplotlib()
    elif gt_x is not None:
        raise ValueError(f"{gt_x}: ground truth is for the report; name one: --report")


def kept_truth(
    gt_x: Path | None, gt_y: Path | None, shapes, base: int | None = None
) -> Any:
    """Vertices that correspond, of two files, or None without files.

    Args:
        gt_x, gt_y, base: as `jfsf.apps.mapfiles.read_ground_truth` takes them.
        shapes: the `Shape` of X and of Y. Points whose vertex was not kept are left
            out.
    """
    from jfsf.apps.mapfiles import read_ground_truth

    if gt_x is None or gt_y is None:
        return None
    n_x, n_y = (
        len(own.mesh.vertices if own.partner is None else own.partner) for own in shapes
    )
    truth = read_ground_truth(gt_x, gt_y, n_x=n_x, n_y=n_y, base=base)
    return kept_points(truth, [own.partner for own in shapes])


def pair_page(out: Path, inputs, found, **options) -> None:
    """Write page and picture of a pair of a batch.

    Args:
        out: the file of the match.
        inputs: for X and Y, the file, its mesh and the numbers of its vertices.
        found: the match.
        options: of `write_report`.
    """
    page, picture = pages_of(out)
    page.parent.mkdir(exist_ok=True)
    x, y = (Side(mesh, stem_of(path), index) for path, mesh, index in inputs)
    thumbnail(write_report(page, x, y, found, **options), picture)


def pages_of(out: Path) -> tuple[Path, Path]:
    """Page and picture of the pair whose match is in this file."""
    folder = out.parent / FOLDER
    return folder / f"{out.stem}.html", folder / f"{out.stem}.png"


def batch_index(folder: Path, rows: list[dict[str, Any]]) -> Path:
    """Write the index of a batch; rows are those of its summary."""
    listed = []
    for row in rows:
        page, picture = (None, None)
        if not row["reason"]:
            files = pages_of(folder / row["file"])
            page, picture = (f"{FOLDER}/{file.name}" for file in files)
        likely = row["confidence"]
        listed.append(
            Row(
                f"{Path(row['x']).name} → {Path(row['y']).name}",
                page,
                picture,
                math.nan if likely is None else likely,
                [row["reason"]] if row["reason"] else row["warnings"],
                bool(row["reason"]),
            )
        )
    write_index(folder / INDEX, listed)
    return folder / INDEX
