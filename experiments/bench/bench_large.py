"""Time and memory of the search for neighbours against n: exhaustive, cold and warm.

Two embedded shapes, upsampled (`upsample.py`; below their own size, a strided choice of
vertices), aligned by their ground truth with k eigenfunctions. Cold makes the tiles
first; warm, as inside a refinement, has them. The exhaustive search of many points is
timed on a sample of rows, and scaled. Memory is what the compiled program asks for:
arguments, results and temporaries.

For comparison: the numpy filter with the authors' settings, scikit-learn's nearest
neighbour both ways (the search inside pyFM), POT's dense Sinkhorn with as many updates,
and two products with row maxima, below which no exhaustive search goes; each up to the
size at which it takes seconds.

    python -m experiments.bench.bench_large [--sizes 1000 10000 ...] [--out RESULT.json]
"""

from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import ot

from experiments import command_line, results_file
from experiments.bench import numpy_filter
from experiments.bench.bench_filter import interleave, product
from experiments.bench.upsample import upsample
from jfsf import data
from jfsf.apps.plot._charts import Panel, draw_curves
from jfsf.convert import sinkhorn
from jfsf.neighbours import NeighbourSearch, neighbours, spectral_tiles
from jfsf.neighbours._among_tiles import tiled_neighbours
from jfsf.neighbours._both_ways import mutual_neighbours
from jfsf.spectral import spectrum

NAMES = ("man_walk", "woman_up")
K0 = 10
SAMPLE = 2048  # rows of an exhaustive search that is scaled, and of the recall
WHOLE = 20_000  # points up to which it is run in full
EXPONENT_FROM = 10_000
RIVALS = 10_000  # points up to which numpy and scikit-learn run
DENSE = 2000  # points up to which POT's matrices do
UPDATES = 24
LABELS = {
    "exhaustive": "ours: k0 nearest, exhaustive",
    "one product": "ours: k0 nearest, one product both ways",
    "cold": "ours: k0 nearest, tiles made anew",
    "warm": "ours: k0 nearest, tiles",
    "sinkhorn, exhaustive": "ours: Sinkhorn",
    "sinkhorn, warm": "ours: Sinkhorn, tiles",
    "products": "two bare products with row maxima",
    "sklearn nearest": "scikit-learn (pyFM): nearest",
    "numpy filter": "numpy: Sinkhorn, authors' settings",
    "POT dense Sinkhorn": "POT: dense Sinkhorn",
}


def aligned(n: int, k: int):
    """Spectra of about n vertices and their embeddings by ground truth, float32."""
    specs, truth = [], []
    for name in NAMES:
        sample = data.load(name)
        mesh = upsample(sample.mesh, max(n, len(sample.mesh.vertices)))
        specs.append(spectrum(mesh, k))
        truth.append(sample.template_to_vertex)
    seen, at = np.unique(truth[0], return_index=True)
    root = np.sqrt(specs[0].mass[seen])[:, None]
    image = specs[1].evecs[truth[1][at]]
    C_yx = np.linalg.lstsq(root * specs[0].evecs[seen], root * image)[0]
    some = [np.linspace(0, len(s.mass) - 1, n).astype(int) for s in specs]
    specs = [
        s._replace(evecs=s.evecs[at], mass=s.mass[at], vertices=s.vertices[at])
        for s, at in zip(specs, some, strict=True)
    ]
    specs = [
        jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), s._replace(faces=s.faces))
        for s in specs
    ]
    return specs, specs[0].evecs @ jnp.asarray(C_yx, jnp.float32), specs[1].evecs


def megabytes(function, *args, **options) -> float:
    """Memory of the compiled program: arguments, results and temporaries."""
    found = function.lower(*args, **options).compile().memory_analysis()
    size = found.argument_size_in_bytes + found.output_size_in_bytes
    return (size + found.temp_size_in_bytes) / 1e6


def rivals(x, y) -> dict:
    """Other programs that convert both ways; all but the products in float64."""
    found = {"products": lambda: jax.block_until_ready((product(x, y), product(y, x)))}
    wide = np.asarray(x, np.float64), np.asarray(y, np.float64)
    if len(x) <= RIVALS:
        found["sklearn nearest"] = partial(numpy_filter.nearest, *wide)
        found["numpy filter"] = partial(numpy_filter.fast_sinkhorn, *wide)
    if len(x) <= DENSE:
        mass = np.full(len(x), 1 / len(x))

        def dense():
            cost = np.asarray(ot.dist(*wide, metric="euclidean"))
            sharp = 120 / np.median(cost.min(1))
            options = {"numItermax": UPDATES, "stopThr": 0, "warn": False}
            return ot.bregman.sinkhorn_log(mass, mass, cost, 1 / sharp, **options)

        found["POT dense Sinkhorn"] = dense
    return found


