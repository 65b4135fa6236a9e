"""The curve of errors over the share that is kept, and a picture of some pairs.

Small numbers at the points of the curves are those of pairs. Reads what `partial.py`
wrote. The pictures are matched anew: cuts of its pairs, and the upper half of one body
with the whole of another. Y, above, is coloured where it is matched; X has the colours
of its images.

    python -m experiments.figures.figure_partial [--results RESULT.json] \\
        --out FIGURE.png
"""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy.partial import pairs, part_of
from jfsf import data
from jfsf.apps.plot import coordinate_colours, draw_shape
from jfsf.apps.plot._panels import picture_of
from jfsf.matching.parts import cut

SHOWN = ((0, 0.5), (2, 0.5), (7, 0.7))  # number of the pair, share
UPPER = "man_up", "woman_walk"
GREY = (0.82, 0.82, 0.84)
LABELS = {"jfsf": "match(partial=True)", "zoomout": "ZoomOut", "pyfm": "pyFM"}


def main() -> None:
    parser = command_line.parser(__doc__, out="figure_partial.png")
    folder = command_line.RESULTS
    parser.add_argument("--results", type=Path, default=folder / "partial.json")
    args = command_line.parse(parser)
    summary = json.loads(args.results.read_text())["summary"]
    figure = plt.figure(figsize=(12, 9))
    grid = figure.add_gridspec(2, 4, height_ratios=(1, 1.5))
    draw_curves(figure.add_subplot(grid[0, :2]), summary, "mean", "mean error")
    draw_curves(figure.add_subplot(grid[0, 2:]), summary, "iou", "region: IoU")
    rows = []
    for column, (title, part, whole) in enumerate(shown()):
        axis = figure.add_subplot(grid[1, column])
        found = jfsf.match(part, whole, partial=True)
        axis.imshow(picture(part, whole, found))
        axis.set_title(title, fontsize=9)
        axis.axis("off")
        confidence = float(found.certificate.confidence)
        matched = float(np.mean(np.asarray(found.matched_y)))
        rows.append({"pair": title, "confidence": confidence, "matched_y": matched})
        print(rows[-1], flush=True)
    figure.tight_layout()
    figure.savefig(args.out, dpi=110)
    results_file.write(args.out.with_suffix(".json"), settings={}, rows=rows)


def shown():
    """Title, part and whole of each picture."""
    listed = pairs(1 + max(number for number, _ in SHOWN))
    for number, keep in SHOWN:
        name_x, name_y = listed[number]
        part = part_of(name_x, keep, number).mesh
        title = f"{keep:.0%} of {name_x}\nto {name_y}"
        yield title, part, data.load(name_y).mesh
    body = data.load(UPPER[0]).mesh
    height = body.vertices[:, 1]
    upper = cut(body, height > (height.max() + height.min()) / 2).mesh
    yield f"upper half of {UPPER[0]}\nto {UPPER[1]}", upper, data.load(UPPER[1]).mesh


def picture(part, whole, found) -> np.ndarray:
    """Y above X."""
    T_xy = np.asarray(found.T_xy)
    colours = coordinate_colours(whole.vertices, up="y")
    matched = np.asarray(found.matched_y)
    above = np.where(matched[:, None], colours, GREY)
    drawn = [
        picture_of(draw_shape(whole, above, up="y")),
        picture_of(draw_shape(part, colours[T_xy], up="y")),
    ]
    width = max(image.shape[1] for image in drawn)
    return np.concatenate([_widened(image, width) for image in drawn])


def _widened(image, width: int):
    extra = width - image.shape[1]
    sides = ((0, 0), (extra // 2, extra - extra // 2), (0, 0))
    return np.pad(image, sides, constant_values=image.max())


def draw_curves(axis, summary: list[dict], name: str, label: str) -> None:
    """A line a method over the share that is kept."""
    for method, text in LABELS.items():
        rows = [row for row in summary if row["method"] == method]
        if rows:
            shares = [100 * row["keep"] for row in rows]
            values = [row[name] for row in rows]
            axis.plot(shares, values, "o-", label=text)
            for share, value, row in zip(shares, values, rows, strict=True):
                above = {"xytext": (0, 5), "textcoords": "offset points"}
                axis.annotate(str(row["pairs"]), (share, value), fontsize=7, **above)
    whole = [row for row in summary if row["method"] == "whole"]
    if whole and name == "mean":
        axis.axhline(whole[0][name], ls="--", c="0.5", label="whole pairs")
        axis.set_yscale("log")
    axis.set_xlabel("% of the area of X kept")
    axis.set_ylabel(label)
    axis.invert_xaxis()
    axis.legend()


if __name__ == "__main__":
    main()
