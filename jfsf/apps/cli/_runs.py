"""What the commands of many jobs share: files, and how they are interrupted."""

import json
import multiprocessing.resource_tracker
import multiprocessing.util
import os
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Timer, current_thread, main_thread

from jfsf.apps.cli._stages import Stages

SETTINGS = "settings.json"
DRAWING = "drawing.json"
INTERRUPTED = 130  # the exit code, as in `jfsf.__main__`


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
def stopping(out: Path, parts: Mapping[str, str], shown: Stages) -> Iterator[None]:
    """While this lasts, an interrupt says what is kept, and ends process and workers.

    Nothing is closed, nor is anything raised: dask takes seconds to close, with a
    warning a worker, and an exception is lost in some places (`jfsf.__main__`).

    Args:
        out: folder of the results.
        parts: what is kept in it -> the pattern of its files.
        shown: the stages.
    """
    before = signal.getsignal(signal.SIGINT)
    # Ignored in the background; and only the main thread may change it.
    if not callable(before) or current_thread() is not main_thread():
        yield
        return
    signal.signal(signal.SIGINT, partial(_stop, out, parts, shown))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _stop(out, parts, shown: Stages, *_: object) -> None:
    """Say what is kept, and end."""
    from jfsf.storage._atomic import remove_left_over, remove_unfinished

    # If a lock that is needed here is held by what was interrupted.
    late = Timer(1.5, os._exit, [INTERRUPTED])
    late.daemon = True
    late.start()
    try:
        shown.last_words(f"stopped; {_kept(out, parts)}")
        # What dask and Python say of workers that are gone goes nowhere.
        null = os.open(os.devnull, os.O_RDWR)
        for number in (1, 2):
            os.dup2(null, number)
        for worker in multiprocessing.active_children():
            worker.kill()
        remove_unfinished()
        remove_left_over(out)
        # As at any exit: else semaphores stay. Python's process that looks for them
        # would name those that another thread makes meanwhile.
        multiprocessing.util._run_finalizers(0)  # type: ignore
        tracker = multiprocessing.resource_tracker._resource_tracker  # type: ignore
        if (number := getattr(tracker, "_pid", None)) is not None:
            os.kill(number, signal.SIGKILL)
    finally:
        os._exit(INTERRUPTED)


def _kept(out: Path, parts: Mapping[str, str]) -> str:
    """What is kept in a folder of results, and how to go on."""
    numbers = {what: len(list(out.glob(files))) for what, files in parts.items()}
    some = [f"{n} {what if n > 1 else what[:-1]}" for what, n in numbers.items() if n]
    if not some:
        return "nothing is kept yet; run the same command to begin again"
    listed = " and ".join([", ".join(some[:-1]), some[-1]] if some[1:] else some)
    are = "is" if sum(numbers.values()) == 1 else "are"
    return f"{listed} {are} kept; run the same command to go on"


def write_table(
    path: Path, columns: Sequence[str], rows: Iterable[dict], missing: str = "nan"
) -> None:
    """Write rows as a CSV file with titles; it appears complete or not at all.

    missing: what stands for nan.
    """
    from jfsf.apps.landmarks._record import csv_text
    from jfsf.storage._atomic import write_text

    write_text(
        path, csv_text(columns, [[r[c] for c in columns] for r in rows], missing)
    )
