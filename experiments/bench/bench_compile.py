"""Seconds to compile `match` and its memory, by program, with nothing kept before.

A program is traced (Python to jaxpr), lowered (to StableHLO), and compiled by XLA with
the options that `match` uses. One at a time; `match` compiles them side by side while
it computes spectra.

    python -m experiments.bench.bench_compile [--vertices 5120] [--out RESULT.json]
"""

import time
from functools import partial

import jax

import jfsf
from experiments import command_line, results_file
from jfsf.initial._start import nonisometric_starts
from jfsf.matching import _policy
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import PairState
from jfsf.runtime._programs import large_jit
from jfsf.runtime._sizes import PaddedShape, spectrum_like


class Compiling:
    """A runner that compiles each program once, and returns shapes.

    rows: the seconds of each.
    """

    def __init__(self) -> None:
        self.rows: list[dict] = []
        self.known: dict = {}

    def map(self, name, stage: partial, inputs, at_a_time=1) -> list:
        del name, at_a_time
        return [self.one(stage, args) for args in inputs]

    def one(self, stage: partial, args: tuple):
        asked = stage.func, str(jax.tree.map(jax.typeof, args))
        if asked not in self.known:
            self.known[asked] = measure(self.rows, stage, *args)
        return self.known[asked]


def measure(rows: list[dict], stage: partial, *args):
    """Shapes of the stage's results; its seconds are appended to `rows`."""
    name = stage.func.__name__
    start = time.perf_counter()
    traced = large_jit(stage, jax.default_backend()).trace(*args)
    at_trace = time.perf_counter()
    lowered = traced.lower()
    at_lower = time.perf_counter()
    compiled = lowered.compile()
    end = time.perf_counter()
    memory = compiled.memory_analysis()
    row = {
        "program": name,
        "trace": at_trace - start,
        "lower": at_lower - at_trace,
        "compile": end - at_lower,
        "instructions": (compiled.as_text() or "").count(" = "),
        # Beside arguments and results, while it runs.
        "gigabytes": round(memory.temp_size_in_bytes / 1e9, 2) if memory else None,
    }
    rows.append(row)
    print(
        f"{name:20s} traced {row['trace']:5.2f} s, lowered {row['lower']:5.2f} s, "
        f"compiled {row['compile']:6.2f} s, {row['instructions']} instructions, "
        f"memory {row['gigabytes']} GB",
        flush=True,
    )
    return jax.eval_shape(stage, *args)


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_compile.json")
    parser.add_argument("--vertices", type=int, default=5120, help="of both shapes")
    args = command_line.parse(parser)
    settings, start = jfsf.Settings(), time.process_time()
    spec = spectrum_like(PaddedShape(settings.k, args.vertices, 2 * args.vertices))
    pair, runner = PairState((spec, spec), MatchInputs()), Compiling()
    _policy.compile_first_attempt(pair, runner, settings=settings)
    # Of a pair in doubt: of its coarse copies.
    stage = partial(nonisometric_starts, settings=settings.search)
    x, y = pair.samples
    runner.one(stage, (x.search, y.search, pair.inputs.sign, pair.inputs.self_map))
    rows = runner.rows
    steps = "trace", "lower", "compile"
    total = {step: float(sum(row[step] for row in rows)) for step in steps}
    total["cpu"] = time.process_time() - start  # of all threads
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
