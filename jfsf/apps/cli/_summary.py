"""The results of many pairs: a row each, a table of all, files, and an index."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from jfsf._figures import FIGURES
from jfsf.apps.cli._pair import FOLDER, pages_of
from jfsf.apps.cli._print import WARNING
from jfsf.apps.cli._runs import write_table
from jfsf.apps.report._html import Row, write_index
from jfsf.apps.report._words import warnings_of
from jfsf.types import STAGES

INDEX = "index.html"


def summary_row(
    outcome, orientation: str, *, landmarks: Sequence[str] = ()
) -> dict[str, Any]:
    """The row of a pair: the reason if it failed, else the certificate of its file.

    Args:
        outcome: a `Outcome` whose job wrote a match.
        orientation, landmarks: as in `warnings_of`.
    """
    from jfsf.apps.mapfiles import read_match, read_notes

    row: dict[str, Any] = {
        "file": "",
        "reason": outcome.reason or "",
        "earlier": outcome.earlier,
        "seconds": None if math.isnan(outcome.seconds) else outcome.seconds,
        "n_x": None,
        "n_y": None,
        "warnings": [],
        "notes": [],
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
    figures = certificate.figures()
    notes = read_notes(outcome.job.out)
    doubts = [n.removeprefix(WARNING) for n in notes if n.startswith(WARNING)]
    warnings = warnings_of(certificate, orientation, landmarks=landmarks)
    return row | {
        "file": outcome.job.out.name,
        "n_x": len(match.T_xy),
        "n_y": len(match.T_yx),
        "warnings": doubts + warnings,
        "notes": [note for note in notes if not note.startswith(WARNING)],
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
    title = f"{len(rows)} {'pair' if len(rows) == 1 else 'pairs'}: {len(done)} matched"
    title += f" ({earlier} of them earlier)" if earlier else ""
    counts = {"failed": len(rows) - len(done), "with warnings": doubtful}
    for what, number in counts.items():
        title += f", {number} {what}" if number else ""
    shown = Table(title=title)
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

    Pairs without a confidence come last.
    """

    def place(row):
        likely = row["confidence"]
        return not row["reason"], math.inf if likely is None else likely

    return sorted(rows, key=place)


def write_summary(
    folder: Path, rows: list[dict[str, Any]], settings: dict[str, Any]
) -> tuple[Path, Path]:
    """Write summary.csv, a line for each pair, and summary.json, also with settings."""
    from jfsf import __version__
    from jfsf.storage._atomic import write_text

    joined = "warnings", "notes", "confidences"
    plain = [
        row | {name: "; ".join(map(str, row[name] or ())) for name in joined}
        for row in rows
    ]
    record = {"jfsf": __version__, "settings": settings, "pairs": rows}
    written = folder / "summary.csv", folder / "summary.json"
    write_table(written[0], list(rows[0]), plain)
    write_text(written[1], json.dumps(record, indent=1) + "\n")
    return written


def batch_index(folder: Path, rows: list[dict[str, Any]]) -> Path:
    """Write the index of a batch; rows are those of its summary."""
    listed = []
    for row in rows:
        page = picture = None
        if not row["reason"]:
            files = pages_of(folder / row["file"])
            page, picture = (f"{FOLDER}/{file.name}" for file in files)
        name = f"{Path(row['x']).name} → {Path(row['y']).name}"
        likely = math.nan if row["confidence"] is None else row["confidence"]
        lines = [row["reason"]] if row["reason"] else row["warnings"]
        listed.append(Row(name, page, picture, likely, lines, bool(row["reason"])))
    write_index(folder / INDEX, listed)
    return folder / INDEX
