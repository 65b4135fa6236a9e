"""Match pairs of shapes of different proportions; report errors and confidence.

A folder holds off/NAME.off and the ground truth: corres/NAME.vts, template point ->
1-based vertex; or vts/NAME.vts, landmarks as rows (0-based vertex, x, y, z). A list has
the names of a pair in each line and, if it is known, a rival's mean error.

    python experiments/far.py --data FOLDER [--data FOLDER] --pairs FILE --out FILE
"""

import argparse
import time
from pathlib import Path

import jax
import numpy as np
import results_file
from calibration import RIGHT

import jfsf
from jfsf import mapfiles
from jfsf.evaluate import evaluate

LOST = 0.12  # a mean error above this is a wrong map between far shapes


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, action="append", required=True)
    parser.add_argument("--pairs", type=Path, required=True)
    parser.add_argument("--every", type=int, default=1, help="points of truth: 1 in N")
    parser.add_argument("--step", type=int, default=1, help="only every Nth pair")
    parser.add_argument("--first", action="store_true", help="no second attempt")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    settings = jfsf.Settings(retry_below=0) if args.first else jfsf.Settings()
    lines = [line.split() for line in args.pairs.read_text().splitlines() if line]
    rows = []
    for name_x, name_y, *rest in lines[:: args.step]:
        x, y, truth = load_pair(args.data, name_x, name_y)
        start = time.perf_counter()
        found = jax.block_until_ready(jfsf.match(x, y, settings=settings))
        seconds = time.perf_counter() - start
        options = {"truth": truth, "every": args.every, "only": ("error",)}
        error = evaluate(found, x, y, **options).error_mean
        certificate = {k: float(v) for k, v in found.certificate.figures().items()}
        row = {"x": name_x, "y": name_y, "error": error, "seconds": seconds}
        rows.append({**row, "rival": float(rest[0]) if rest else None, **certificate})
        likely = certificate["confidence"]
        print(
            f"{name_x} {name_y} error {error:.4f} confidence {likely:.2f}", flush=True
        )
    summary = _summary(rows)
    print(summary)
    if args.out:
        record = settings.as_record()
        results_file.write(args.out, settings=record, summary=summary, pairs=rows)


def load_pair(folders: list[Path], name_x: str, name_y: str):
    """Both meshes, and the ground truth: vertices of X and their partners."""
    (x, gt_x), (y, gt_y) = _load(folders, name_x), _load(folders, name_y)
    points = min(len(gt_x), len(gt_y))
    return x, y, (gt_x[:points], gt_y[:points])


def _load(folders: list[Path], name: str):
    """A mesh, and the vertex of each point of the ground truth."""
    for folder in folders:
        path = folder / "off" / f"{name}.off"
        if not path.exists():
            continue
        mesh = jfsf.read(path)
        landmarks = folder / "vts" / f"{name}.vts"
        if landmarks.exists():
            return mesh, np.loadtxt(landmarks, usecols=0).astype(int)
        template = folder / "corres" / f"{name}.vts"
        return mesh, mapfiles.read_map(template, n_to=len(mesh.vertices))
    raise SystemExit(f"no off/{name}.off in {', '.join(map(str, folders))}")


def _summary(rows: list[dict]) -> dict:
    errors = np.array([row["error"] for row in rows])
    summary = {
        "pairs": len(rows),
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "below_lost": int((errors < LOST).sum()),
        "right": int((errors < RIGHT).sum()),
        "seconds_median": float(np.median([row["seconds"] for row in rows])),
    }
    rivals = [(row["error"], row["rival"]) for row in rows if row["rival"] is not None]
    if rivals:
        summary["rival_mean"] = float(np.mean([theirs for _, theirs in rivals]))
        summary["below_rival"] = sum(ours < theirs for ours, theirs in rivals)
    return summary


if __name__ == "__main__":
    main()
