"""What the commands of many jobs share: files, interrupts, bars."""

import csv
import io
import json
import os
import signal
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Timer, current_thread, main_thread

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.progress import TimeRemainingColumn as Remaining

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
