"""Whether a change of the code leaves maps of every kind as good as they were.

    python -m experiments.accuracy.guard --data ROOT --out NOW.json

Some pairs of every set of the protocol are matched, always the same ones, in about half
an hour on two quiet cores. What has changed since results/guard.json (`--before`) is
printed: maps that were right and are wrong, maps that became sure and are wrong, and
the median error of each set, where it moved by more than its noise. The exit status is
1 if anything is worse. NOW.json is written after each pair; the same command goes on
with pairs that are missing, or that another version of the library matched.

The table to compare with is made in the same way:

    python -m experiments.accuracy.guard --data ROOT --noise 3 \\
        --out experiments/results/guard.json

--noise N: the N pairs of each set that took the least time are matched twice more, with
X rotated and its vertices and faces in another order, which no map should notice. The
noise of a set is the range of the median of these pairs over the three runs. It is
measured where a pair has no such errors yet (`again`); those of a pair stay when the
pair is matched anew.
"""

import json
import time
from collections.abc import Iterable
from pathlib import Path

import jax
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import changes, datasets, match_pairs, protocol
from jfsf.apps.report._words import LIKELY
from jfsf.evaluate import geodesic_error
from jfsf.runtime._program_files import CODE
from jfsf.types import Mesh

BEFORE = command_line.RESULTS / "guard.json"
# Pairs of a set, spread over its list: more where they vary most or few are right,
# fewer of slow ones.
PAIRS = {"shrec07": 11, "creatures": 8, "tosca_iso_r": 8, "psmal": 8, "becos_pp": 7}
PAIRS |= {"becos_ff": 5, "hdm_molars": 5, "shrec20_full": 5, "mouse_skulls": 4}
PAIRS |= {"cortex_species": 3, "shrec20_partial": 3}
OTHERWISE = 6
SEEDS = 1, 2  # of the other orders
# A median moves beyond its noise by this many ranges of three runs: of equal code, with
# normal errors, 4 in 100 would.
RANGES = 3

Key = tuple[str, str, str]  # the set, X, Y
Rows = dict[Key, dict]
Pairs = dict[Key, tuple[protocol.DataSet, datasets.Pair, str]]  # with the role


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    parser.add_argument("sets", nargs="*", default=["all"], help="names, or a role")
    parser.add_argument("--before", type=Path, default=BEFORE, help="the table before")
    parser.add_argument("--noise", type=int, default=0, help="pairs a set; see above")
    args = command_line.parse(parser)
    if args.out is None:
        parser.error("give --out FILE: what is done is kept there")
    before, rows = read(args.before), read(args.out)
    sets = [protocol.below(own, args.data) for own in protocol.named(args.sets)]
    every = [(i, own, *one) for own in sets for i, one in enumerate(of(own))]
    every.sort(key=lambda one: one[0])  # the first of each set, then the second
    pairs = {
        (own.name, pair.x, pair.y): (own, pair, role) for _, own, pair, role in every
    }
    match_missing(pairs, rows, args.out)
    match_again(pairs, rows, args.noise, args.out)
    lines, worse = compared(before, {name: rows[name] for name in pairs})
    print("\n".join(lines))
    if worse:
        raise SystemExit(1)


def read(path: Path) -> Rows:
    """The rows of a table; none if there is no such file."""
    if not path.exists():
        return {}
    rows = json.loads(path.read_text(encoding="utf-8"))["pairs"]
    return {(row["set"], row["x"], row["y"]): row for row in rows}


def of(own: protocol.DataSet) -> list[tuple[datasets.Pair, str]]:
    """The pairs of a set that are matched, with their roles."""
    pairs = [(pair, own.role(i)) for i, pair in enumerate(datasets.pairs_of(own))]
    return datasets.spread(pairs, PAIRS.get(own.name, OTHERWISE))


def match_missing(pairs: Pairs, rows: Rows, out: Path) -> None:
    """Match pairs without a row of this code; rows and file grow with each."""
    for name, (own, pair, role) in pairs.items():
        before = rows.get(name, {"code": None, "again": []})
        if before["code"] != CODE:
            row = {"set": own.name, "x": pair.x, "y": pair.y, "kind": own.kind}
            row |= {"role": role, "limit": own.right} | measured(own, pair)
            rows[name] = row | {"code": CODE, "again": before["again"]}
            write(out, rows)


def match_again(pairs: Pairs, rows: Rows, most: int, out: Path) -> None:
    """Errors in other orders, until so many pairs of each set have them."""
    for some in by_set(rows[name] for name in pairs).values():
        missing = [row for row in some if not row["again"]]
        missing.sort(key=lambda row: row["seconds"])
        for row in missing[: max(0, most - len(some) + len(missing))]:
            own, pair, _ = pairs[row["set"], row["x"], row["y"]]
            found = [measured(own, pair, seed)["error"] for seed in SEEDS]
            row["again"] = [row["error"], *found]
            write(out, rows)


