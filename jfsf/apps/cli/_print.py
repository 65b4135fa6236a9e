"""What the commands print: errors in the words of their options, notes, the stage."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from jfsf.apps.report._words import readings
from jfsf.mesh._values import LEAVE_OUT, InputError
from jfsf.types import Certificate

WARNING = "warning: "
# Arguments of functions, as they name a mesh in errors, and what it is called here.
_SHAPES = {
    f"{part}mesh_{side.lower()}": f"{part}{side}"
    for part in ("", "part of ")
    for side in "XY"
}


@cache
def _in_options() -> dict[str, str]:
    """Advice of the package that names functions: the same advice with options."""
    from jfsf.apps.mapfiles._formats import FROM_0, FROM_1
    from jfsf.geometry._geodesics import NOT_EXACT
    from jfsf.mesh._check import ONE_COMPONENT

    return {
        FROM_0: "pass --base 0",
        FROM_1: "it looks 1-based: pass --base 1",
        LEAVE_OUT: "leave them out with --repair",
        NOT_EXACT: "leave out --exact",
        ONE_COMPONENT: "keep one with match --largest-component, match all with match "
        "--components, or join seams of coincident vertices with match --repair",
    }


def said(error: Exception) -> str:
    """The message of an error on one line; its advice names options."""
    if isinstance(error, InputError):
        advice = _in_options().get(error.advice, error.advice)
        name = _SHAPES.get(error.name, error.name)
        error = InputError(error.what, advice, name)
    return " ".join(str(error).split())


def sentence(error: Exception) -> str:
    """What to say of an error about the input."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}; check the path"
    return said(error)


def counted(number: int, one: str, many: str) -> str:
    """A number and its noun: 1 point, 2 points."""
    return f"{number} {one if number == 1 else many}"


def print_any_letter() -> None:
    """Let stdout and stderr write names in letters that their encoding lacks.

    Else such a name ends the command after its work. The letters become escapes.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # type: ignore


def say(*lines: str) -> None:
    """Print lines as they are: names of files in them may look like markup."""
    for line in lines:
        Console().print(line, soft_wrap=True, markup=False)


def say_result(
    shown: Iterable[Table],
    notes: Iterable[str],
    doubts: Iterable[str],
    written: Iterable[Path | None],
) -> None:
    """Print a result: tables, notes, warnings, and the files written."""
    for table in shown:
        Console().print(table)
    say(*notes, *(WARNING + doubt for doubt in doubts))
    say(*(f"wrote {path}" for path in written if path is not None))


@contextmanager
def stage_bar(console: Console | None = None) -> Iterator[Callable[[str], None]]:
    """A function to call with the name of each stage as it begins.

    Args:
        console: that shows it; stderr when absent. Nothing is left there in the end.
    """
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    shown = console or Console(stderr=True)
    # Else an empty line is left where stderr is a file.
    off = not shown.is_terminal
    with Progress(*columns, console=shown, transient=True, disable=off) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda name: bar.update(task, description=name, refresh=True)


def certificate_table(certificate: Certificate) -> Table:
    """A table with a row for each figure of the certificate, and what it means."""
    shown = Table(title="certificate: evidence without ground truth")
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    shown.add_column("reading")
    for name, (value, reading) in readings(certificate).items():
        shown.add_row(name, value, reading)
    return shown
