"""Seconds to match parts, over those of whole shapes of the same collection.

Of each set of the protocol some pairs, spread evenly, are matched once, so that all is
compiled, then some times more; medians. Spectra are kept after the first time. Whole
shapes are those of BeCoS and of SMAL: the views and the parts are of the same bodies.

    python -m experiments.bench.bench_parts [--data ROOT] [--pairs 3] [--repeats 5]
"""

import statistics
import time

import jax

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf.apps.report._words import LIKELY

# A set of parts, and whole shapes of the same collection.
SETS = {"becos_pf": "becos_ff", "becos_pp": "becos_ff", "psmal": "smal_whole"}


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_parts.json", data=True)
    parser.add_argument("--pairs", type=int, default=3, help="of each set")
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    root = args.data
    rows = []
    for name in dict.fromkeys([*SETS, *SETS.values()]):
        data_set = protocol.below(protocol.SETS[name], root)
        for pair in datasets.spread(datasets.pairs_of(data_set), args.pairs):
            row = _row(data_set, pair, args.repeats)
            rows.append({"set": name, "x": pair.x, "y": pair.y, **row})
            print(rows[-1], flush=True)
    ratios = {name: _ratio(rows, name, whole) for name, whole in SETS.items()}
    ratios["mean"] = statistics.mean(ratios.values())
    print(ratios)
    settings = {"pairs": args.pairs, "repeats": args.repeats}
    results_file.write(args.out, settings=settings, ratios=ratios, rows=rows)


def _row(data_set: protocol.DataSet, pair: datasets.Pair, repeats: int) -> dict:
    """Seconds of one pair, warm."""
    x, y = (shape.mesh for shape in datasets.load_pair_of(data_set, pair))
    part, seconds = data_set.kind == "part", []
    found = jfsf.match(x, y, partial=part)
    for _ in range(repeats):
        start = time.perf_counter()
        found = jax.block_until_ready(jfsf.match(x, y, partial=part))
        seconds.append(time.perf_counter() - start)
    return {
        **{"vertices_x": len(x.vertices), "vertices_y": len(y.vertices)},
        "sure": bool(found.certificate.confidence >= LIKELY),
        "seconds": statistics.median(seconds),
    }


def _ratio(rows: list[dict], name: str, whole: str) -> float:
    """Mean seconds of a pair of parts over those of a whole pair without doubt.

    All whole pairs count if none of them is without doubt.
    """
    own = [row["seconds"] for row in rows if row["set"] == name]
    other = [row for row in rows if row["set"] == whole]
    sure = [row["seconds"] for row in other if row["sure"]]
    return statistics.mean(own) / statistics.mean(
        sure or [row["seconds"] for row in other]
    )


if __name__ == "__main__":
    main()