def measured(data_set: protocol.DataSet, pair: datasets.Pair, seed: int = 0) -> dict:
    """Error, confidence, share, and seconds of the processor; X reordered if `seed`.

    These change less than others with what else the machine does.
    """
    x, y = datasets.load_pair_of(data_set, pair)
    if seed:
        x = shuffled(x, seed)
    start = time.process_time()
    part = data_set.kind == "part"
    match = jfsf.match(x.mesh, y.mesh, partial=part, same_unit=data_set.same_unit)
    jax.block_until_ready(match)
    seconds = time.process_time() - start
    at = match_pairs.some_points(len(x.truth))
    away = geodesic_error(match.T_xy, y.mesh, x.truth[at], y.truth[at])
    figures = match.certificate.figures()
    values = {name: float(figures[name]) for name in ("confidence", "share")}
    print(f"{data_set.name} {pair.x} {pair.y} {away.mean():.4f} {values}", flush=True)
    return {"error": float(away.mean()), **values, "seconds": seconds}


def shuffled(shape: datasets.Shape, seed: int) -> datasets.Shape:
    """The same surface, rotated, with vertices and faces in another order."""
    turned = changes.changed(shape.mesh, changes.Changes(turn=True), seed).mesh
    rng = np.random.default_rng(seed)
    old = rng.permutation(len(turned.vertices))
    new = np.argsort(old).astype(np.int32)
    faces = new[rng.permutation(np.asarray(turned.faces))]
    return datasets.Shape(Mesh(turned.vertices[old], faces), new[shape.truth], None)


def right(row: dict) -> bool:
    """Whether its map is right."""
    return protocol.is_right(row["error"], row["limit"])


def sure_and_wrong(row: dict) -> bool:
    """Whether its map is wrong, and nobody would doubt it."""
    return row["confidence"] >= LIKELY and not right(row)


def noise(rows: list[dict]) -> float:
    """Range of the median error of a set over the runs; nan if there are none."""
    again = [row["again"] for row in rows if row["again"]]
    return float(np.ptp(np.median(again, 0))) if again else float("nan")


def summary(rows: list[dict]) -> dict:
    """Of some pairs."""
    return {
        "pairs": len(rows),
        "median": float(np.median([row["error"] for row in rows])),
        "wrong": sum(not right(row) for row in rows),
        "sure": sum(row["confidence"] >= LIKELY for row in rows),
        "sure_and_wrong": sum(map(sure_and_wrong, rows)),
        "noise": noise(rows),
        "seconds": sum(row["seconds"] for row in rows),
    }


def by_set(rows: Iterable[dict]) -> dict[str, list[dict]]:
    """The rows of each set."""
    found: dict[str, list[dict]] = {}
    for row in rows:
        found.setdefault(row["set"], []).append(row)
    return found


def write(path: Path, rows: Rows) -> None:
    """The file as far as it is."""
    own, every = {"pairs": PAIRS}, list(rows.values())
    found = {name: summary(some) for name, some in by_set(every).items()}
    found = {"all": summary(every), **found}
    results_file.write(path, settings=own, summary=found, pairs=every)


def compared(before: Rows, now: Rows) -> tuple[list[str], bool]:
    """What to print, and whether anything is worse. Of pairs that both have."""
    both = [name for name in now if name in before]
    lines, worse = [], False
    for name in both:
        was, row = before[name], now[name]
        told = f"{' '.join(name)}: {was['error']:.3f} -> {row['error']:.3f}, "
        told += f"confidence {was['confidence']:.2f} -> {row['confidence']:.2f}"
        if len({error < was["limit"] for error in was["again"]}) > 1:
            told += " (before, the order of the vertices decided)"
        if right(was) != right(row):
            lines.append(f"{'right to wrong' if right(was) else 'now right'}: {told}")
        if sure_and_wrong(row) and not sure_and_wrong(was):
            lines.append(f"sure and wrong: {told}")
        worse |= right(was) > right(row) or sure_and_wrong(row) > sure_and_wrong(was)
    lines.append("set              for    pairs median now    change  noise  wrong")
    for name, rows in by_set(now[name] for name in both).items():
        was = summary([before[n] for n in both if n[0] == name])
        is_now = summary(rows)
        change, spread = is_now["median"] - was["median"], was["noise"]
        beyond = abs(change) > RANGES * spread  # never where the noise is unknown
        worse |= beyond and change > 0
        lines.append(
            f"{name:<16} {rows[0]['role']:<6} {len(rows):>5} {was['median']:.4f} "
            f"{is_now['median']:.4f} {change:+.4f} {spread:.4f} {was['wrong']} -> "
            f"{is_now['wrong']}" + " beyond its noise" * beyond
        )
    total = summary(list(now.values()))
    lines.append(
        f"of {total['sure']} maps with {LIKELY} or more {total['sure_and_wrong']} are "
        f"wrong; {len(before)} pairs before, {len(now)} now, {len(both)} in both"
    )
    return lines, bool(worse)


if __name__ == "__main__":
    main()
