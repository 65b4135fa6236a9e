"""Match pairs from their raw meshes: errors, and the evidence of every attempt.

Sets of the protocol (`protocol.py`) by name, by role, or all; each writes
results/match_SET.json:

    python -m experiments.accuracy.match_pairs faust_r topkids_low --data ROOT
    python -m experiments.accuracy.match_pairs report --data ROOT

Or the pairs of any folder of the forms that `datasets.py` reads, into one file:

    python -m experiments.accuracy.match_pairs --data FOLDER [--pairs FILE] \\
        --out RESULT.json

The JSON has for each pair the error, what the list says of a rival, the certificate of
the match, and for each attempt its source, error and certificate; `won` is the number
of the attempt that is the match. Of the maps of coarse copies it has the error and what
ranks them; the first is the map so far. Further starts are attempted only for pairs in
doubt; --exhaustive attempts them for all, so that there are wrong maps to learn from,
and writes results/match_SET_exhaustive.json.

`changes.py` says what may be done to X first: a rotation, another size, fewer vertices.

Parts are matched as such, once, and the regions that are found are compared with the
true ones.
"""

import argparse
import os
import time
from pathlib import Path

import jax
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import changes, cuts, datasets, protocol
from jfsf.apps.report._words import LIKELY
from jfsf.geometry import GeodesicSolver
from jfsf.matching._confidence import RANK_FACTORS
from jfsf.matching._match import attempted_pair
from jfsf.matching._pairs import PairState
from jfsf.mesh import surface_area
from jfsf.types import Match

POINTS, SEED = 250, 0  # of ground truth, at most, chosen at random
FURTHER = 3  # starts beside the first that --exhaustive attempts
UNSURE = 0.7  # a right map below this confidence is one too many that people doubt


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("sets", nargs="*", help="of the protocol; a role; all")
    datasets.add_arguments(parser)
    parser.add_argument(
        "--exhaustive", action="store_true", help="further attempts for every pair"
    )
    changes.add_arguments(parser)
    args = command_line.parse(parser)
    if args.sets:
        _check_sets(parser, args)
        root = Path(args.data[0] if args.data else os.environ.get("JFSF_DATA", "."))
        ending = "_exhaustive" if args.exhaustive else ""
        for data_set in protocol.named(args.sets):
            folder = args.out or command_line.RESULTS
            path = folder / f"match_{data_set.name}{ending}.json"
            own = protocol.below(data_set, root)
            _run(own, datasets.pairs_of(own), args, path)
        return
    datasets.check_arguments(parser, args)
    _run(datasets.asked(args), datasets.chosen(args), args, args.out)


