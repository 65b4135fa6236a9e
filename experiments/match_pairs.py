"""Match every listed pair of a data folder from its raw meshes; report the errors.

What a folder holds is in datasets.py. For the embedded shapes: --embedded.

    python experiments/match_pairs.py --data FOLDER --pairs FILE --out RESULT.json
"""

import argparse
import time
from pathlib import Path

import datasets
import jax
import numpy as np
import results_file

import jfsf
from jfsf.evaluate import evaluate

LOST = 0.06  # a mean error above this is a wrong map, not an imprecise one


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    datasets.add_arguments(parser)
    parser.add_argument("--every", type=int, default=5, help="template points: 1 in N")
    parser.add_argument("--exact", action="store_true", help="exact geodesics, slow")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    datasets.check_arguments(parser, args)
    pairs = datasets.pairs(args)
    rows = []
    for x, y in pairs:
        shapes = datasets.load_pair(args, x, y)
        row = {"x": x, "y": y, **_measure(*shapes, args)}
        rows.append(row)
        mirrored = f" mirrored {row['mirrored']:.4f}" if "mirrored" in row else ""
        print(
            f"{len(rows):4d}/{len(pairs)} {x} {y} error {row['error']:.4f}{mirrored} "
            f"orientation {row['orientation']:+.2f} {row['seconds']:.2f} s",
            flush=True,
        )
    summary = _summary(rows)
    print(summary)
    if args.out:
        settings = {"every": args.every, "exact": args.exact, "lost": LOST}
        results_file.write(args.out, settings=settings, summary=summary, pairs=rows)


def _measure(x, y, args) -> dict:
    (mesh_x, gt_x, _), (mesh_y, gt_y, sym_y) = x, y
    start = time.perf_counter()
    found = jax.block_until_ready(jfsf.match(mesh_x, mesh_y))
    seconds = time.perf_counter() - start
    options = {"every": args.every, "exact": args.exact, "only": ("error",)}

    def error(gt):
        truth = gt_x, gt
        return evaluate(found, mesh_x, mesh_y, truth=truth, **options).error_mean

    row = {"error": error(gt_y), "seconds": seconds}
    if sym_y is not None:
        row["mirrored"] = error(sym_y)
    row.update({k: float(v) for k, v in found.certificate.figures().items()})
    return row


def _summary(rows: list[dict]) -> dict:
    errors = np.array([row["error"] for row in rows])
    seconds = np.array([row["seconds"] for row in rows])
    summary = {
        "pairs": len(rows),
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "max": float(errors.max()),
        "lost": int((errors > LOST).sum()),
        "seconds_median": float(np.median(seconds)),
        "seconds_first": float(seconds[0]),
    }
    if all("mirrored" in row for row in rows):
        flipped = [row["mirrored"] < row["error"] for row in rows]
        summary["mirrored_below_direct"] = int(sum(flipped))
    return summary


if __name__ == "__main__":
    main()
