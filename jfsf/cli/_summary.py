"""The results of many pairs: a row each, a table of all, and files."""

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from jfsf.report import warnings_of
from jfsf.types import FIGURES, STAGES


def summary_row(outcome, orientation: str) -> dict[str, Any]:
    """The row of a pair: the reason if it failed, else the certificate of its file.

    Args:
        outcome: a `jfsf.batch.Outcome` whose job wrote a match.
        orientation: as in `warnings_of`.
    """
    from jfsf.mapfiles import read_match

    row: dict[str, Any] = {
        "file": "",
        "reason": outcome.reason or "",
        "earlier": outcome.earlier,
        "seconds": None if math.isnan(outcome.seconds) else outcome.seconds,
        "n_x": None,
        "n_y": None,
        "warnings": [],
        **dict.fromkeys(("start", "attempts", "confidences", *FIGURES)),
        **dict.fromkeys(map(_seconds_of, STAGES)),
    }
    if outcome.reason is not None:
        return row
    match = read_match(outcome.job.out)
    certificate, info = match.certificate, match.info
    if info is not None:
        row["start"], row["attempts"] = info.start, len(info.source)
        likely = map(float, info.confidence)
        row["confidences"] = [None if x != x else round(x, 4) for x in likely]
        for stage, seconds in zip(STAGES, info.seconds, strict=True):
            row[_seconds_of(stage)] = None if np.isnan(seconds) else float(seconds)
    figures = {name: value.item() for name, value in certificate.figures().items()}
    return row | {
        "file": outcome.job.out.name,
        "n_x": len(match.T_xy),
        "n_y": len(match.T_yx),
        "warnings": warnings_of(certificate, orientation),
        # JSON has neither nan nor inf: a point cloud's orientation is null, and so is
        # the gap of a map without a rival.
        **{name: v if math.isfinite(v) else None for name, v in figures.items()},
    }


def _seconds_of(stage: str) -> str:
    return "seconds_" + stage.replace(" ", "_")


def summary_table(rows: list[dict[str, Any]]) -> Table:
    """Counts, and the spread of each figure over the pairs."""
    done = [row for row in rows if not row["reason"]]
    earlier = sum(row["earlier"] for row in rows)
    doubtful = sum(bool(row["warnings"]) for row in done)
    shown = Table(
        title=f"{len(rows)} pairs: {len(done)} matched ({earlier} of them earlier), "
        f"{len(rows) - len(done)} failed, {doubtful} with warnings"
    )
    for name in ("figure", "min", "median", "max"):
        shown.add_column(name, justify="left" if name == "figure" else "right")
    for name in ("seconds", *FIGURES):
        values = [float(row[name]) for row in done if row[name] is not None]
        if values and name != "finite":
            spread = np.quantile(values, (0, 0.5, 1))
            shown.add_row(name.replace("_", " "), *(f"{x:.4g}" for x in spread))
    return shown


def doubtful_first(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Failed pairs, then the others from the least confidence to the most.

    Parts have no confidence: they stand where their own evidence puts them. Pairs
    without either come last.
    """

    def place(row):
        likely, odds = row["confidence"], row.get("log_odds")
        if likely is None and odds is not None:
            likely = 0.5 * (1 + math.tanh(odds / 2))  # the logistic function
        return not row["reason"], math.inf if likely is None else likely

    return sorted(rows, key=place)


def write_summary(
    folder: Path,
    rows: list[dict[str, Any]],
    settings: dict[str, Any],
    meshes: dict[str, list[str]],
) -> tuple[Path, Path]:
    """Write summary.csv, a line a pair, and summary.json.

    The latter has the settings, and what is said of meshes, by their paths, too.
    """
    from jfsf import __version__
    from jfsf.storage import write_text

    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    joined = "warnings", "confidences"
    for row in rows:
        lists = {name: "; ".join(map(str, row[name] or ())) for name in joined}
        table.writerow(row | lists)
    record = {"jfsf": __version__, "settings": settings}
    record |= {"meshes": meshes, "pairs": rows}
    written = folder / "summary.csv", folder / "summary.json"
    write_text(written[0], text.getvalue())
    write_text(written[1], json.dumps(record, indent=1) + "\n")
    return written
