"""The stage a command is in, on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def stage_bar(console: Console | None = None) -> Iterator[Callable[[str], None]]:
    """A function to call with the name of each stage as it begins.

    Args:
        console: that shows it; stderr when absent. Nothing is left there in the end.
    """
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    shown = console or Console(stderr=True)
    with Progress(*columns, console=shown, transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda name: bar.update(task, description=name, refresh=True)
