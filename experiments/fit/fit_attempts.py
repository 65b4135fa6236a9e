"""How many maps of the coarse copies to bend on the whole shapes.

Pairs of a set are matched with `MOST` of them, the highest ranks first. Of the pairs in
doubt it says which map is the most confident of the first 1, 2, .. that were bent, the
map so far among them, and its error: what `Settings.nonisometric_attempts` would have
chosen. Creatures and SHREC'07 were used to choose two; the others report.

    python -m experiments.fit.fit_attempts [SET ...] --data ROOT [--out RESULT.json]
"""

import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf.geometry import GeodesicSolver
from jfsf.matching._match import attempted_pair
from jfsf.mesh import surface_area

SETS = "creatures", "shrec07", "shrec07_more"
MOST = 3
POINTS = 250  # of ground truth, at most, chosen at random


def main() -> None:
    parser = command_line.parser(__doc__, out="fit_attempts.json", data=True)
    parser.add_argument("sets", nargs="*", default=SETS)
    args = command_line.parse(parser)
    root = args.data
    rows = []
    for data_set in protocol.named(args.sets):
        own = protocol.below(data_set, root)
        for pair in datasets.pairs_of(own):
            if (row := _row(own, pair)) is not None:
                rows.append({"set": own.name, "x": pair.x, "y": pair.y, **row})
                print(rows[-1], flush=True)
                summary = summaries(rows)
                results_file.write(args.out, most=MOST, summary=summary, rows=rows)
    for line in summaries(rows):
        print(line)


def summaries(rows: list[dict]) -> list[dict]:
    """Mean error and wrong maps of each set, for each number of maps."""
    found = []
    for name in dict.fromkeys(row["set"] for row in rows):
        own = [row for row in rows if row["set"] == name]
        for number in range(1, MOST + 1):
            errors = [_chosen(row, number) for row in own]
            wrong = sum(not protocol.is_right(error) for error in errors)
            line = {"set": name, "pairs": len(own), "attempts": number}
            found.append({**line, "mean": float(np.mean(errors)), "wrong": wrong})
    return found


def _chosen(row: dict, number: int) -> float:
    """The error of the most confident of the first attempts."""
    confidence = row["confidence"][: 1 + number]
    return row["error"][int(np.argmax(confidence))]


def _row(data_set: protocol.DataSet, pair: datasets.Pair) -> dict | None:
    """Confidence and error of each attempt; None of a pair that is not in doubt."""
    x, y = datasets.load_pair_of(data_set, pair)
    settings = jfsf.Settings(nonisometric_attempts=MOST)
    state = attempted_pair(x.mesh, y.mesh, settings=settings)
    tried = zip(state.attempts, state.results(settings), strict=True)
    matches = [match for one, match in tried if one.source != "motion"]
    if len(matches) < 2:
        return None
    order = np.random.default_rng(0).permutation(len(x.truth))
    at = np.sort(order[:POINTS])
    from_y = GeodesicSolver(y.mesh).rows(y.truth[at]) / np.sqrt(surface_area(y.mesh))
    number = np.arange(len(at))
    errors = [from_y[number, np.asarray(m.T_xy)[x.truth[at]]].mean() for m in matches]
    return {
        "confidence": [float(match.certificate.confidence) for match in matches],
        "error": [float(error) for error in errors],
    }


if __name__ == "__main__":
    main()
