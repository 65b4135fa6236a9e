"""jfsf and other packages on the same pairs: seconds, memory and errors, in one table.

Each runs its own recipe (`peer_recipes.py`) in processes of its own, which load nothing
of the others and read meshes as arrays. Cold is such a process from its start to its
end, with one pair. For jfsf it is `jfsf match` of two files with an empty cache of
programs, and `second_process_s` is another pair with the cache that this leaves. Warm
is a call in a process that has matched one pair before: the median over pairs of the
medians of `--repeats` calls. Processes and calls of different packages take turns.
Memory is the most that a warm process held.

Pairs are of the embedded bodies, spread over all; with `--data ROOT` of FAUST's, too.
jfsf's settings and constants were chosen on both sets, and geomfum's weights on one of
the bodies' pairs. pyFM's is the best recipe that we found, and pycpd's numbers were set
once, by hand.
A package that is not installed is skipped, and the file says so:

    pip install pyfmaps geomfum scikit-learn pycpd
    python -m experiments.bench.peers [--pairs 6] [--repeats 5] [--out RESULT.json]

Of what else was looked for, no package index that we know has BCPD's or ShapeWorks'
programs; probreg, which has BCPD, needs open3d and with it libraries of a desktop.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from experiments import command_line
from experiments.bench import peer_recipes

# What each package is called by pip.
PEERS = {"jfsf": "jfsf", "pyfm": "pyfmaps", "geomfum": "geomfum", "pycpd": "pycpd"}
SLOW = ("pycpd",)  # a minute a call: called once a pair, and twice cold
READY = "ready"


def main() -> None:
    parser = command_line.parser(__doc__, out="peers.json", data="optional")
    parser.add_argument("--pairs", type=int, default=6, help="of each set, at least 2")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--peers", nargs="+", choices=PEERS, default=[*PEERS])
    parser.add_argument("--serve", choices=PEERS, help=argparse.SUPPRESS)
    args = command_line.parse(parser)
    if args.serve:
        serve(args.serve)
    else:
        compare(args)


def serve(name: str) -> None:
    """Match the pairs whose files are named on standard input, a line each.

    Answers each with a line: seconds of the call, and the most memory so far in MB.
    """
    match = getattr(peer_recipes, name)
    print(READY, flush=True)
    for line in sys.stdin:
        if not line.strip():
            break
        path = Path(line.strip())
        with np.load(path) as file:
            x, y = (
                SimpleNamespace(vertices=file[f"v{side}"], faces=file[f"f{side}"])
                for side in "xy"
            )
        if name == "jfsf":
            from jfsf.types import Mesh

            x, y = (Mesh(mesh.vertices, mesh.faces) for mesh in (x, y))
        started = time.perf_counter()
        T_xy = match(x, y)
        seconds = time.perf_counter() - started
        np.save(path.with_suffix(f".{name}.npy"), T_xy)
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps([seconds, most]), flush=True)


class Process:
    """A process that serves one package."""

    def __init__(self, name: str, cache: Path):
        # Packages print of their own accord; what is read begins after `READY`.
        self.running = subprocess.Popen(
            [sys.executable, "-m", "experiments.bench.peers", "--serve", name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "JFSF_CACHE": str(cache)},
        )
        self._read(lambda line: line.strip() == READY)

    def match(self, path: Path) -> tuple[float, float]:
        """Seconds, and memory in MB."""
        assert self.running.stdin
        self.running.stdin.write(f"{path}\n")
        self.running.stdin.flush()
        seconds, memory = json.loads(self._read(lambda line: line.startswith("[")))
        return seconds, memory

    def end(self) -> None:
        assert self.running.stdin
        self.running.stdin.close()
        self.running.wait()

    def _read(self, wanted) -> str:
        assert self.running.stdout
        for line in self.running.stdout:
            if wanted(line):
                return line
        raise RuntimeError("a process ended before it had answered")


def compare(args: argparse.Namespace) -> None:
    """The table, and its file."""
    import results_file

    missing = {name: PEERS[name] for name in args.peers if not _version(PEERS[name])}
    names = [name for name in args.peers if name not in missing]
    settings: dict[str, Any] = {"pairs": args.pairs, "repeats": args.repeats}
    settings |= {"geomfum": peer_recipes.GEOMFUM_WEIGHTS, "skipped": missing}
    settings["packages"] = {PEERS[name]: _version(PEERS[name]) for name in names}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        pairs = written(folder, args)
        cold = coldly(names, [pair["path"] for pair in pairs], folder, args.repeats)
        warm = warmly(names, pairs, folder / "cache", args.repeats)
    rows: list[dict] = []
    for name in names:
        rows.append({"package": name, **cold[name], **warm[name]})
        print(*rows[-1].items(), sep="\n  ", flush=True)
    truth = [{k: p[k] for k in ("set", "x", "y", "vertices")} for p in pairs]
    results_file.write(args.out, settings=settings, pairs=truth, rows=rows)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def written(folder: Path, args: argparse.Namespace) -> list[dict]:
    """The pairs, with their truth, and files of their meshes."""
    import datasets
    import protocol

    from experiments.bench.upsample import write_off
    from jfsf.mesh import orient

    found = []
    for name in ("embedded", "faust_r") if args.data else ("embedded",):
        data = protocol.SETS[name]
        data = protocol.below(data, args.data) if data.folders else data
        for pair in datasets.spread(datasets.pairs_of(data), args.pairs):
            x, y = datasets.load_pair_of(data, pair)
            path = folder / f"{len(found)}.npz"
            # jfsf winds meshes outward itself; others read the sides off the faces.
            sides = {"x": orient(x.mesh), "y": orient(y.mesh)}
            arrays = {f"v{k}": mesh.vertices for k, mesh in sides.items()}
            arrays |= {f"f{k}": mesh.faces for k, mesh in sides.items()}
            np.savez(path, **arrays)
            for side, mesh in sides.items():
                write_off(path.with_suffix(f".{side}.off"), mesh)
            row = {
                "set": name,
                "x": pair.x,
                "y": pair.y,
                "path": path,
                "y_mesh": y.mesh,
            }
            row["vertices"] = [len(side.mesh.vertices) for side in (x, y)]
            found.append(row | {"truth": (x.truth, y.truth)})
    return found


def coldly(names, paths: list[Path], folder: Path, repeats: int) -> dict[str, dict]:
    """Seconds of whole processes with the first pair."""
    times: dict[str, list[float]] = {name: [] for name in names}
    again: list[float] = []
    for turn in range(repeats):
        cache = folder / f"cache{turn}"
        for name in names:
            if name == "jfsf":
                times[name].append(_command(paths[0], cache))
                again.append(_command(paths[1], cache))
            elif name not in SLOW or turn < 2:
                times[name].append(_whole(name, paths[0], cache))
    rows = {name: {"cold_s": _spread(t)} for name, t in times.items()}
    if again:
        rows["jfsf"]["second_process_s"] = _spread(again)
    return rows


def _command(path: Path, cache: Path) -> float:
    """Seconds of `jfsf match` of two files."""
    files = [str(path.with_suffix(f".{side}.off")) for side in "xy"]
    out = str(path.with_suffix(".map.npz"))
    started = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "jfsf", "match", *files, "--out", out],
        check=True,
        capture_output=True,
        env={**os.environ, "JFSF_CACHE": str(cache)},
    )
    return time.perf_counter() - started


def _whole(name: str, path: Path, cache: Path) -> float:
    started = time.perf_counter()
    process = Process(name, cache)
    process.match(path)
    process.end()
    return time.perf_counter() - started


def warmly(names, pairs: list[dict], cache: Path, repeats: int) -> dict[str, dict]:
    """Seconds of calls, memory, and errors by set."""
    from jfsf.evaluate import geodesic_error

    processes = {name: Process(name, cache) for name in names}
    seconds: dict[str, list[list[float]]] = {name: [] for name in names}
    memory: dict[str, float] = {}
    for name in names:
        processes[name].match(pairs[0]["path"])
    for pair in pairs:
        for name in names:
            seconds[name].append([])
        for turn in range(repeats):
            for name in names:
                if name in SLOW and turn:
                    continue
                took, memory[name] = processes[name].match(pair["path"])
                seconds[name][-1].append(took)
    rows = {}
    for name in names:
        processes[name].end()
        each = [float(np.median(times)) for times in seconds[name]]
        errors: dict[str, list[float]] = {}
        for pair in pairs:
            T_xy = np.load(pair["path"].with_suffix(f".{name}.npy"))
            away = geodesic_error(T_xy, pair["y_mesh"], *pair["truth"])
            errors.setdefault(pair["set"], []).append(float(np.mean(away)))
        rows[name] = {"warm_s": _spread(each), "memory_mb": round(memory[name])}
        rows[name]["error"] = {key: float(np.mean(own)) for key, own in errors.items()}
        rows[name]["error_median"] = {
            key: float(np.median(own)) for key, own in errors.items()
        }
        rows[name]["errors"] = errors
    return rows


def _spread(times: list[float]) -> dict[str, float]:
    """Median, least and most, and of how many."""
    return {
        "median": float(np.median(times)),
        "fastest": min(times),
        "slowest": max(times),
        "of": len(times),
    }


if __name__ == "__main__":
    main()
