"""Embedded pairs with X damaged: errors, confidence and warnings of `jfsf match`.

A row of the table is a kind of damage (damages.py); some are done to both shapes, with
other random numbers. The error is measured on the clean Y, at points that are left. A
map is wrong if its mean error is above 0.1, or more than a tenth of the points end
further than 0.2 from where they belong. A wrong map without a warning is one in
silence, a right one with a warning a false alarm. With the row `clean`, each row has
the largest change of the confidence by its damage.

    python -m experiments.accuracy.damage [--rows noise_1% spikes_20] \\
        [--out RESULT.json]
"""

import zlib
from functools import partial

import jax
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import damages
from experiments.accuracy.protocol import RIGHT
from jfsf import data
from jfsf.apps.report._words import warnings_of
from jfsf.evaluate import geodesic_error

PAIRS = (
    ("man_walk", "man_up"),
    ("man_walk", "woman_up"),
    ("woman_squat", "man_kick"),
    ("child_t", "heavy_walk"),
    ("heavy_squat", "child_kick"),
)
FAR, MAX_FAR = 0.2, 0.1  # and the share of its points that may end further away
ROWS = {
    "clean": damages.clean,
    "noise_0.5%": partial(damages.noise, size=0.005),
    "noise_1%": partial(damages.noise, size=0.01),
    "noise_2%": partial(damages.noise, size=0.02),
    "noise_1%_both": partial(damages.noise, size=0.01),
    "spikes_20": partial(damages.spikes, number=20),
    "holes_5": partial(damages.holes, number=5, radius=0.08),
    "holes_20": partial(damages.holes, number=20, radius=0.04),
    "one_arm": damages.one_arm,
    "doubled_face": damages.doubled_face,
    "fin": damages.fin,
    "flipped_10": partial(damages.flipped, number=10),
    "nonmanifold_30": partial(damages.nonmanifold, edges=30),
    "half_thinned": partial(damages.half_thinned, to=0.1),
    "cloud": damages.cloud,
    "cloud_both": damages.cloud,
    "vertices_500": partial(damages.coarse, n=500),
    "vertices_200": partial(damages.coarse, n=200),
    "vertices_20000": partial(damages.fine, n=20_000),
}
BOTH = "_both"  # ends the name of a row of damage to both shapes


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS))
    parser.add_argument("--pairs", type=int, default=len(PAIRS), help="only the first")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every", type=int, default=5, help="template points: 1 in N")
    args = command_line.parse(parser)
    table, rows = {}, []
    for name in args.rows:
        found = [_measure(name, x, y, args) for x, y in PAIRS[: args.pairs]]
        rows += found
        table[name] = summary(found)
        print(name, table[name], flush=True)
    for name, change in changes(rows).items():
        table[name]["change"] = change
        print(f"{name}: confidence within {change:.3f} of the clean pair's")
    if args.out:
        settings = {
            **jfsf.Settings().as_record(),
            **{"seed": args.seed, "every": args.every, "right": RIGHT, "far": FAR},
        }
        results_file.write(args.out, settings=settings, rows=table, pairs=rows)


def damaged(row: str, name: str, seed: int) -> damages.Damaged:
    """The embedded shape with the damage of a row."""
    rng = np.random.default_rng([seed, zlib.crc32(f"{row} {name}".encode())])
    return ROWS[row](data.load(name), rng)


def _measure(row: str, name_x: str, name_y: str, args) -> dict:
    truth_x, truth_y = (data.load(n).template_to_vertex for n in (name_x, name_y))
    clean_y = data.load(name_y).mesh
    x, index = damaged(row, name_x, args.seed)
    y = clean_y
    if row.endswith(BOTH):
        y = damaged(row, name_y, args.seed).mesh
    found = jax.block_until_ready(jfsf.match(x, y))
    points = index[truth_x][:: args.every]
    left = points >= 0
    partners = truth_y[:: args.every][left]
    error = geodesic_error(np.asarray(found.T_xy), clean_y, points[left], partners)
    figures = {k: float(v) for k, v in found.certificate.figures().items()}
    result = {
        "row": row,
        "x": name_x,
        "y": name_y,
        "n_x": len(x.vertices),
        "error": float(error.mean()),
        "far": float((error > FAR).mean()),
        "warnings": warnings_of(found.certificate, "preserve"),
        **figures,
    }
    result["right"] = result["error"] < RIGHT and result["far"] <= MAX_FAR
    print(
        f"  {name_x} {name_y} error {result['error']:.4f} far {result['far']:.1%} "
        f"confidence {figures['confidence']:.2f} "
        f"{'' if result['right'] else 'WRONG '}{'; '.join(result['warnings'])}",
        flush=True,
    )
    return result


def summary(rows: list[dict]) -> dict:
    """Errors times 1000, and how often a warning is missing or out of place."""
    errors = 1000 * np.array([row["error"] for row in rows])
    return {
        "mean": round(float(errors.mean()), 1),
        "min": round(float(errors.min()), 1),
        "max": round(float(errors.max()), 1),
        "wrong": sum(not row["right"] for row in rows),
        "silent": sum(not row["right"] and not row["warnings"] for row in rows),
        "false_alarms": sum(row["right"] and bool(row["warnings"]) for row in rows),
    }


def changes(rows: list[dict]) -> dict[str, float]:
    """How much the confidence differs from the clean pair's, at most, of each row."""
    pair = lambda row: (row["x"], row["y"])
    clean = {pair(row): row["confidence"] for row in rows if row["row"] == "clean"}
    most: dict[str, float] = {}
    for row in rows:
        if pair(row) in clean:
            change = abs(row["confidence"] - clean[pair(row)])
            most[row["row"]] = max(most.get(row["row"], 0.0), change)
    return {name: round(change, 4) for name, change in most.items()}


if __name__ == "__main__":
    main()
