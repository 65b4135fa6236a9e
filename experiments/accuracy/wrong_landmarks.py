"""Five landmarks at extremities, two of them exchanged: is that found, does it harm?

Folders and list are as for match_pairs.py, with a template as ground truth. Landmarks
are template points that are geodesically far apart on X; of each pair, other two are
exchanged on Y.

    python -m experiments.accuracy.wrong_landmarks --data FOLDER [--pairs FILE] \\
        --out FILE
"""

from itertools import combinations

import jax
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets
from jfsf.evaluate import evaluate
from jfsf.geometry import GeodesicSolver
from jfsf.matching._kept_landmarks import MISSED

NUM = 5
NAMES = ("none", "right", "wrong")


def main() -> None:
    parser = command_line.parser(__doc__)
    datasets.add_arguments(parser)
    parser.add_argument("--every", type=int, default=40, help="points of truth: 1 in N")
    parser.add_argument("--step", type=int, default=1, help="only every Nth pair")
    args = command_line.parse(parser)
    datasets.check_arguments(parser, args)
    exchanges = list(combinations(range(NUM), 2))
    rows = []
    for i, (name_x, name_y) in enumerate(datasets.pairs(args)[:: args.step]):
        (x, gt_x, _), (y, gt_y, _) = datasets.load_pair(args, name_x, name_y)
        truth = gt_x, gt_y
        at = _far_apart(x, truth[0])
        known = np.stack([truth[0][at], truth[1][at]], 1)
        exchanged = list(exchanges[i % len(exchanges)])
        wrong = known.copy()
        wrong[exchanged, 1] = wrong[exchanged[::-1], 1]
        row = {"x": name_x, "y": name_y, "exchanged": exchanged}
        for name, landmarks in (("none", None), ("right", known), ("wrong", wrong)):
            found = jfsf.match(x, y, landmarks=landmarks)
            found = jax.block_until_ready(found)
            options = {"truth": truth, "every": args.every, "only": ("error",)}
            row[name] = evaluate(found, x, y, **options).error_mean
            row[f"confidence_{name}"] = float(found.certificate.confidence)
            missed = np.flatnonzero(np.asarray(found.certificate.landmarks) > MISSED)
            row[f"missed_{name}"] = missed.tolist()
        rows.append(row)
        print(row, flush=True)
    summary = {
        "pairs": len(rows),
        "found": sum(set(row["exchanged"]) <= set(row["missed_wrong"]) for row in rows),
        "only_these": sum(row["exchanged"] == row["missed_wrong"] for row in rows),
        "worse": sum(row["wrong"] > row["none"] + 0.01 for row in rows),
        **{f"mean_{n}": float(np.mean([r[n] for r in rows])) for n in NAMES},
    }
    print(summary)
    if args.out:
        record = jfsf.Settings().as_record()
        results_file.write(args.out, settings=record, summary=summary, pairs=rows)


def _far_apart(mesh, points) -> list[int]:
    """Template points: the farthest of one, then the farthest from those before."""
    solver = GeodesicSolver(mesh)
    start = solver.rows(points[:1])[0][points]
    at = [int(np.argmax(start))]
    far = solver.rows(points[at])[0][points]
    while len(at) < NUM:
        at.append(int(np.argmax(far)))
        far = np.minimum(far, solver.rows(points[at[-1:]])[0][points])
    return at


if __name__ == "__main__":
    main()
