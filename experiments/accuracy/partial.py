"""Match parts of embedded shapes with whole ones: errors and regions, beside rivals.

X is cut to a share of its area (`cuts.py`), by a plane or by a geodesic ball in turn.
The error is over the part, on the clean Y, in sqrt(area of Y). `iou` is the area of Y
in the found and the true region, over that in either. `whole` is `jfsf.match` before
the cut. ZoomOut starts from a fit to descriptors, as pyFM does; the region of both is
what the map hits, spread to near vertices.

With --both Y is cut too: X is a ball around a template point, and Y what lies far from
it, so that a share of the body is in both: 0.4 by `--keep 0.7`. With `--keep 1` nothing
is cut. `changes.py` says what else may be done to X.

Each row goes to OUT.jsonl at once, so that a killed run can go on; OUT.json has the
means and all rows.

    python -m experiments.accuracy.partial --keep 0.7 0.5 --pairs 40 --out RESULT.json
"""

import json
import time
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import changes, cuts
from experiments.accuracy.protocol import RIGHT
from experiments.bench.peer_recipes import pyfm
from jfsf import data
from jfsf.convert import nearest
from jfsf.geometry import pair_distances
from jfsf.initial import fit
from jfsf.mesh import surface_area
from jfsf.mesh._edit import Submesh
from jfsf.refine import zoomout
from jfsf.spectral import embeddings, spectrum, wks

METHODS = ("jfsf", "whole", "zoomout", "pyfm")
KS = tuple(range(20, 101, 5))
NEAR = 0.05  # a vertex of Y so near to the image of a rival's map is in its region


def main() -> None:
    parser = command_line.parser(__doc__, out="partial.json")
    parser.add_argument("--keep", type=float, nargs="+", default=[0.7, 0.5])
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=["jfsf"])
    parser.add_argument("--both", action="store_true", help="cut Y too")
    parser.add_argument("--every", type=int, default=20, help="points of truth: 1 in N")
    changes.add_arguments(parser)
    args = command_line.parse(parser)
    change = changes.asked(args)
    lines = args.out.with_suffix(".jsonl")
    rows = [json.loads(line) for line in _lines(lines)]
    done = {(r["method"], r["keep"], r["pair"]) for r in rows}
    for pair, (name_x, name_y) in enumerate(pairs(args.pairs)):
        for keep in args.keep:
            for method in args.methods:
                share = 1.0 if method == "whole" else keep
                if (method, share, pair) in done:
                    continue
                done.add((method, share, pair))
                row = {"method": method, "keep": share, "pair": pair}
                row |= {"x": name_x, "y": name_y}
                pair_of = Cut(name_x, name_y, share, pair, args.both)
                row |= measure(method, pair_of, change, args.every)
                rows.append(row)
                with lines.open("a") as file:
                    file.write(json.dumps(row) + "\n")
                print(row, flush=True)
    settings = {"every": args.every, "near": NEAR, "both cut": args.both}
    settings["changes"] = change._asdict()
    results_file.write(args.out, settings=settings, summary=summary(rows), rows=rows)


def pairs(number: int) -> list[tuple[str, str]]:
    """Ordered pairs of embedded shapes, each once, in a fixed random order."""
    names = data.names()
    all_pairs = [(a, b) for a in names for b in names if a != b]
    order = np.random.default_rng(0).permutation(len(all_pairs))
    return [all_pairs[i] for i in order[:number]]


class Cut(NamedTuple):
    """A pair of shapes, of which X is cut to a share of its area, or both are."""

    x: str
    y: str
    keep: float
    number: int
    both: bool = False


def part_of(name: str, keep: float, pair: int):
    """The cut of a pair: by a plane if its number is even, else by a ball."""
    kind = (cuts.plane, cuts.ball)[pair % 2]
    return kind(data.load(name), keep, np.random.default_rng(pair))