def _check_sets(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    try:
        chosen = protocol.named(args.sets)
    except ValueError as error:
        parser.error(str(error))
    if args.embedded or args.pairs or args.within or args.identity:
        parser.error("--embedded, --pairs, --within, --identity are for no set")
    if args.out and args.out.suffix:
        parser.error("--out of sets is a folder")
    if args.data and len(args.data) > 1:
        parser.error("sets lie below one --data")
    known = args.data or "JFSF_DATA" in os.environ
    if any(data_set.folders for data_set in chosen) and not known:
        parser.error("give --data ROOT or set JFSF_DATA")


def _run(
    data_set: protocol.DataSet, pairs: list[datasets.Pair], args, out: Path | None
) -> None:
    """Match the pairs of a set; the file is written anew after each of them."""
    settings = jfsf.Settings()
    if args.exhaustive:
        settings = jfsf.Settings(retry_below=1, nonisometric_attempts=FURTHER)
    asked = changes.asked(args)
    same_unit = data_set.same_unit and asked.same_unit
    how = {
        **{"set": data_set.name, "kind": data_set.kind, "right": data_set.right},
        "points": f"{POINTS} at most, seed {SEED}",
        "exhaustive": args.exhaustive,
        "changes": asked._asdict(),
        "match_settings": settings.as_record(),
    }
    with_role = [(pair, data_set.role(i)) for i, pair in enumerate(pairs)]
    with_role = datasets.spread(with_role, args.spread)
    rows, summary = [], {}
    print(f"{data_set.name}: {len(with_role)} pairs", flush=True)
    for number, (pair, role) in enumerate(with_role):
        x, y = datasets.load_pair_of(data_set, pair)
        own = changes.changed(x.mesh, asked, number)
        x = x._replace(mesh=own.mesh, truth=own.near[x.truth])
        if args.identity:
            y = datasets.posed(x, y)
        row = {"x": pair.x, "y": pair.y, "role": role, "rival": pair.rival}
        row |= measure(x, y, settings, data_set.kind == "part", same_unit)
        rows.append(row)
        tried = " ".join(
            f"{one['source']} {one['error']:.3f}/{one['confidence']:.2f}"
            for one in row["attempts"]
        )
        print(
            f"{len(rows):4d}/{len(with_role)} {row['x']} {row['y']} "
            f"error {row['error']:.4f} confidence {row['confidence']:.2f} "
            f"{row['seconds']:.1f} s ({tried})",
            flush=True,
        )
        summary = summaries(rows, data_set.right)
        if out:
            results_file.write(out, settings=how, summary=summary, pairs=rows)
    for name, figures in summary.items():
        print(name, figures, flush=True)


def measure(
    x: datasets.Shape,
    y: datasets.Shape,
    settings: jfsf.Settings,
    part: bool,
    same_unit: bool,
) -> dict:
    """One row: sizes, seconds, and error and evidence of the match and all attempts."""
    start = time.perf_counter()
    state = None
    if part:
        found = jfsf.match(
            x.mesh, y.mesh, partial=True, same_unit=same_unit, settings=settings
        )
        tried, won = [("parts", jax.block_until_ready(found))], 0
    else:
        state = attempted_pair(x.mesh, y.mesh, settings=settings)
        sizes = len(x.mesh.vertices), len(y.mesh.vertices)
        matches = [m.without_padding(*sizes) for m in state.results(settings)]
        jax.block_until_ready(matches)
        names = [attempt.source for attempt in state.attempts]
        tried, won = list(zip(names, matches, strict=True)), state.won
    seconds = time.perf_counter() - start
    at = some_points(len(x.truth))
    solver = GeodesicSolver(y.mesh)
    distances = solver.rows(y.truth[at]) / np.sqrt(surface_area(y.mesh))
    attempts = [
        {
            "source": source,
            "error": _mean(distances, match, x.truth[at]),
            **{k: float(v) for k, v in match.certificate.figures().items()},
        }
        for source, match in tried
    ]
    row = {"n_x": len(x.mesh.vertices), "n_y": len(y.mesh.vertices)}
    row |= {"seconds": seconds, "points": len(at), "won": won}
    row |= {name: value for name, value in attempts[won].items() if name != "source"}
    if y.mirror is not None:
        mirrored = solver.rows(y.mirror[at]) / np.sqrt(surface_area(y.mesh))
        row["mirrored"] = _mean(mirrored, tried[won][1], x.truth[at])
    if part:
        row |= _regions(x, y, tried[won][1])
    copies = _copies(state, x.truth[at], distances)
    return {**row, "copies": copies, "attempts": attempts}


def _regions(x: datasets.Shape, y: datasets.Shape, match: Match) -> dict[str, float]:
    """Overlap of the regions that are found and those of the ground truth.

    A vertex is in the true region if it is within an edge of one with a partner, of the
    coarser mesh: it may have more vertices between the partners than the other.
    """
    edge = max(cuts.median_edge(shape.mesh) for shape in (x, y))
    sides = ("x", x, match.matched_x), ("y", y, match.matched_y)
    return {
        f"iou_{name}": cuts.overlap(
            shape.mesh,
            np.asarray(found),
            cuts.near_truth(shape.mesh, shape.truth, edge),
        )
        for name, shape, found in sides
    }


def summaries(rows: list[dict], right: float = protocol.RIGHT) -> dict[str, dict]:
    """Of all rows, and of those of each role if there are several."""
    roles = sorted({row["role"] for row in rows})
    parts = roles if len(roles) > 1 else []
    own = {role: [row for row in rows if row["role"] == role] for role in parts}
    return {name: summary(some, right) for name, some in {"all": rows, **own}.items()}


def summary(rows: list[dict], right: float = protocol.RIGHT) -> dict:
    """Errors, and how well the confidence tells right from wrong."""
    errors = np.array([row["error"] for row in rows])
    likely = np.array([row["confidence"] for row in rows])
    wrong = np.array([not protocol.is_right(error, right) for error in errors])
    found = {
        "role": ", ".join(sorted({row["role"] for row in rows})),
        "pairs": len(rows),
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "max": float(errors.max()),
        "wrong": int(wrong.sum()),
        "sure": int((likely >= LIKELY).sum()),
        "wrong_sure": int((wrong & (likely >= LIKELY)).sum()),
        "right_unsure": int((~wrong & (likely < UNSURE)).sum()),
        "attempts": sum(len(row["attempts"]) for row in rows),
        "seconds_median": float(np.median([row["seconds"] for row in rows])),
        "seconds_first": rows[0]["seconds"],
    }
    rivals = [(row["error"], row["rival"]) for row in rows if row["rival"] is not None]
    if rivals:
        found["rival_mean"] = float(np.mean([theirs for _, theirs in rivals]))
        found["below_rival"] = sum(ours < theirs for ours, theirs in rivals)
    for name in ("iou_x", "iou_y"):
        if any(name in row for row in rows):
            found[name] = float(np.mean([row[name] for row in rows]))
    flipped = [row["mirrored"] < row["error"] for row in rows if "mirrored" in row]
    if flipped:
        found["mirrored_below_direct"] = sum(flipped)
    return found


def _copies(
    state: PairState | None, at_x: np.ndarray, distances: np.ndarray
) -> list[dict]:
    """Error, and what ranks them, of the maps of the coarse copies."""
    if state is None or state.copies is None or state.coarse is None:
        return []
    x, y = state.coarse
    rows = []
    for _, _, match in state.copies.attempts:
        T_xy = y.on_whole[np.asarray(match.T_xy)[x.on_copy]]
        row = {"error": _mean(distances, match._replace(T_xy=T_xy), at_x)}
        figures = match.certificate.figures()
        rows.append(row | {name: float(figures[name]) for name in RANK_FACTORS})
    return [{name: float(f"{v:.5g}") for name, v in row.items()} for row in rows]


def some_points(number: int) -> np.ndarray:
    """Which points of the ground truth count."""
    return np.random.default_rng(SEED).permutation(number)[:POINTS]


def _mean(distances: np.ndarray, match: Match, at_x: np.ndarray) -> float:
    """Mean distance of the images of points of X; a row of distances a point."""
    images = np.asarray(match.T_xy)[at_x]
    return float(distances[np.arange(len(images)), images].mean())


if __name__ == "__main__":
    main()
