"""Reliability diagrams: how many maps of each confidence are right, set by set.

Of the matches that match_pairs.py wrote, with the confidence of constants that were
fitted to all other sets (calibration.py): a panel for each set, and one for all. A bar
is the share of right maps among those of a tenth of the confidence, with their number
above it; the dot is their mean confidence, where the bar should end. Each panel has the
calibration error. Beside the figure goes a JSON with its numbers.

    python -m experiments.figures.figure_reliability [--results FOLDER] [--out PNG]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import protocol
from experiments.fit import calibration
from experiments.fit.reliability import Reliability, reliability

COLUMNS = 4


def main() -> None:
    parser = command_line.parser(__doc__, out="figure_reliability.png")
    parser.add_argument("--results", type=Path, default=calibration.RESULTS)
    args = command_line.parse(parser)
    sets = calibration.read_all(args.results)
    found = calibration.held_out(sets)
    right = {name: own.matches.right for name, own in sets.items()}
    panels = {name: (found[name], right[name]) for name in sets}
    every = tuple(np.concatenate(list(values.values())) for values in (found, right))
    panels = {"all": every, **panels}
    draw(panels, args.out)
    rows = [
        {"set": name, **calibration.scores(*maps), **_plain(reliability(*maps))}
        for name, maps in panels.items()
    ]
    settings = {"right": protocol.RIGHT, "sets": list(sets)}
    results_file.write(args.out.with_suffix(".json"), settings=settings, rows=rows)


def draw(panels: dict[str, tuple[np.ndarray, ...]], path: Path) -> None:
    """One panel each, of confidence and whether the map is right."""
    rows = -(-len(panels) // COLUMNS)
    figure, axes = plt.subplots(
        rows, COLUMNS, figsize=(3 * COLUMNS, 2.7 * rows), squeeze=False
    )
    for axis, (name, maps) in zip(axes.flat, panels.items(), strict=False):
        found, number = reliability(*maps), len(maps[0])
        bins = len(found.share)
        edges, heights = np.arange(bins) / bins, np.nan_to_num(found.share)
        axis.plot([0, 1], [0, 1], color="0.7", linewidth=1, zorder=0)
        axis.bar(edges, heights, 1 / bins, align="edge", color="#8fb4d9", edgecolor="w")
        axis.plot(found.probability, found.probability, "o", color="#b5432e", ms=3)
        counts = np.rint(found.weight * number).astype(int)
        for left, height, count in zip(edges, heights, counts, strict=True):
            if count:
                middle = left + 0.5 / bins
                axis.text(middle, height + 0.02, str(count), ha="center", fontsize=7)
        axis.set(xlim=(0, 1), ylim=(0, 1.12), xticks=(0, 0.5, 1), yticks=(0, 0.5, 1))
        total = f"{number} maps, calibration error {found.calibration_error:.3f}"
        axis.set_title(f"{_title(name)}\n{total}", fontsize=8)
    for axis in axes.flat[len(panels) :]:
        axis.axis("off")
    figure.supxlabel("confidence, fitted to the other sets", fontsize=9)
    figure.supylabel("share of right maps", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _plain(found: Reliability) -> dict[str, list[float | None]]:
    """As lists; None where a bin is empty."""
    return {
        name: [None if np.isnan(v) else round(float(v), 4) for v in values]
        for name, values in found._asdict().items()
    }


def _title(name: str) -> str:
    """Of a panel: with what the set is for."""
    sets = protocol.SETS
    return f"{name} ({', '.join(set(sets[name].roles))})" if name in sets else name


if __name__ == "__main__":
    main()