def parts_of(pair: Cut) -> tuple[Submesh, Submesh]:
    """Both shapes; what is not cut is whole."""
    x, y = data.load(pair.x), data.load(pair.y)
    if pair.both:
        rng = np.random.default_rng(pair.number)
        point = int(rng.integers(len(x.template_to_vertex)))
        one = cuts.ball_around(x, point, pair.keep)
        return one, cuts.rest_of_ball(y, point, pair.keep)
    whole = [Submesh(s.mesh, np.arange(len(s.mesh.vertices))) for s in (x, y)]
    one = whole[0] if pair.keep == 1 else part_of(pair.x, pair.keep, pair.number)
    return one, whole[1]


def measure(method: str, pair: Cut, change: changes.Changes, every: int) -> dict:
    """One row: the error, the regions, the evidence, the seconds."""
    x, y = data.load(pair.x), data.load(pair.y)
    part_x, part_y = parts_of(pair)
    truth = cuts.truth_of_parts(x, part_x, y, part_y)
    own = changes.changed(part_x.mesh, change, pair.number)
    start = time.perf_counter()
    T_xy, inside, extra = _run(method, own.mesh, part_y.mesh, change.same_unit)
    seconds = time.perf_counter() - start
    images = T_xy[own.near[truth.at_x[::every]]]
    away = pair_distances(part_y.mesh, images, truth.at_y[::every])
    return {
        "error": float(away.mean() / np.sqrt(surface_area(part_y.mesh))),
        "iou": cuts.overlap(part_y.mesh, inside, truth.inside_y),
        "scale": own.scale,
        "seconds": seconds,
        **extra,
    }


def _run(method, x, y, same_unit: bool):
    """T_xy, the region of Y, and further figures."""
    if method in ("jfsf", "whole"):
        if method == "jfsf":
            found = jfsf.match(x, y, partial=True, same_unit=same_unit)
        else:
            found = jfsf.match(x, y)
        jax.block_until_ready(found)
        inside = np.ones(len(y.vertices), bool)
        extra = {"confidence": float(found.certificate.confidence)}
        if method == "jfsf":
            inside = np.asarray(found.matched_y)
            # Where only X is cut, all of it has a partner.
            extra["matched_x"] = float(np.asarray(found.matched_x).mean())
            extra["log_odds"] = float(found.certificate.log_odds)
            extra["gap"] = min(float(found.certificate.gap), 1e3)
        return np.asarray(found.T_xy), inside, extra
    T_xy = np.asarray(pyfm(x, y) if method == "pyfm" else _zoomout(x, y))
    image = KDTree(y.vertices[np.unique(T_xy)])
    away = image.query(y.vertices)[0] / np.sqrt(surface_area(y))
    return T_xy, away < NEAR, {}


def _zoomout(x, y) -> np.ndarray:
    specs = [jax.tree.map(jnp.asarray, spectrum(mesh, KS[-1])) for mesh in (x, y)]
    wks_x, wks_y = (wks(spec)[:, ::5] for spec in specs)
    start = fit(specs[0], specs[1], wks_x, wks_y, k=KS[0]).C_yx
    C_yx = zoomout(specs[0], specs[1], start, ks=KS, converter=nearest)
    emb_x, emb_y = embeddings(C_yx, *(spec.evecs for spec in specs), space="direct")
    return np.asarray(nearest(emb_x, emb_y).T_xy)


def summary(rows: list[dict]) -> list[dict]:
    """Means of each method and share."""
    found = []
    for key in sorted({(r["method"], r["keep"]) for r in rows}):
        these = [r for r in rows if (r["method"], r["keep"]) == key]
        errors = np.array([r["error"] for r in these])
        row = {
            "method": key[0],
            "keep": key[1],
            "pairs": len(these),
            "mean": float(errors.mean()),
            "median": float(np.median(errors)),
            "wrong": int((errors >= RIGHT).sum()),
            "iou": float(np.mean([r["iou"] for r in these])),
            "seconds_median": float(np.median([r["seconds"] for r in these])),
        }
        if "confidence" in these[0]:
            sure = np.array([r["confidence"] >= 0.7 for r in these])
            row["wrong_in_silence"] = int(((errors >= RIGHT) & sure).sum())
            row["right_with_warning"] = int(((errors < RIGHT) & ~sure).sum())
        found.append(row)
    return found


def _lines(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return [line for line in text.splitlines(keepends=True) if line.endswith("\n")]


if __name__ == "__main__":
    main()
