"""Pairs that were once mapped wrong in silence, and what is said of them now.

Each row of `SITUATIONS` makes some pairs, says what is to be seen, and is run with the
defaults. The shapes are made from the embedded bodies or from formulas
(`situation_shapes.py`), so anyone can run all of it:

    python -m experiments.accuracy.situations [NAME ...] [--pairs N] [--out JSON]

Prints a line a pair, and writes results/situations.json: of each pair the error (mean
geodesic, over sqrt(area)), the confidence, the warnings, and whether that is as
expected; of each situation how many are. Rows of the file that are not run again stay.
"""

import json
import time
from collections.abc import Callable
from itertools import permutations
from typing import Any, NamedTuple

import jax
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import protocol
from experiments.accuracy.situation_shapes import (
    Case,
    Known,
    ball,
    block,
    dome,
    ellipsoid,
    face,
    kidney,
    mirrored,
    pair,
    swollen,
    torus,
    tube,
)
from jfsf import data
from jfsf.apps.report._words import warnings_of
from jfsf.evaluate import geodesic_error
from jfsf.testing import mirror

DOUBTFUL = 0.7  # a map below this confidence is in doubt, as the words say
POINTS, SEED = 250, 0  # of the ground truth, at most
MIRROR, RIVALS = "mirror image fits far better", "fit equally well"
Row = dict[str, Any]


class Situation(NamedTuple):
    """A kind of pairs.

    what: in a phrase.
    pairs: makes so many cases, or as many as there are.
    expected: whether a row is as it is to be.
    """

    what: str
    pairs: Callable[[int], list[Case]]
    expected: Callable[[Row], bool]


def spread_pairs(number: int) -> list[tuple[str, str]]:
    """Pairs of embedded bodies, evenly spread."""
    every = list(permutations(data.names(), 2))
    at = np.linspace(0, len(every) - 1, min(number, len(every))).round().astype(int)
    return [every[i] for i in at]


def bodies(number: int, mirror: bool) -> list[Case]:
    """Bodies with a swollen arm."""
    side = mirrored if mirror else lambda known: known
    return [
        pair(f"{x} {y}", swollen(x), side(swollen(y))) for x, y in spread_pairs(number)
    ]


def plain(number: int) -> list[Case]:
    """Bodies as they are."""

    def known(name):
        mesh, vertex = data.load(name)
        return Known(mesh, vertex, mesh.vertices[vertex])

    return [pair(f"{x} {y}", known(x), known(y)) for x, y in spread_pairs(number)]


def bones(number: int) -> list[Case]:
    """Thigh bones, of other proportions and meshes, left and right."""
    cases = []
    for i in range(number):
        rng = np.random.default_rng(i)
        made = [
            ball(tube(rng.uniform(5, 6.5), rng.uniform(0.5, 0.7), 1.2), n, rng)
            for n in (1500, 1300)
        ]
        cases.append(Case(f"bone {i}", made[0], mirror(made[1])))
    return cases


def faces(number: int) -> list[Case]:
    """Faces of the embedded bodies, turned at random and remeshed."""
    return [
        pair(f"{x} {y}", face(x, 2 * i), face(y, 2 * i + 1))
        for i, (x, y) in enumerate(spread_pairs(number))
    ]


