"""Run methods over pairs, one line a result, so that a killed run can go on.

Each result is appended to OUT.jsonl as soon as it is there; OUT.json and OUT.md, the
means, are written at the end from all of them.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from experiments import command_line, results_file
from experiments.accuracy import datasets
from jfsf.convert import HasMaps
from jfsf.evaluate import (
    evaluate,
    laplacian_commutativity,
    orthogonality,
    spectral_chamfer,
    zoomout_energy,
)
from jfsf.spectral import embeddings, functional_map, spectrum
from jfsf.spectral._laplacian import operators
from jfsf.types import Spectrum

GEOMETRIC = ("error", "bijectivity", "coverage", "smoothness")
FUNCTIONAL = ("orthogonality", "laplacian", "zoomout_energy", "chamfer")
TIMES_1000 = ("error", "bijectivity")
QUICK = 4.0  # seconds


class Pair(NamedTuple):
    """Two shapes and their spectra. Methods must not read the ground truth."""

    x: datasets.Shape
    y: datasets.Shape
    spec_x: Spectrum
    spec_y: Spectrum


Method = Callable[[Any], HasMaps]
# (names, pair) -> argument of the methods of a pair; its time is not measured.
Prepare = Callable[[tuple[str, str], Pair], Any]


def arguments(about: str | None, methods: dict[str, Method], out: str):
    """The options that every table has; `out` is the file that is written."""
    parser = command_line.parser(about, out=out)
    datasets.add_arguments(parser)
    parser.add_argument(
        "--methods", nargs="+", choices=methods, default=list(methods), metavar="METHOD"
    )
    parser.add_argument("--every", type=int, default=20, help="points: 1 in N")
    return parser


def run(
    args: argparse.Namespace,
    methods: dict[str, Method],
    prepare: Prepare,
    *,
    k: int,
    functional: bool,
    quick: float = QUICK,
) -> None:
    """Measure each of args.methods on each pair, but for what OUT.jsonl holds already.

    Args:
        args: of `arguments`.
        methods: name -> function of what `prepare` returns.
        prepare: called once a pair.
        k: eigenpairs a shape.
        functional: measure the functional metrics too, at k.
    """
    pairs = datasets.pairs(args)
    settings = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in vars(args).items()
        if name not in ("out", "data", "methods", "pairs", "spread")
    }
    settings["data"] = "embedded" if args.embedded else args.data[0].name
    lines = args.out.with_suffix(".jsonl")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    done = _resume(lines, settings)
    console = Console()
    bar = Progress(
        BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=console
    )
    with bar, lines.open("a") as file:
        task = bar.add_task("", total=len(pairs) * len(args.methods))
        for names in pairs:
            missing = [m for m in args.methods if (*names, m) not in done]
            bar.advance(task, len(args.methods) - len(missing))
            if not missing:
                continue
            pair = load_pair(args, names, k)
            shared = prepare(names, pair)
            measure = _Measure(pair, args.every, functional)
            for method in missing:
                maps, seconds = _timed(methods[method], shared, quick)
                row = {"x": names[0], "y": names[1], "method": method}
                row |= {**measure(maps), "seconds": seconds}
                # One write a line: a killed run leaves at most its last line torn.
                file.write(json.dumps(row) + "\n")
                file.flush()
                os.fsync(file.fileno())
                done[(*names, method)] = row
                bar.advance(task)
            errors = (f"{m} {done[(*names, m)]['error']:.4f}" for m in args.methods)
            console.print(f"{names[0]} {names[1]}  " + "  ".join(errors), style="dim")
    rows = [done[(*names, m)] for names in pairs for m in args.methods]
    means = summary(rows, args.methods)
    results_file.write(
        args.out, settings=settings, pairs=len(pairs), means=means, rows=rows
    )
    text = markdown(means)
    args.out.with_suffix(".md").write_text(text)
    console.print(text, markup=False)


def summary(rows: list[dict], methods: list[str]) -> dict[str, dict[str, float]]:
    """Mean of every metric over the pairs, and the median of error and seconds."""
    means = {}
    for method in methods:
        mine = [row for row in rows if row["method"] == method]
        names = [name for name in mine[0] if name not in ("x", "y", "method")]
        means[method] = {n: float(np.mean([row[n] for row in mine])) for n in names}
        for name in ("error", "seconds"):
            median = float(np.median([row[name] for row in mine]))
            means[method][f"{name}_median"] = median
    return means


def markdown(means: dict[str, dict[str, float]]) -> str:
    """One row a method."""
    first = next(iter(means.values()))
    columns = [c for c in (*GEOMETRIC, *FUNCTIONAL) if c in first]
    columns += ["error_median", "seconds_median"]
    shown = {c: f"{c.replace('_', ' ')} x1000" for c in (*TIMES_1000, "error_median")}
    shown["coverage"] = "coverage %"
    head = ["method", *(shown.get(c, c.replace("_", " ")) for c in columns)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for method, mean in means.items():
        scaled = (
            mean[c] * (1000 if "x1000" in shown.get(c, "") else 1)
            if c != "coverage"
            else 100 * mean[c]
            for c in columns
        )
        lines.append(f"| {method} | " + " | ".join(f"{v:.4g}" for v in scaled) + " |")
    return "\n".join(lines) + "\n"


class _Measure:
    """Measures maps of one pair; the Laplacian of X is computed once."""

    def __init__(self, pair: Pair, every: int, functional: bool):
        self.pair, self.functional = pair, functional
        stiffness_x, _ = operators(pair.x.mesh)
        self.options = {
            "truth": (pair.x.truth, pair.y.truth),
            "every": every,
            "only": ("error", "bijectivity_x", "coverage_xy", "smoothness"),
            "operators_x": (stiffness_x, np.asarray(pair.spec_x.mass)),
            "operators_y": (None, np.asarray(pair.spec_y.mass)),
        }

    def __call__(self, maps: HasMaps) -> dict[str, float]:
        x, y, spec_x, spec_y = self.pair
        figures = evaluate(maps, x.mesh, y.mesh, **self.options)
        row = {
            "error": figures.error_mean,
            "bijectivity": figures.bijectivity_x,
            "coverage": figures.coverage_xy,
            "smoothness": figures.smoothness,
        }
        if self.functional:
            C_yx = functional_map(maps.T_xy, spec_x, spec_y)
            aligned = embeddings(C_yx, spec_x.evecs, spec_y.evecs)
            values = (
                orthogonality(C_yx),
                laplacian_commutativity(C_yx, spec_x.evals, spec_y.evals),
                zoomout_energy(C_yx),
                spectral_chamfer(*aligned),
            )
            row |= dict(zip(FUNCTIONAL, map(float, values), strict=True))
        return row


def true_functional_map(pair: Pair) -> Float[Array, "k k"]:
    """C_yx of the ground truth: least squares over the template points."""
    on_x, on_y = pair.spec_x.evecs[pair.x.truth], pair.spec_y.evecs[pair.y.truth]
    return jnp.linalg.lstsq(on_x, on_y)[0]


def true_embeddings(pair: Pair):
    """The ground truth's functional map as aligned embeddings, adjoint (eq. 5)."""
    C_yx = true_functional_map(pair)
    return embeddings(C_yx, pair.spec_x.evecs, pair.spec_y.evecs)


