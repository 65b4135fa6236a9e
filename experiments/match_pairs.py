"""Match every listed pair of a data folder from its raw meshes; report the errors.

The folder holds NAME.off, corres/NAME.vts (template point -> 1-based vertex) and, where
there is one, corres/NAME.sym.vts (the left-right mirror image). The list has one pair
of names a line. For the embedded shapes: --embedded.

    python experiments/match_pairs.py --data FOLDER --pairs FILE --out RESULT.json
"""

import argparse
import os
import time
from itertools import permutations
from pathlib import Path

import jax
import numpy as np
import results_file

import jfsf
from jfsf import data, mapfiles
from jfsf.metrics import geodesic_error

LOST = 0.06  # a mean error above this is a wrong map, not an imprecise one


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=os.environ.get("JFSF_DATA"))
    parser.add_argument("--pairs", type=Path, help="default: dev_pairs.txt in --data")
    parser.add_argument("--embedded", action="store_true", help="shapes of the package")
    parser.add_argument("--every", type=int, default=5, help="template points: 1 in N")
    parser.add_argument("--spread", type=int, help="only N pairs, spread over the list")
    parser.add_argument("--exact", action="store_true", help="exact geodesics, slow")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if not args.embedded and args.data is None:
        parser.error("give --data FOLDER, set JFSF_DATA, or pass --embedded")

    pairs = _pairs(args)
    if args.spread:
        at = np.linspace(0, len(pairs) - 1, args.spread).round().astype(int)
        pairs = [pairs[i] for i in at]
    rows = []
    for x, y in pairs:
        row = {"x": x, "y": y, **_measure(_load(args, x), _load(args, y), args)}
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


def _pairs(args) -> list[tuple[str, str]]:
    if args.embedded:
        return list(permutations(data.names(), 2))
    path = args.pairs or args.data / "dev_pairs.txt"
    return [tuple(line.split()[:2]) for line in path.read_text().splitlines() if line]


def _load(args, name: str):
    """Mesh, template point -> vertex, and the mirrored one or None."""
    if args.embedded:
        sample = data.load(name)
        return sample.mesh, sample.template_to_vertex, None
    mesh = jfsf.read(args.data / f"{name}.off")
    corres = args.data / "corres"
    n = len(mesh.vertices)
    mirror = corres / f"{name}.sym.vts"
    return (
        mesh,
        mapfiles.read_map(corres / f"{name}.vts", n_to=n),
        mapfiles.read_map(mirror, n_to=n) if mirror.exists() else None,
    )


def _measure(x, y, args) -> dict:
    (mesh_x, gt_x, _), (mesh_y, gt_y, sym_y) = x, y
    start = time.perf_counter()
    found = jax.block_until_ready(jfsf.match(mesh_x, mesh_y))
    seconds = time.perf_counter() - start
    T_xy = np.asarray(found.T_xy)
    at = slice(None, None, args.every)
    error = lambda gt: float(
        geodesic_error(T_xy, mesh_y, gt_x[at], gt[at], exact=args.exact).mean()
    )
    row = {"error": error(gt_y), "seconds": seconds}
    if sym_y is not None:
        row["mirrored"] = error(sym_y)
    row.update({k: float(v) for k, v in found.certificate._asdict().items()})
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
