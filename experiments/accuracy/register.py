"""A template deformed onto scans: how near, how whole, and how right.

The template is X of a pair, the scan Y, the map that of `jfsf.match`, or the ground
truth with --true where that is one vertex of Y for each of X. Distances and errors are
in sqrt(area of Y). The error of a vertex is its distance from the mean of its true
partners; that of `y.vertices[T_xy]`, the template put on its images, stands beside it,
and so do the faces that collapse there. `back` is how far vertices of the scan lie from
the template. Maps are kept in --maps, so that a killed run goes on.

    python -m experiments.accuracy.register --embedded --spread 10 \\
        --out experiments/results/register.json
    python -m experiments.accuracy.register --data FOLDER --spread 3 [--true] \\
        [--out RESULT.json]
"""

import argparse
from pathlib import Path

import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets
from jfsf.apps.mapfiles import read_match, write_match
from jfsf.mesh import closest, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import face_areas
from jfsf.types import Mesh


def main() -> None:
    parser = command_line.parser(__doc__)
    datasets.add_arguments(parser)
    parser.add_argument("--true", action="store_true", help="the ground truth as map")
    parser.add_argument("--maps", type=Path, help="folder that keeps the matches")
    args = command_line.parse(parser)
    datasets.check_arguments(parser, args)
    settings = {"true": args.true, "embedded": args.embedded, "spread": args.spread}
    rows = []
    for pair in datasets.pairs(args):
        rows.append({"x": pair[0], "y": pair[1], **measure(args, *pair)})
        print(rows[-1], flush=True)
        if args.out:
            results_file.write(
                args.out, settings=settings, summary=summary(rows), pairs=rows
            )
    print(summary(rows), flush=True)


def measure(args: argparse.Namespace, name_x: str, name_y: str) -> dict:
    """A row: distances, flaws and errors of one registration."""
    x, y = datasets.load_pair(args, name_x, name_y)
    T, confidence = _map(args, name_x, name_y, x, y)
    found = jfsf.register(x.mesh, y.mesh, T)
    unit = np.sqrt(surface_area(y.mesh))
    distance = found.distance / unit
    warped = Mesh(found.vertices, x.mesh.faces)
    back = closest(surface_tree(warped), y.mesh.vertices).distance / unit
    image, at_rest = (
        face_areas(v, x.mesh.faces)
        for v in (y.mesh.vertices[T], x.mesh.vertices * float(found.scale))
    )
    error, error_T = _errors(x, y, (found.vertices, y.mesh.vertices[T]), unit)
    return {
        "n_x": len(x.mesh.vertices),
        "n_y": len(y.mesh.vertices),
        "confidence": confidence,
        "distance": float(distance.mean()),
        "distance_95": float(np.quantile(distance, 0.95)),
        "distance_max": float(distance.max()),
        "back": float(back.mean()),
        "back_95": float(np.quantile(back, 0.95)),
        "bridged": int(found.bridged.sum()),
        "flipped": int(found.flipped),
        "collapsed": int(found.collapsed),
        "collapsed_T": int((image < 1e-4 * at_rest).sum()),
        "error": error,
        "error_T": error_T,
    }


def summary(rows: list[dict]) -> dict:
    """Means over the pairs, the largest of what should be small, and counts."""
    mean = lambda name: float(np.mean([row[name] for row in rows]))
    most = lambda name: float(np.max([row[name] for row in rows]))
    total = lambda name: int(np.sum([row[name] for row in rows]))
    return {
        "pairs": len(rows),
        **{f"{name}_mean": mean(name) for name in ("distance", "error", "error_T")},
        **{f"{name}_max": most(name) for name in ("distance", "distance_95", "back")},
        **{name: total(name) for name in ("flipped", "collapsed", "collapsed_T")},
        "error_below_T": sum(row["error"] <= row["error_T"] for row in rows),
    }


def _map(args, name_x, name_y, x, y) -> tuple[np.ndarray, float | None]:
    """T_xy, and its confidence; None for the ground truth."""
    if args.true:
        T = np.full(len(x.mesh.vertices), -1)
        T[x.truth] = y.truth
        if (T < 0).any():
            raise SystemExit(
                f"{name_x} {name_y}: the ground truth leaves out {(T < 0).sum()} "
                "vertices of X; run it without --true"
            )
        return T, None
    path = args.maps and args.maps / f"{name_x}__{name_y}.npz"
    if path and path.exists():
        found = read_match(path)
    else:
        found = jfsf.match(x.mesh, y.mesh)
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_match(path, found)
    return np.asarray(found.T_xy), float(found.certificate.confidence)


def _errors(x, y, placed, unit: float) -> list[float]:
    """Mean distance of vertices of X, where they are placed, from their true points."""
    count = np.bincount(x.truth, minlength=len(x.mesh.vertices))
    true = np.zeros((len(count), 3))
    np.add.at(true, x.truth, y.mesh.vertices[y.truth])
    known = count > 0
    true = true[known] / count[known, None]
    away = (np.linalg.norm(points[known] - true, axis=1) for points in placed)
    return [float(one.mean() / unit) for one in away]


if __name__ == "__main__":
    main()
