"""Seconds to compile `match`, program by program, with nothing kept from before.

A program is traced (Python to jaxpr), lowered (to StableHLO), and compiled by XLA with
the options that `match` uses. One at a time; `match` compiles them side by side while
it computes spectra.

    python experiments/bench_compile.py [--vertices 5120] [--out RESULT.json]
"""

import argparse
import time
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import results_file

import jfsf
from jfsf.pipeline import run_stages
from jfsf.storage import large_jit
from jfsf.types import Spectrum


def shapes(k: int, n: int) -> Spectrum:
    """A closed mesh of n vertices, without its values."""
    return jax.eval_shape(
        lambda: Spectrum(
            jnp.zeros(k),
            jnp.zeros((n, k)),
            jnp.zeros(n),
            jnp.zeros((2 * n, 3), jnp.int32),
            jnp.zeros((n, 3)),
        )
    )


def measure(rows: list[dict], stage: partial, *args):
    """Shapes of the stage's results; its seconds are appended to `rows`."""
    name = stage.func.__name__.strip("_")
    start = time.perf_counter()
    traced = large_jit(stage, jax.default_backend()).trace(*args)
    at_trace = time.perf_counter()
    lowered = traced.lower()
    at_lower = time.perf_counter()
    compiled = lowered.compile()
    end = time.perf_counter()
    row = {
        "program": name,
        "trace": at_trace - start,
        "lower": at_lower - at_trace,
        "compile": end - at_lower,
        "instructions": (compiled.as_text() or "").count(" = "),
    }
    rows.append(row)
    print(
        f"{name:20s} traced {row['trace']:5.2f} s, lowered {row['lower']:5.2f} s, "
        f"compiled {row['compile']:6.2f} s, {row['instructions']} instructions",
        flush=True,
    )
    return jax.eval_shape(stage, *args)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vertices", type=int, default=5120, help="of both shapes")
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent / "results/bench_compile.json"
    )
    args = parser.parse_args()
    settings = jfsf.Settings()
    rows: list[dict] = []
    spec = shapes(settings.k, args.vertices)
    run = partial(measure, rows)

    def run_sides(stage, x, y):
        del y  # one program serves both
        found = run(stage, *x)
        return found, found

    def all_starts(attempt, first, others, confident):
        del confident
        found = attempt(first)
        for make in others:
            make()
        return found

    sign = jax.ShapeDtypeStruct((), jnp.int32)
    run_stages(
        *(spec, spec, None, None, None, sign, False),
        settings=settings,
        run=run,
        run_sides=run_sides,
        most_confident=all_starts,
        most_promising=lambda promise, starts, num: starts,
    )
    steps = "trace", "lower", "compile"
    total = {step: sum(row[step] for row in rows) for step in steps}
    print({step: round(seconds, 2) for step, seconds in total.items()})
    results_file.write(
        args.out,
        settings={
            "vertices": args.vertices,
            "match_settings": settings.as_record(),
            "seed": None,
        },
        rows=rows,
        total=total,
    )


if __name__ == "__main__":
    main()
