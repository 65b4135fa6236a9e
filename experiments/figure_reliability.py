"""Reliability diagrams: how many maps of each confidence are right, set by set.

From the results of match_pairs.py: a panel for each file, and one for all. A bar is the
share of right maps among those of a tenth of the confidence, with its number of maps
above it; the dot is their mean confidence, where the bar should end. Each panel has the
calibration error: the mean distance of dot and end of bar, weighed by the numbers. Maps
without a confidence (nan) are left out. Beside the figure goes a JSON with its numbers.

    python experiments/figure_reliability.py [RESULT.json ...] [--attempts] --out PNG
"""

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import results_file
from protocol import RIGHT, SETS

BINS = 10
COLUMNS = 4
RESULTS = Path(__file__).parent / "results"


class Reliability(NamedTuple):
    """By bin: number of maps, of right ones, and mean confidence, nan where empty.

    gap: the calibration error.
    """

    maps: np.ndarray
    right: np.ndarray
    confidence: np.ndarray
    gap: float


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path, nargs="*", help="default: all that exist")
    parser.add_argument(
        "--attempts", action="store_true", help="maps of all attempts, not of the best"
    )
    parser.add_argument("--out", type=Path, default=RESULTS / "figure_reliability.png")
    args = parser.parse_args()
    paths = args.results or _plain(sorted(RESULTS.glob("match_*.json")))
    panels = {}
    for path in paths:
        rows = json.loads(path.read_text())["pairs"]
        panels[path.stem.removeprefix("match_")] = maps_of(rows, args.attempts)
    panels = {"all": np.concatenate(list(panels.values())), **panels}
    found = {name: reliability(*maps.T) for name, maps in panels.items()}
    draw(found, args.out)
    rows = [
        {
            "set": name,
            "maps": one.maps.tolist(),
            "right": one.right.tolist(),
            "mean_confidence": [None if np.isnan(c) else c for c in one.confidence],
            "calibration_error": one.gap,
        }
        for name, one in found.items()
    ]
    settings = {"right": RIGHT, "bins": BINS, "attempts": args.attempts}
    settings["files"] = [path.name for path in paths]
    results_file.write(args.out.with_suffix(".json"), settings=settings, rows=rows)


def maps_of(rows: list[dict], attempts: bool = False) -> np.ndarray:
    """(m, 2): confidence and error of each map that has a confidence."""
    if attempts:
        rows = [one for row in rows for one in row["attempts"]]
    maps = np.array([(row["confidence"], row["error"]) for row in rows])
    maps = maps.reshape(-1, 2)
    return maps[~np.isnan(maps[:, 0])]


def reliability(confidence: np.ndarray, error: np.ndarray) -> Reliability:
    """Counts and means in ten bins of equal width."""
    at = np.minimum((confidence * BINS).astype(int), BINS - 1)
    maps, right, total = (
        np.bincount(at, weights=values, minlength=BINS)
        for values in (np.ones(len(at)), error < RIGHT, confidence)
    )
    gap = np.abs(right - total).sum() / max(len(at), 1)
    mean = total / np.where(maps > 0, maps, np.nan)
    return Reliability(maps.astype(int), right.astype(int), mean, float(gap))


def draw(found: dict[str, Reliability], path: Path) -> None:
    """One panel each."""
    rows = -(-len(found) // COLUMNS)
    figure, axes = plt.subplots(
        rows, COLUMNS, figsize=(3 * COLUMNS, 2.7 * rows), squeeze=False
    )
    edges = np.arange(BINS) / BINS
    for axis, (name, one) in zip(axes.flat, found.items(), strict=False):
        axis.plot([0, 1], [0, 1], color="0.7", linewidth=1, zorder=0)
        heights = one.right / np.maximum(one.maps, 1)
        axis.bar(edges, heights, 1 / BINS, align="edge", color="#8fb4d9", edgecolor="w")
        axis.plot(one.confidence, one.confidence, "o", color="#b5432e", markersize=3)
        for left, height, number in zip(edges, heights, one.maps, strict=True):
            if number:
                middle = left + 0.5 / BINS
                axis.text(middle, height + 0.02, str(number), ha="center", fontsize=7)
        axis.set(xlim=(0, 1), ylim=(0, 1.12), xticks=(0, 0.5, 1), yticks=(0, 0.5, 1))
        total = f"{one.maps.sum()} maps, calibration error {one.gap:.3f}"
        axis.set_title(f"{_title(name)}\n{total}", fontsize=8)
    for axis in axes.flat[len(found) :]:
        axis.axis("off")
    figure.supxlabel("confidence", fontsize=9)
    figure.supylabel("share of right maps", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _plain(paths: list[Path]) -> list[Path]:
    """Those of match_pairs.py as it is, without other attempts than by default."""
    return [p for p in paths if not p.stem.endswith(("_exhaustive", "_first"))]


def _title(name: str) -> str:
    """Of a panel: with what the set is for, if it is one of the protocol."""
    return f"{name} ({', '.join(set(SETS[name].roles))})" if name in SETS else name


if __name__ == "__main__":
    main()
