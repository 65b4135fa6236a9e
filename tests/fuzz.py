"""A process that reads damaged files, one after the other (`fuzz_reader.py`).

It may die, hang or grow: then it is replaced, and the file is named.
"""

import queue
import subprocess
import sys
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from fuzz_damage import damaged
from fuzz_formats import FORMATS

READER = Path(__file__).with_name("fuzz_reader.py")
SECONDS = 20  # for a file, on a busy machine
MEGABYTES = 500  # of the whole process


class Finding(NamedTuple):
    """What went wrong with a file: `damaged(FORMATS[name], seed)` makes it again."""

    name: str
    seed: int
    what: str


class Reader:
    """A process of `fuzz_reader.py`, replaced when it fails."""

    def __init__(self, seconds: float = SECONDS):
        self.seconds = seconds
        self.process: subprocess.Popen[str] | None = None

    def read(self, path: Path, *, sound: bool = False) -> str:
        """What the process says of a file: "" if it behaved.

        A sound file must be read by the first of the readers of its format.
        """
        if self.process is None or self.process.poll() is not None:
            self._start()
        assert self.process is not None and self.process.stdin is not None
        self.process.stdin.write(f"{'!' if sound else '?'}{path}\n")
        self.process.stdin.flush()
        try:
            said = self.answers.get(timeout=self.seconds)
        except queue.Empty:
            said = f"took more than {self.seconds} s"
            self.close()
        if said is None:
            said = f"the process ended with {self.process.wait()}"
        elif said:
            self.close()
        return said

    def _start(self):
        self.close()
        self.process = subprocess.Popen(
            [sys.executable, READER, str(MEGABYTES)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,  # which behaving readers leave alone
            text=True,
            cwd=READER.parents[1],
        )
        self.answers: queue.Queue[str | None] = queue.Queue()
        self.listener = threading.Thread(
            target=_listen, args=(self.process.stdout, self.answers), daemon=True
        )
        self.listener.start()
        assert self.answers.get(timeout=120) == "ready"

    def close(self) -> None:
        """End the process."""
        if self.process is None:
            return
        self.process.kill()
        self.process.wait()
        self.listener.join()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()
        self.process = None


def _listen(stream, answers):
    for line in stream:
        answers.put(line.rstrip("\n"))
    answers.put(None)


def findings(folder: Path, cases: Iterable[tuple[str, int]]) -> list[Finding]:
    """Read damaged files of these formats and seeds; what went wrong with any."""
    reader, found = Reader(), []
    try:
        for name, seed in cases:
            path = folder / f"a{FORMATS[name].suffix}"
            path.write_bytes(damaged(FORMATS[name], seed))
            if said := reader.read(path):
                found.append(Finding(name, seed, said))
    finally:
        reader.close()
    return found