def symmetric(number: int) -> list[Case]:
    """Surfaces with symmetries, two meshes of each."""
    makers = {
        "sphere": lambda n, rng: ball(ellipsoid(1, 1, 1), n, rng),
        "ellipsoid": lambda n, rng: ball(ellipsoid(1, 1.3, 1.7), n, rng),
        "spheroid": lambda n, rng: ball(ellipsoid(1, 1, 2), n, rng),
        "tube": lambda n, rng: ball(tube(5), n, rng),
        "torus": lambda n, rng: torus(0.4, n // 50, 50, rng),
        "dome": lambda n, rng: dome(0.5, n, rng),
    }
    cases = []
    for i in range(number):
        name, make = list(makers.items())[i % len(makers)]
        rng = np.random.default_rng(i)
        cases.append(Case(f"{name} {i}", make(1500, rng), make(1300, rng)))
    return cases


def unrelated(number: int) -> list[Case]:
    """Shapes that have nothing in common."""
    rng = np.random.default_rng(0)
    body = [data.load(name).mesh for name in ("man_walk", "child_t", "woman_up")]
    made = {
        "kidney": ball(kidney, 1500, rng),
        "bone": ball(tube(6, 0.6, 1.2), 1500, rng),
        "ellipsoid": ball(ellipsoid(1, 1.3, 1.7), 1500, rng),
        "tube": ball(tube(5), 1500, rng),
        "torus": torus(0.4, 30, 50, rng),
        "block": ball(block, 1500, rng),
        **dict(zip(("man", "child", "woman"), body, strict=True)),
    }
    chosen = (
        *("kidney bone", "ellipsoid bone", "ellipsoid man", "tube child"),
        *("torus woman", "bone block", "man kidney", "kidney block"),
        *("bone woman", "torus kidney", "child block", "tube torus"),
    )
    names = [words.split() for words in chosen]
    return [Case(f"{x} {y}", made[x], made[y]) for x, y in names[:number]]


def not_in_silence(row: Row) -> bool:
    """Right, or in doubt."""
    return protocol.is_right(row["error"]) or row["confidence"] < DOUBTFUL


def counted(row: Row) -> bool:
    """Rivals are said, and the confidence is no more than one part; or in doubt."""
    part = 1 / (1 + (row["rivals"] or 0)) + 1e-6
    doubtful = row["confidence"] < 0.5  # a torus is not matched, which is said
    return doubtful or (row["says_rivals"] and row["confidence"] <= part)


SITUATIONS = {
    "left and right": Situation(
        "bodies with a swollen arm, one of them mirrored",
        lambda number: bodies(number, mirror=True),
        lambda row: row["says_mirror"] and row["confidence"] < DOUBTFUL,
    ),
    "left and right, bones": Situation(
        "thigh bones, one of them mirrored",
        bones,
        lambda row: row["says_mirror"] and row["confidence"] < DOUBTFUL,
    ),
    "swollen arms": Situation(
        "the same bodies, not mirrored",
        lambda number: bodies(number, mirror=False),
        lambda row: not row["says_mirror"] and not_in_silence(row),
    ),
    "bodies": Situation(
        "bodies as they are",
        plain,
        lambda row: (
            not (row["says_mirror"] or row["says_rivals"]) and not_in_silence(row)
        ),
    ),
    "symmetries": Situation(
        "surfaces with rotations or reflections",
        symmetric,
        counted,
    ),
    "faces": Situation(
        "faces, turned and remeshed",
        faces,
        not_in_silence,
    ),
    "nothing in common": Situation(
        "shapes of different kinds",
        unrelated,
        lambda row: row["confidence"] < DOUBTFUL,
    ),
}
PAIRS = {"faces": 30, "symmetries": 12, "nothing in common": 12}


def main() -> None:
    parser = command_line.parser(__doc__, out="situations.json")
    parser.add_argument("names", nargs="*", help=f"of {', '.join(SITUATIONS)}")
    parser.add_argument("--pairs", type=int, help="of each, at most; default: 20 or so")
    args = command_line.parse(parser)
    found = {}
    if args.out.exists():
        found = json.loads(args.out.read_text(encoding="utf-8"))["situations"]
    settings = jfsf.Settings().as_record()
    for name in args.names or SITUATIONS:
        found[name] = of_pairs(name, args.pairs)
        print(name, found[name]["summary"], flush=True)
        ordered = {known: found[known] for known in SITUATIONS if known in found}
        results_file.write(args.out, match_settings=settings, situations=ordered)


def of_pairs(name: str, number: int | None) -> Row:
    """The results of a situation of `SITUATIONS`."""
    own = SITUATIONS[name]
    rows = []
    for case in own.pairs(number or PAIRS.get(name, 20)):
        row = measure(case)
        row["expected"] = bool(own.expected(row))
        rows.append(row)
        print(name, "|", line(row), flush=True)
    return {"what": own.what, "summary": summary(rows), "pairs": rows}


def measure(case: Case) -> Row:
    """The row of a pair."""
    started = time.perf_counter()
    match = jax.block_until_ready(jfsf.match(case.x, case.y))
    seconds = time.perf_counter() - started
    evidence = match.certificate
    said = warnings_of(evidence, "preserve")
    error = np.nan
    if case.truth is not None:
        number = len(case.truth[0])
        some = np.random.default_rng(SEED).permutation(number)[:POINTS]
        at_x, at_y = (side[some] for side in case.truth)
        away = geodesic_error(np.asarray(match.T_xy), case.y, at_x, at_y)
        error = float(np.mean(away))
    figures = {name: float(value) for name, value in evidence.figures().items()}
    row = {"name": case.name, "error": error, "seconds": seconds, **figures}
    row["attempts"] = len(match.info.source)  # type: ignore[union-attr]
    row["says_mirror"] = any(MIRROR in text for text in said)
    row["says_rivals"] = any(RIVALS in text for text in said)
    row["says"] = said
    return {k: None if v != v else v for k, v in row.items()} | {"error": error}


def line(row: Row) -> str:
    """A row in short."""
    number = lambda name: np.nan if row[name] is None else row[name]
    return (
        f"{row['name']}: error {row['error']:.3f} confidence {number('confidence'):.3f}"
        f" share {number('share'):.2f} rivals {number('rivals'):.0f} mirror gap "
        f"{number('mirror_gap'):+.2f} mirrored {number('mirrored'):.2f} attempts "
        f"{row['attempts']} {row['seconds']:.1f} s"
        f"{'' if row['expected'] else '  NOT AS EXPECTED'}"
    )


def summary(rows: list[Row]) -> Row:
    """Counts of a situation."""
    errors = np.array([row["error"] for row in rows])
    sure = np.array([(row["confidence"] or 0) >= DOUBTFUL for row in rows])
    wrong = errors >= protocol.RIGHT
    known = bool(np.isfinite(errors).any())
    return {
        "pairs": len(rows),
        "as_expected": sum(row["expected"] for row in rows),
        "mean_error": float(np.nanmean(errors)) if known else None,
        "wrong": int(wrong.sum()) if known else None,
        "wrong_sure": int((wrong & sure).sum()) if known else None,
        "sure": int(sure.sum()),
        "seconds_median": float(np.median([row["seconds"] for row in rows])),
    }


if __name__ == "__main__":
    main()
