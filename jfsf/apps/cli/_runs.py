"""What the commands of many jobs share, and the summary of many pairs.

Shared are files, interrupts and bars. The summary has a row a pair, a table of all,
files, and an index.
"""

import csv
import io
import json
import math
import os
import signal
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Timer, current_thread, main_thread
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.progress import TimeRemainingColumn as Remaining
from rich.table import Table

from jfsf._figures import FIGURES
from jfsf.apps.cli._pair import FOLDER, pages_of
from jfsf.apps.cli._print import WARNING
from jfsf.apps.report._html import Row, write_index
from jfsf.apps.report._words import warnings_of
from jfsf.types import STAGES

SETTINGS = "settings.json"
DRAWING = "drawing.json"


def begin(out: Path, options: dict) -> None:
    """Make the folder; refuse to mix results of different settings."""
    from jfsf import __version__
    from jfsf.storage._atomic import remove_left_over, write_text

    options = {**options, "jfsf": __version__}
    path = out / SETTINGS
    if path.exists():
        try:
            before = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            before = None
        if before != options:
            raise ValueError(
                f"{path}: the results there were made with other settings"
                f"{_differences(before, options)}; name another folder, or remove it"
            )
    out.mkdir(parents=True, exist_ok=True)
    remove_left_over(out)
    write_text(path, json.dumps(options, indent=2) + "\n")


def note_drawing(out: Path, how: dict) -> None:
    """Write how pages and pictures are made; an equal file keeps its date.

    Those that are older than it were made in another way.
    """
    from jfsf.storage._atomic import write_text

    text, path = json.dumps(how, indent=2) + "\n", out / DRAWING
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)


def _differences(before, now: dict) -> str:
    """The options that differ, as they were and as they are."""
    if not isinstance(before, dict):
        return ""
    words = {True: "yes", False: "no", None: "not given"}

    def named(options, name):
        value = options.get(name)
        return words[value] if value is None or value in (True, False) else value

    differ = [name for name in now | before if before.get(name) != now.get(name)]
    said = ", ".join(
        f"{name.replace('_', '-')} was {named(before, name)}, is {named(now, name)}"
        for name in differ
    )
    return f" ({said})" if said else ""


@contextmanager
def raising_interrupts():
    """An interrupt is a KeyboardInterrupt, so that the workers are closed."""
    before = signal.getsignal(signal.SIGINT)
    # Ignored in the background; and only the main thread may change it.
    if not callable(before) or current_thread() is not main_thread():
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _interrupt(number, frame) -> None:
    """A KeyboardInterrupt; a little later where Python would ignore it."""
    if _is_ignored(frame):
        Timer(0.1, os.kill, (os.getpid(), number)).start()
    else:
        signal.default_int_handler(number, frame)


def _is_ignored(frame) -> bool:
    """Whether Python prints and ignores an exception raised in this frame.

    It does so within a `__del__`, within jax's callback of the garbage collector, and
    within the callback by which an import releases its lock.
    """
    while frame is not None:
        name, file = frame.f_code.co_name, frame.f_code.co_filename
        if name in ("__del__", "_xla_gc_callback"):
            return True
        if name == "cb" and file == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def bars() -> Progress:
    """Bars of jobs that are done, on stderr."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        Remaining(),
        console=Console(stderr=True),
    )


def write_table(path: Path, columns: Sequence[str], rows: Iterable[dict]) -> None:
    """Write rows as a CSV file with titles; it appears complete or not at all."""
    from jfsf.storage._atomic import write_text

    text = io.StringIO()
    table = csv.DictWriter(text, columns, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_text(path, text.getvalue())


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
    """Write summary.csv, a line a pair, and summary.json, with the settings too."""
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
