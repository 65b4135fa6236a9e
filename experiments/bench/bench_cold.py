"""Seconds of a process `jfsf match`: with an empty cache, again, and another pair.

Embedded shapes, written as OFF files; every process is fresh. Seconds from its start to
its end, so importing, reading and writing are in them.

    python -m experiments.bench.bench_cold [--repeats 5] [--out RESULT.json]
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.bench.upsample import write_off
from jfsf import data

# `match` pads all to one size, so one program serves both pairs.
FIRST, OTHER = ("man_walk", "man_up"), ("woman_walk", "child_up")
PROCESSES = {"empty cache": FIRST, "the same pair": FIRST, "another pair": OTHER}


def seconds(folder: Path, cache: Path, pair: tuple[str, str]) -> float:
    """Of one process."""
    files = [str(folder / f"{name}.off") for name in pair]
    command = [sys.executable, "-m", "jfsf", "match", *files, "--out"]
    start = time.perf_counter()
    subprocess.run(
        [*command, str(folder / "map.npz")],
        check=True,
        capture_output=True,
        env={**os.environ, "JFSF_CACHE": str(cache)},
    )
    return time.perf_counter() - start


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_cold.json")
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    times: dict[str, list[float]] = {name: [] for name in PROCESSES}
    for _ in range(args.repeats):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            for shape in FIRST + OTHER:
                write_off(folder / f"{shape}.off", data.load(shape).mesh)
            for name, pair in PROCESSES.items():
                times[name].append(seconds(folder, folder / "cache", pair))
    rows = {
        name: {"median": float(np.median(t)), "fastest": min(t), "slowest": max(t)}
        for name, t in times.items()
    }
    for name, row in rows.items():
        print(f"{name:14s} {row['median']:.1f} s", end=" ")
        print(f"({row['fastest']:.1f} to {row['slowest']:.1f})")
    settings = {
        "processes": PROCESSES,
        "repeats": args.repeats,
        "match_settings": jfsf.Settings().as_record(),
        "seed": None,
    }
    results_file.write(args.out, settings=settings, rows=rows)


if __name__ == "__main__":
    main()
