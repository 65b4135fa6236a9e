"""The unbalanced filter beside the filter: seconds, updates, and what a half keeps.

Two samples of one smooth surface in k dimensions, of X all and of Y one half, with the
same mass a point. Both filters take turns in one run, warm.

    python experiments/bench_unbalanced.py [--sizes 5000 20000] [--out RESULT.json]
"""

import argparse
from functools import partial
from pathlib import Path

import bench_filter
import device_option
import jax
import jax.numpy as jnp
import numpy as np
import results_file

from jfsf.convert import sinkhorn

WAYS = {"24 updates": {}, "tol 0.01": {"tol": 0.01}}
SEED = 0


def main() -> None:
    parser = argparse.ArgumentParser(description="The unbalanced filter, timed.")
    parser.add_argument("--sizes", type=int, nargs="+", default=[5000, 20000])
    parser.add_argument("--k", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=7)
    out = Path(__file__).parent / "results" / "bench_unbalanced.json"
    parser.add_argument("--out", type=Path, default=out)
    args = device_option.parse(parser)
    if args.repeats < 5:
        parser.error("medians of fewer than five say little")
    rows = [row for n in args.sizes for row in timed(n, args.k, args.repeats)]
    settings = {
        "k": args.k,
        "repeats": args.repeats,
        "seed": SEED,
        "dtype": "float32",
        "vertices": "n of X, n / 2 of Y",
    }
    results_file.write(args.out, settings=settings, rows=rows)


def timed(n: int, k: int, repeats: int):
    """Rows of one size."""
    (at_x, emb_x), (_, emb_y) = surface(n, k)
    masses = [jnp.full(len(emb), 1 / n, jnp.float32) for emb in (emb_x, emb_y)]
    half = at_x[:, 0] < 0
    for way, options in WAYS.items():
        runs = {
            "sinkhorn": partial(sinkhorn, emb_x, emb_y, **options),
            "unbalanced_sinkhorn": partial(
                sinkhorn, emb_x, emb_y, *masses, reach=3.0, **options
            ),
        }
        finished = {
            name: lambda run=run: jax.block_until_ready(run())
            for name, run in runs.items()
        }
        times = bench_filter.interleave(finished, repeats)
        for name, run in runs.items():
            found = run()
            row = {
                "n": n,
                "way": way,
                "filter": name,
                **times[name],
                "updates": int(found.num_iters),
                "marginal_error": float(found.marginal_error),
            }
            if name != "sinkhorn":
                kept = np.asarray(found.membership_x)
                row["kept_by_the_shared_half"] = float(kept[half].mean())
                row["kept_by_the_other_half"] = float(kept[~half].mean())
            print(*row.values(), flush=True)
            yield row


def surface(n: int, k: int):
    """Parameters and points of n samples of a surface, and of n / 2 of its half."""
    rng = np.random.default_rng(SEED)
    waves, phase = 2 * rng.normal(size=(2, k)), rng.uniform(0, 6, k)
    for size, most in ((n, 1), (n // 2, 0)):
        at = np.stack([rng.uniform(-1, most, size), rng.uniform(-1, 1, size)], 1)
        yield at, jnp.asarray(np.sin(at @ waves + phase), jnp.float32)


if __name__ == "__main__":
    main()
