"""Conversion side by side: the filter, nearest neighbour, and their rivals.

All take turns in one run, so that a busy moment slows all alike. Tiles are made before,
once a shape, as `jfsf.match` does; their seconds are a row of their own. On the
authors' pair with --data (6890 vertices, errors Euclidean / sqrt(area)), on two
embedded shapes without (some 5000, geodesic errors).

    python -m experiments.bench.bench_filter [--data FOLDER] [--out RESULT.json]
"""

import time
from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments import command_line, results_file
from experiments.bench import numpy_filter
from experiments.paper import authors_pair
from jfsf import data
from jfsf.array import matmul
from jfsf.convert import nearest, sinkhorn
from jfsf.evaluate import geodesic_error
from jfsf.matching import Settings
from jfsf.neighbours import NeighbourSearch
from jfsf.neighbours._tiles import tiles_of_pair
from jfsf.spectral import spectrum

NAMES = ("man_walk", "man_up")
EVERY = 10  # one in so many template points is measured
OURS, RIVAL = "jfsf sinkhorn", "numpy filter"


def interleave(contestants: dict[str, Callable], repeats: int) -> dict[str, dict]:
    """Seconds of each: its first call, and the median of `repeats` rounds of all.

    A contestant returns when its result is there.
    """
    times = {name: [_seconds(run)] for name, run in contestants.items()}
    for _ in range(repeats):
        for name, run in contestants.items():
            times[name].append(_seconds(run))
    return {
        name: {
            "cold": cold,
            "warm": float(np.median(warm)),
            "fastest": min(warm),
            "slowest": max(warm),
        }
        for name, (cold, *warm) in times.items()
    }


def embedded(k: int, x: str, y: str):
    """Spectra, aligned embeddings in float64, and the error of a map.

    Of two embedded shapes, aligned by their ground truth.

    The functional map is the least squares one over X's vertices with a partner.
    """
    one, two = data.load(x), data.load(y)
    spec_x, spec_y = spectrum(one.mesh, k), spectrum(two.mesh, k)
    seen, at = np.unique(one.template_to_vertex, return_index=True)
    root = np.sqrt(spec_x.mass[seen])[:, None]
    image = spec_y.evecs[two.template_to_vertex[at]]
    C_yx = np.linalg.lstsq(root * spec_x.evecs[seen], root * image)[0]

    def error(T_xy) -> float:
        gt = (s.template_to_vertex[::EVERY] for s in (one, two))
        return float(geodesic_error(T_xy, two.mesh, *gt).mean())

    return (spec_x, spec_y), (spec_x.evecs @ C_yx, np.asarray(spec_y.evecs)), error


@jax.jit
def product(emb_x, emb_y):
    """All products and the largest in each row: no dense search takes less."""
    return matmul(emb_x, emb_y.T).max(1)


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_filter.json", data="optional")
    parser.add_argument("--embedded", action="store_true", help="even if there is data")
    parser.add_argument("--k", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=7)
    args = command_line.parse(parser)
    if args.data is None or args.embedded:
        what = f"embedded {NAMES[0]} to {NAMES[1]}, geodesic errors"
        specs, wide, error = embedded(args.k, *NAMES)
    else:
        what = "the authors' pair, Euclidean errors"
        pair = authors_pair.load(args.data)
        specs, wide = (pair.spec_x, pair.spec_y), authors_pair.embedded(pair, args.k)
        error = lambda T_xy: authors_pair.measure(pair, T_xy, T_xy)["error"]

    narrow = tuple(x.astype(np.float32) for x in wide)
    ours = tuple(map(jnp.asarray, narrow))
    specs = jax.tree.map(jnp.asarray, specs)
    make_tiles = jax.jit(tiles_of_pair)
    tiles = make_tiles(*specs)
    finished = lambda f, *args: jax.block_until_ready(f(*args))
    searched = lambda search: partial(finished, partial(sinkhorn, search=search), *ours)
    approximate = NeighbourSearch(settings=Settings().neighbours)
    converters = {
        OURS: partial(finished, sinkhorn, *ours),
        "jfsf sinkhorn, approximate": searched(approximate),
        "jfsf sinkhorn among tiles": searched(NeighbourSearch(tiles)),
        "jfsf nearest": partial(finished, nearest, *ours),
        RIVAL: partial(numpy_filter.fast_sinkhorn, *wide),
        "sklearn nearest": partial(numpy_filter.nearest, *wide),
        "sklearn nearest float32": partial(numpy_filter.nearest, *narrow),
    }
    bare = {
        "two products with row maxima": lambda: (
            finished(product, *ours),
            finished(product, *ours[::-1]),
        ),
        "jfsf tiles of both shapes": partial(finished, make_tiles, *specs),
    }
    sizes = [len(emb) for emb in wide]
    print(f"{what}: {sizes[0]} and {sizes[1]} vertices, k = {args.k}")
    rows = interleave({**converters, **bare}, args.repeats)
    for name, run in converters.items():
        # Both kinds of result begin with T_xy.
        rows[name]["error"] = error(np.asarray(run()[0]))
    for name, row in rows.items():
        row["over_ours"] = row["warm"] / rows[OURS]["warm"]
        shown = f"error {row['error']:.5f}" if "error" in row else ""
        print(
            f"{name:30s} warm {row['warm']:.3f} s ({row['fastest']:.3f} to "
            f"{row['slowest']:.3f}), cold {row['cold']:.2f} s, "
            f"{row['over_ours']:.2f} x ours {shown}"
        )
    settings = {
        "data": what,
        "vertices": sizes,
        "k": args.k,
        "repeats": args.repeats,
        "seed": None,
        "precision": "float32, numpy's float64 unless it says otherwise",
        "both ways": "every row converts both ways",
    }
    results_file.write(args.out, settings=settings, rows=rows)


def _seconds(run: Callable) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