def measure(n: int, k: int, repeats: int) -> dict:
    (spec_x, spec_y), x, y = aligned(n, k)
    tiles = spectral_tiles(spec_x), spectral_tiles(spec_y)
    search = NeighbourSearch(tiles)
    rows = jnp.asarray(np.random.default_rng(0).permutation(n)[:SAMPLE])
    whole = n <= WHOLE
    tiled = partial(tiled_neighbours, x, y, k0=K0)

    def exhaustive():
        if whole:
            return neighbours(x, y, k0=K0), neighbours(y, x, k0=K0)
        return neighbours(x[rows], y, k0=K0), neighbours(y[rows], x, k0=K0)

    def cold():
        return tiled(spectral_tiles(spec_x), spectral_tiles(spec_y))

    runs = {
        "exhaustive": exhaustive,
        "cold": cold,
        "warm": lambda: tiled(*tiles),
        "sinkhorn, warm": lambda: sinkhorn(x, y, search=search),
    }
    if whole:
        runs["one product"] = lambda: mutual_neighbours(x, y, k0=K0)
        runs["sinkhorn, exhaustive"] = lambda: sinkhorn(x, y)
    ready = {
        name: lambda run=run: jax.block_until_ready(run()) for name, run in runs.items()
    }
    if whole:
        ready |= rivals(x, y)
    found = interleave(ready, repeats)
    if not whole:
        for key in ("warm", "fastest", "slowest"):
            found["exhaustive"][key] *= n / len(rows)
    near = tiled(*tiles)
    exact = neighbours(x[rows], y, k0=K0).idx, neighbours(y[rows], x, k0=K0).idx
    ours = near.near_xy.idx[rows], near.near_yx.idx[rows]
    pairs = list(zip(ours, exact, strict=True))
    return {
        "n": n,
        "exhaustive_in_full": whole,
        "seconds": {name: row["warm"] for name, row in found.items()},
        "first_call": {name: row["cold"] for name, row in found.items()},
        "times_faster": {
            name: found["exhaustive"]["warm"] / found[name]["warm"] for name in found
        },
        "megabytes": {
            "warm": megabytes(tiled_neighbours, x, y, *tiles, k0=K0),
            "sinkhorn, warm": megabytes(sinkhorn, x, y, search=search),
        },
        "recall_nearest": float(
            np.mean([(a[:, 0] == b[:, 0]).mean() for a, b in pairs])
        ),
        "recall_all": float(
            np.mean([(a[:, :, None] == b[:, None]).any(2).mean() for a, b in pairs])
        ),
        "recall_reported": float(near.recall),
    }


def draw(rows: list[dict], path: Path) -> None:
    """Seconds and memory against n, both axes logarithmic."""

    def curves(unit):
        names = dict.fromkeys(name for row in rows for name in row[unit])
        seen = {name: [row for row in rows if name in row[unit]] for name in names}
        return {
            LABELS[name]: (
                [r["n"] for r in seen[name]],
                [r[unit][name] for r in seen[name]],
            )
            for name in names
        }

    sizes = [row["n"] for row in rows]
    matrix = {"one n x n matrix, float32": (sizes, [4e-6 * n**2 for n in sizes])}
    time = Panel(curves("seconds"), "vertices", "seconds, both ways", "Time", "xy")
    memory = Panel(curves("megabytes") | matrix, "vertices", "MB", "Memory", "xy")
    draw_curves([time, memory], path=path)


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_large.json")
    parser.add_argument(
        "--sizes",
        type=int,
        nargs="+",
        default=[1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000],
    )
    parser.add_argument("--k", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    rows = []
    for n in sorted(args.sizes):
        rows.append(measure(n, args.k, args.repeats))
        print(rows[-1], flush=True)
    large = [row for row in rows if row["n"] >= EXPONENT_FROM]
    exponent = {}
    if len(large) > 1:
        size = np.log([row["n"] for row in large])
        for name in ("cold", "warm", "sinkhorn, warm", "exhaustive"):
            time = np.log([row["seconds"][name] for row in large])
            exponent[name] = float(np.polyfit(size, time, 1)[0])
    print(f"exponents from {EXPONENT_FROM}: {exponent}")
    settings = {
        "pair": NAMES,
        "k": args.k,
        "k0": K0,
        "repeats": args.repeats,
        "seed": 0,
        "precision": "float32",
        "seconds": "both ways, median of warm calls",
    }
    results_file.write(args.out, settings=settings, rows=rows, exponent=exponent)
    draw(rows, args.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
