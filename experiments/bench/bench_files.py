"""Seconds, memory and error of a process `jfsf match` on two large files.

Embedded shapes with their edges split (`upsample.py`), written as OFF. The first
process has an empty cache, the next finds the compiled programs, but no spectra. Memory
is the most that a process had. Errors are Euclidean, over sqrt(area), at the vertices
of known partner.

    python -m experiments.bench.bench_files [--vertices 100000 1000000] \\
        [--out RESULT.json]
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from experiments import command_line, results_file
from experiments.bench.upsample import upsample, write_off
from jfsf import data
from jfsf.apps.mapfiles import read_match
from jfsf.mesh import surface_area

PAIR = ("man_walk", "man_up")


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("--vertices", type=int, nargs="+", default=[100_000])
    parser.add_argument("--again", type=int, default=1, help="after the first")
    args = command_line.parse(parser)
    samples = [data.load(name) for name in PAIR]
    rows = {}
    for n in args.vertices:
        meshes = [upsample(sample.mesh, n) for sample in samples]
        with tempfile.TemporaryDirectory() as folder:
            found = _measure(Path(folder), meshes, args.again)
            T_xy = np.asarray(read_match(Path(folder) / "map.npz").T_xy)
        at_x, at_y = (sample.template_to_vertex for sample in samples)
        points = meshes[1].vertices
        away = np.linalg.norm(points[T_xy[at_x]] - points[at_y], axis=1)
        error = float(away.mean() / np.sqrt(surface_area(meshes[1])))
        rows[n] = {**found, "error": error}
        print(n, rows[n], flush=True)
    if args.out:
        results_file.write(args.out, pair=PAIR, rows=rows)


def _measure(folder: Path, meshes, again: int) -> dict:
    """Seconds of each process, and the most memory of all in GB."""
    files = [folder / f"{name}.off" for name in PAIR]
    for path, mesh in zip(files, meshes, strict=True):
        write_off(path, mesh)
    cache = folder / "cache"
    command = [sys.executable, "-m", "jfsf", "match", *map(str, files)]
    command += ["--out", str(folder / "map.npz")]
    seconds, most = [], 0
    for _ in range(1 + again):
        for path in cache.glob("*.npz"):
            path.unlink()
        start = time.perf_counter()
        process = subprocess.Popen(
            command,
            env={**os.environ, "JFSF_CACHE": str(cache)},
            stdout=subprocess.DEVNULL,
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds.append(time.perf_counter() - start)
        if status:
            raise SystemExit(f"jfsf match ended with status {status}")
        most = max(most, usage.ru_maxrss)
    # In kilobytes on Linux, in bytes on macOS.
    gigabytes = most / (1e9 if sys.platform == "darwin" else 1e6)
    return {"first": seconds[0], "again": seconds[1:], "gigabytes": gigabytes}


if __name__ == "__main__":
    main()
