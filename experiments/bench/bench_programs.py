"""Seconds to get the compiled programs of one match in a fresh process, four ways.

The programs are those that `jfsf.match` asks for on two embedded shapes of 5000
vertices, and a process gets them as `match` does: one thread, and two more that
compile. Seconds are counted from when jax is imported and its device is there.

- kept: loaded from the cache of jfsf, which holds machine code
- exported: `jax.export`'s serialised StableHLO, which XLA compiles again
- exported, xla cached: the same, compiled by jax's persistent compilation cache, which
  holds machine code too
- compiled: traced, lowered and compiled

    python -m experiments.bench.bench_programs [--repeats 5] [--out RESULT.json]
"""

import inspect
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import jax
import numpy as np
from jax import export

import jfsf
from experiments import command_line, results_file
from jfsf import data
from jfsf.runtime import _programs
from jfsf.runtime._programs import compile_ahead

PAIR = "man_walk", "man_up"
WAYS = "kept", "exported", "exported, xla cached", "compiled"


def record(folder: Path) -> None:
    """Match, and write down each program that was asked for; fill the cache of jfsf."""
    asked = []

    class Recorded(_programs._Flat):
        def __call__(self, *leaves):
            shapes = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in leaves]
            asked.append((self._function, self._tree.unflatten(shapes)))
            return super().__call__(*leaves)

    _programs._Flat = Recorded
    jfsf.match(*(data.load(name).mesh for name in PAIR))
    with (folder / "asked.pickle").open("wb") as file:
        _Pickler(file).dump(asked)
    for number, (function, args) in enumerate(asked):
        # Flat, because exports know no records.
        flat = lambda *leaves, f=function, tree=jax.tree.structure(args): (
            jax.tree.leaves(f(*jax.tree.unflatten(tree, leaves)))
        )
        found = export.export(jax.jit(flat))(*jax.tree.leaves(args))
        (folder / f"{number}.export").write_bytes(found.serialize())


class _Pickler(pickle.Pickler):
    """Functions by name, with or without the `jit` that their module puts around."""

    def reducer_override(self, obj):
        """Of a function that pickle cannot name."""
        wrapped = getattr(obj, "__wrapped__", None) is not None
        if not wrapped and not inspect.isfunction(obj):
            return NotImplemented
        here = getattr(import_module(obj.__module__), obj.__qualname__, None)
        if here is obj:
            return (_named, (*_name(obj), False)) if wrapped else NotImplemented
        if here is not None and inspect.unwrap(here) is obj:
            return _named, (*_name(obj), True)
        return NotImplemented


def _name(function) -> tuple[str, str]:
    return function.__module__, function.__qualname__


def _named(module: str, name: str, unwrapped: bool):
    found = getattr(import_module(module), name)
    return inspect.unwrap(found) if unwrapped else found


def get(way: str, folder: Path) -> dict[str, float]:
    """Seconds until all programs are there, and the memory maps that they take."""
    asked = pickle.loads((folder / "asked.pickle").read_bytes())
    if way == "exported, xla cached":
        jax.config.update("jax_compilation_cache_dir", str(folder / "xla"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jax.block_until_ready(jax.numpy.zeros(1))
    maps = _maps()
    start = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        jobs = []
        for number, (function, args) in enumerate(asked):
            if way.startswith("exported"):
                path = folder / f"{number}.export"
                job = pool.submit(_exported, path, args).result
            else:
                how = {"keep": way == "kept", "pool": pool, **function.keywords}
                job = compile_ahead(function.func, *args, **how)._compiled
            jobs.append(job)
        for job in jobs:
            job()
    return {"seconds": time.perf_counter() - start, "maps": _maps() - maps}


def _maps() -> int:
    """Memory maps of this process; Linux only."""
    maps = Path("/proc/self/maps")
    return len(maps.read_bytes().splitlines()) if maps.exists() else 0


def _exported(path: Path, args) -> jax.stages.Compiled:
    call = export.deserialize(bytearray(path.read_bytes())).call
    options = _programs.compiler_options("cpu")
    lowered = jax.jit(call, compiler_options=options).lower(*jax.tree.leaves(args))
    return lowered.compile()


def fresh(folder: Path, way: str) -> dict[str, float]:
    """What a process of its own says."""
    command = [
        sys.executable,
        "-m",
        "experiments.bench.bench_programs",
        "--way",
        way,
        "--folder",
        str(folder),
    ]
    environment = {**os.environ, "JFSF_CACHE": str(folder / "jfsf")}
    done = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, env=environment
    )
    return json.loads(done.stdout.splitlines()[-1])


def _megabytes(files) -> float:
    return sum(file.stat().st_size for file in files) / 1e6


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_programs.json")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--way", help="of a process that this script starts")
    parser.add_argument("--folder", type=Path, help="the same")
    args = command_line.parse(parser)
    if args.way == "record":
        record(args.folder)
        print({})
        return
    if args.way:
        print(json.dumps(get(args.way, args.folder)))
        return
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        fresh(folder, "record")
        fresh(folder, "exported, xla cached")  # fills that cache
        programs = len(pickle.loads((folder / "asked.pickle").read_bytes()))
        found: dict[str, list[dict]] = {way: [] for way in WAYS}
        for _ in range(args.repeats):
            for way in WAYS:
                found[way].append(fresh(folder, way))
        megabytes = {
            "kept": _megabytes(folder.glob("jfsf/programs/*")),
            "exported": _megabytes(folder.glob("*.export")),
            "xla": _megabytes(folder.glob("xla/*")),
        }
    rows = {}
    for way, runs in found.items():
        t = [run["seconds"] for run in runs]
        rows[way] = {
            "median": float(np.median(t)),
            "fastest": min(t),
            "slowest": max(t),
        }
        rows[way]["maps"] = runs[-1]["maps"]
    for way, row in rows.items():
        print(f"{way:21s} {row['median']:.2f} s", end=" ")
        print(f"({row['fastest']:.2f} to {row['slowest']:.2f}), {row['maps']} maps")
    print({name: round(size, 1) for name, size in megabytes.items()})
    settings = {
        "pair": PAIR,
        "repeats": args.repeats,
        "match_settings": jfsf.Settings().as_record(),
        "seed": None,
    }
    results_file.write(
        args.out, settings=settings, programs=programs, rows=rows, megabytes=megabytes
    )


if __name__ == "__main__":
    main()
