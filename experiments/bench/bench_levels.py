"""Seconds to compile and to run each program of `match` at XLA's optimisation levels.

A pair of embedded shapes is matched by a runner that compiles each program once a
level, with the other options of `match`, and times it on the arrays of the pair:
medians. `jfsf.runtime` takes one level for all; this says what another would cost.

    python -m experiments.bench.bench_levels [--repeats 5] [--out RESULT.json]
"""

import statistics
import time
from functools import partial

import jax

import jfsf
from experiments import command_line, results_file
from experiments.bench.bench_compile import Compiling
from jfsf import data
from jfsf.initial._start import nonisometric_starts
from jfsf.matching import _policy
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import PairState
from jfsf.runtime._programs import compiler_options
from jfsf.runtime._sizes import padded_pair

PAIR = "man_walk", "man_up"
LEVELS = 0, 1, 2, 3
LEVEL = "xla_backend_optimization_level"


class Levels(Compiling):
    """A runner that measures each program at each level; results are of the last.

    rows: a row a program and level.
    """

    def __init__(self, repeats: int) -> None:
        super().__init__()
        self.repeats = repeats

    def one(self, stage: partial, args: tuple):
        asked = stage.func, str(jax.tree.map(jax.typeof, args))
        if asked not in self.known:
            for level in LEVELS:
                self.known[asked] = self.measure(stage, args, level)
        return jax.block_until_ready(self.known[asked](*args))

    def measure(self, stage: partial, args: tuple, level: int):
        """The program at a level; its row is kept."""
        jax.clear_caches()
        lowered = jax.jit(lambda *args: stage(*args)).lower(*args)
        options = {**compiler_options(jax.default_backend()), LEVEL: level}
        start = time.perf_counter()
        program = lowered.compile(compiler_options=options)
        compiled = time.perf_counter() - start
        ran = []
        for _ in range(self.repeats + 1):
            start = time.perf_counter()
            jax.block_until_ready(program(*args))
            ran.append(time.perf_counter() - start)
        row = {"program": stage.func.__name__, "level": level}
        row |= {"compile": compiled, "run": statistics.median(ran[1:])}
        self.rows.append(row)
        print(
            f"{row['program']:20s} level {level}: compiled {compiled:6.2f} s, "
            f"runs {row['run']:6.3f} s",
            flush=True,
        )
        return program


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_levels.json")
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    settings = jfsf.Settings(retry_below=0.0)
    specs = padded_pair(*(jfsf.basis(data.load(name).mesh) for name in PAIR))
    pair, runner = PairState(specs, MatchInputs()), Levels(args.repeats)
    _policy.attempt_pairs([pair], runner, settings=settings)
    # Of a pair in doubt.
    stage = partial(nonisometric_starts, settings=settings.search)
    x, y = pair.samples
    runner.one(stage, (x.search, y.search, pair.inputs.sign, pair.inputs.self_map))
    total = [
        {"level": level}
        | {
            kind: sum(row[kind] for row in runner.rows if row["level"] == level)
            for kind in ("compile", "run")
        }
        for level in LEVELS
    ]
    for row in total:
        print({key: round(value, 2) for key, value in row.items()})
    results_file.write(
        args.out,
        settings={
            "pair": PAIR,
            "repeats": args.repeats,
            "match_settings": settings.as_record(),
        },
        rows=runner.rows,
        total=total,
    )


if __name__ == "__main__":
    main()
