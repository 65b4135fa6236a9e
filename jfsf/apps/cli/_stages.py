"""The stages of a run of many jobs: bars on a terminal, plain lines elsewhere."""

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
)
from rich.text import Text

from jfsf.batch._jobs import Outcome


@dataclass
class Stage:
    """A stage, and what was measured of it. Times are seconds.

    name: what its jobs make, in the plural.
    total: jobs that are known of; more may come.
    earlier: of these, done before this run.
    made: of these, done or failed in this run.
    took: time from the first job on to the last that has ended, without pauses.
    since: when the jobs that are under way were begun or the last one ended; None
        before the first job, and after the last.
    """

    name: str
    total: int | None = None
    earlier: int = 0
    made: int = 0
    took: float = 0.0
    since: float | None = None

    @property
    def ended(self) -> int:
        """Jobs that need no more work."""
        return self.earlier + self.made

    def left(self, now: float) -> float | None:
        """Seconds that are left, by the mean of this run; None if nothing is known."""
        if self.total is None or not self.made:
            return None
        rest = self.took / self.made * (self.total - self.ended)
        return max(rest - (now - self.since if self.since is not None else 0), 0)

    def said(self, now: float) -> str:
        """The time left, in words."""
        if self.total == 0:
            return "not needed"
        if self.total is not None and self.ended == self.total:
            return f"done, {duration(self.took)}" if self.made else "done"
        left = self.left(now)
        return "estimating" if left is None else f"{duration(left)} left"


def duration(seconds: float) -> str:
    """Seconds as a few words: 9 s, 4 min, 2 h 30 min."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return (
        f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
    )


class _Left(ProgressColumn):
    """The time that a stage still takes."""

    def render(self, task) -> Text:
        return Text(task.fields["stage"].said(time.monotonic()))


class Stages:
    """All stages of a run, and where they are shown: see `stages`."""

    def __init__(self, names: Sequence[str]) -> None:
        self._stages = {name: Stage(name) for name in names}
        screen = Console(stderr=True)
        self.on_screen = screen.is_terminal
        # Where neither is a terminal, and where only bars would be seen.
        self.in_lines = not (self.on_screen and sys.stdout.isatty())
        self._lines = sys.stdout  # before rich puts its own in its place
        self.bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            _Left(),
            console=screen,
            disable=not self.on_screen,
            redirect_stdout=False,
            redirect_stderr=False,
            refresh_per_second=4,
        )
        self._tasks = {
            name: self.bars.add_task(name, total=None, stage=stage)
            for name, stage in self._stages.items()
        }

    def say(self, line: str) -> None:
        """Print a line beside the stages."""
        if self.on_screen:
            self.bars.console.print(line, soft_wrap=True, markup=False)
        if self.in_lines:
            print(line, file=self._lines, flush=True)

    def begin(self, name: str, jobs: int) -> None:
        """So many jobs of a stage are begun."""
        stage = self._stages[name]
        stage.total, stage.since = (stage.total or 0) + jobs, time.monotonic()
        self._show(stage)

    def advance(self, name: str, said: str = "", *, quiet: bool = False) -> None:
        """A job of a stage has ended.

        Args:
            name: of the stage.
            said: of what it has made.
            quiet: whether there is no line for it.
        """
        stage, now = self._stages[name], time.monotonic()
        self._say_earlier(stage)
        stage.made += 1
        stage.took += now - (stage.since or now)
        stage.since = now
        line = f"{name} {stage.ended}/{stage.total}{said and ': '}{said}"
        rest = stage.ended < (stage.total or 0)
        if not quiet:
            self._log(f"{line}; {stage.said(now)}" if rest else line)
        self._show(stage)

    def outcome(self, name: str, outcome: Outcome) -> None:
        """A job of a stage has ended, or was done before this run."""
        if outcome.earlier:
            self._stages[name].earlier += 1
            self._show(self._stages[name])
            return
        said = outcome.job.out.stem.replace("__", ", ")
        if outcome.seconds == outcome.seconds:
            said += f", {outcome.seconds:.1f} s"
        if outcome.reason is not None:
            said += f", failed: {outcome.reason}"
        self.advance(name, said)

    def end(self, name: str) -> None:
        """All jobs that were begun have ended; others may follow."""
        self._say_earlier(self._stages[name])
        self._stages[name].since = None

    def _say_earlier(self, stage: Stage) -> None:
        if stage.earlier and not stage.made:
            are = "is" if stage.earlier == 1 else "are"
            self._log(f"{stage.name}: {stage.earlier} {are} kept from an earlier run")

    def _log(self, line: str) -> None:
        if self.in_lines:
            print(time.strftime("%H:%M:%S"), line, file=self._lines, flush=True)

    def _show(self, stage: Stage) -> None:
        self.bars.update(
            self._tasks[stage.name], completed=stage.ended, total=stage.total
        )

    def close(self) -> None:
        """All is done: stages without a job were not needed."""
        for stage in self._stages.values():
            stage.total = stage.total or 0
            self._show(stage)

    def last_words(self, line: str) -> None:
        """Print a line and show nothing more: for the handler of a signal.

        Not through Python's streams: the handler may run while they are written to.
        """
        self.bars.stop()
        for number, used in ((1, self.in_lines), (2, self.on_screen)):
            if used:
                os.write(number, f"{line}\n".encode())


@contextmanager
def stages(names: Sequence[str]) -> Iterator[Stages]:
    """Show the stages of a run, all named beforehand.

    If stderr is a terminal, as a bar each, with the time left that follows from the
    jobs of this run. If stdout is none, or there are no bars, a line goes to stdout
    when a job ends, with the time of day and how long it took.
    """
    shown = Stages(names)
    with shown.bars:
        yield shown
        shown.close()
