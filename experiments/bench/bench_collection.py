"""How long `jfsf collection` takes for 10, 100 and 1000 specimens, and how much memory.

Specimens are made from the embedded bodies and their shape model: a body, moved along
random modes of the model of all twelve, and decimated to 2000 vertices from noise that
no two share, so no triangulation repeats. Their truth is the mesh that all were made
in. Collections of other sizes are of other specimens.

Of each size, by a process with two workers (dask): seconds, also of the processor and a
specimen; gigabytes of the process that plans, and the most of all processes together;
specimens that were left out, and those on which the template is wrong, with a mean
error of 0.1 of sqrt(area) or more. --kills N: the run is killed N times, at random, and
started again; `starts` counts them, and `again` has what the last one still had to do.
If this script is stopped itself, run it again: `starts.json` in the folder has what was
used before, and a size that has ended is not run again.

    python -m experiments.bench.bench_collection FOLDER [--specimens 10 100 1000] \\
        [--kills 10] [--out RESULT.json]
"""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import psutil
from scipy.spatial import KDTree

from experiments import command_line, results_file
from experiments.accuracy.collection import write_off
from experiments.accuracy.protocol import RIGHT
from experiments.accuracy.shape_model import in_one_mesh
from jfsf.apps import model
from jfsf.mesh import decimate, surface_area
from jfsf.types import Mesh

VERTICES, TEMPLATE = 2000, "man_t"
SPREAD = 0.3  # standard deviations of each mode
NOISE = 0.02  # of the mean length of edges, before vertices are taken away
WORKERS = 2
WITHIN = 60.0  # seconds in which a run is killed
SUMS, MOST = ("seconds", "seconds of the processor"), ("gigabytes", "gigabytes of all")


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_collection.json")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--specimens", type=int, nargs="+", default=[10, 100, 1000])
    parser.add_argument("--kills", type=int, default=0)
    args = command_line.parse(parser)
    rows = {}
    for number in args.specimens:
        folder = args.folder / str(number)
        make(folder, number)
        rows[number] = measured(folder, args.kills)
        rows[number] |= right(folder)
        print(number, rows[number], flush=True)
        settings = {"vertices": VERTICES, "spread": SPREAD, "workers": WORKERS}
        results_file.write(args.out, settings=settings, rows=rows)


def make(folder: Path, number: int) -> None:
    """The files of the specimens, and their truth: all vertices of the one mesh."""
    scans, truth = folder / "scans", folder / "truth"
    if (folder / "made").exists():
        return
    scans.mkdir(parents=True, exist_ok=True)
    truth.mkdir(exist_ok=True)
    shapes, faces = in_one_mesh(TEMPLATE)
    fitted = model.fit_model(jnp.asarray(shapes), faces)
    deviation = SPREAD * np.sqrt(np.asarray(fitted.variance))
    aligned = [np.asarray(model.shape_at(fitted, scores)) for scores in fitted.scores]
    rng = np.random.default_rng(number)
    for i in range(number):
        body = np.asarray(aligned[rng.integers(len(aligned))], float)
        moved = np.einsum(
            "k,kvc->vc", deviation * rng.normal(size=len(deviation)), fitted.modes
        )
        points = body + moved
        length = np.linalg.norm(np.diff(points[faces[:, :2]], axis=1), axis=2).mean()
        rough = points + NOISE * length * rng.normal(size=points.shape)
        write_off(scans / f"{i:04d}.off", decimate(Mesh(rough, faces), VERTICES))
        np.save(truth / f"{i:04d}.npy", points.astype(np.float32))
    (folder / "made").touch()


def measured(folder: Path, kills: int) -> dict:
    """Seconds and memory of the command, over all its starts."""
    command = [sys.executable, "-m", "jfsf", "collection", str(folder / "scans")]
    command += ["--out", str(folder / "model"), "--workers", str(WORKERS)]
    limits = [*np.random.default_rng(0).uniform(0, WITHIN, kills), None]
    starts, kept = [], folder / "starts.json"
    if kept.exists():
        starts = json.loads(kept.read_text())
    while not (starts and starts[-1]["ended"]):
        limit = limits[min(len(starts), kills)]
        starts.append({})
        for starts[-1] in started(command, folder / "log", limit):
            kept.write_text(json.dumps(starts))
    rows = read(folder / "model" / "summary.csv")
    total = {key: sum(start[key] for start in starts) for key in SUMS}
    most = {key: max(start[key] for start in starts) for key in MOST}
    return {
        **total,
        **most,
        "starts": len(starts),
        "again": starts[-1]["seconds"],
        "a specimen": total["seconds"] / len(rows),
        "left out": sum(bool(row["reason"]) for row in rows),
    }


def started(command: list[str], log: Path, limit: float | None) -> Iterator[dict]:
    """Run it, and yield what it has used so far; after so many seconds it is killed.

    So it is, with its workers, if this script is interrupted.
    """
    start, plan, every, cpu = time.perf_counter(), 0, 0, {}
    with open(log, "ab") as file:
        process = subprocess.Popen(
            command, stdout=file, stderr=file, start_new_session=True
        )
    ended, seconds = False, 0.0
    try:
        while not ended and (limit is None or seconds < limit):
            time.sleep(0.5)
            ended, seconds = process.poll() is not None, time.perf_counter() - start
            sizes = sizes_of(process.pid, cpu)
            plan, every = max(plan, sizes[0]), max(every, sum(sizes))
            used = (seconds, sum(cpu.values()), plan / 1e9, every / 1e9)
            yield dict(zip((*SUMS, *MOST), used, strict=True)) | {"ended": ended}
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if ended and process.returncode not in (0, 1):
        raise SystemExit(f"jfsf collection ended with {process.returncode}: see {log}")


def sizes_of(number: int, cpu: dict[int, float]) -> list[int]:
    """Bytes of a process, then of those that it started; `cpu` gets their seconds."""
    sizes = []
    try:
        own = psutil.Process(number)
        for one in (own, *own.children(recursive=True)):
            used = one.cpu_times()
            cpu[one.pid] = used.user + used.system
            sizes.append(one.memory_info().rss)
    except psutil.NoSuchProcess:  # it ended meanwhile
        pass
    return sizes or [0]


def right(folder: Path) -> dict:
    """Errors of the template's vertices on the joined specimens."""
    load = lambda i: np.load(folder / "truth" / f"{i:04d}.npy").astype(float)
    registered = folder / "model" / "registered"
    rows = read(folder / "model" / "summary.csv")
    joined = [int(row["name"]) for row in rows if not row["reason"]]
    # The template lies on itself best.
    base = min(
        (row for row in rows if not row["reason"]),
        key=lambda row: float(row["most_in_unit"]),
    )
    with np.load(registered / f"{base['name']}.npz") as file:
        at = KDTree(file["vertices"]).query(load(int(base["name"])))[1]
    errors, (_, faces) = [], in_one_mesh(TEMPLATE)
    for i in joined:
        with np.load(registered / f"{i:04d}.npz") as file:
            found, truth = file["vertices"][at], load(i)
        root = np.sqrt(surface_area(Mesh(truth, faces)))
        errors.append(float(np.linalg.norm(found - truth, axis=1).mean() / root))
    return {
        "error": float(np.mean(errors)),
        "wrong": sum(error >= RIGHT for error in errors),
    }


def read(path: Path) -> list[dict]:
    """Rows of a summary."""
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(file))


if __name__ == "__main__":
    main()
