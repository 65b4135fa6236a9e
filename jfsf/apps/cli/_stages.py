"""A bar that names the stage a command is in."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn
from rich.progress import TimeElapsedColumn as Elapsed


@contextmanager
def stage_bar(
    stages: int, *, console: Console | None = None
) -> Iterator[Callable[[str], None]]:
    """A function to call with the name of each stage as it begins.

    Args:
        stages: how many there are, as far as is known; the bar grows with more.
        console: that shows it; stderr when absent. Nothing is left there in the end.
    """
    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), Elapsed()
    shown = console or Console(stderr=True)
    with Progress(*columns, console=shown, transient=True) as bar:
        task = bar.add_task("starting", total=stages)
        begun = 0

        def begin(name: str) -> None:
            nonlocal begun
            total = max(stages, begun + 1)
            now = {"description": name, "completed": begun, "total": total}
            bar.update(task, **now, refresh=True)
            begun += 1

        yield begin