def load_pair(args: argparse.Namespace, names: tuple[str, str], k: int) -> Pair:
    """Both shapes, with spectra of k eigenpairs in float32."""
    x, y = datasets.load_pair(args, *names)
    specs = (spectrum(shape.mesh, k) for shape in (x, y))
    single = (jax.tree.map(_float32, spec) for spec in specs)
    return Pair(x, y, *(jax.tree.map(jnp.asarray, spec) for spec in single))


def _timed(method: Method, shared, quick: float) -> tuple[HasMaps, float]:
    """The maps and the seconds; where quick, of a second call: the first compiles."""
    start = time.perf_counter()
    maps = jax.block_until_ready(method(shared))
    seconds = time.perf_counter() - start
    if seconds > quick:
        return maps, seconds
    start = time.perf_counter()
    jax.block_until_ready(method(shared))
    return maps, time.perf_counter() - start


def _float32(values):
    values = np.asarray(values)
    return values.astype(np.float32) if values.dtype.kind == "f" else values


def _resume(lines: Path, settings: dict) -> dict[tuple[str, str, str], dict]:
    """Results of an earlier run, by pair and method; a torn last line is dropped."""
    text = lines.read_text(encoding="utf-8") if lines.exists() else ""
    if "\n" not in text:
        lines.write_text(json.dumps({"settings": settings}) + "\n", encoding="utf-8")
        return {}
    head, *rest = text.splitlines(keepends=True)
    before = json.loads(head)["settings"]
    if before != settings:
        changed = sorted(k for k in settings if before.get(k) != settings[k])
        raise SystemExit(
            f"{lines}: was begun with other settings ({', '.join(changed)}); give "
            "another --out or delete it"
        )
    if rest and not rest[-1].endswith("\n"):
        rest.pop()
        part = lines.with_suffix(".part")
        part.write_text(head + "".join(rest))
        part.replace(lines)
    rows = map(json.loads, rest)
    return {(row["x"], row["y"], row["method"]): row for row in rows}
