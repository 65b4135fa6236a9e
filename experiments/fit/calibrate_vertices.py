"""Fit the confidence of a vertex, and test it on sets that it was not fitted to.

A file holds one data set: rows with error, confidence and vertices, see vertex_rows.py.
"A vertex is right" means that its error is below 0.05 of sqrt(area). The factors of a
logistic regression, no piece of evidence counting for a map where it speaks against it,
are written with the data they were fitted to, and with scores on each set by a fit to
all others. Every pair counts alike, and of it both directions.

    python -m experiments.fit.calibrate_vertices
    python -m experiments.fit.calibrate_vertices RESULT.json ... --out CONSTANTS.json
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

import jfsf
from experiments import command_line
from experiments.accuracy import protocol, vertex_rows
from experiments.fit.reliability import reliability
from jfsf.matching._vertices import SURE, VERTEX_EVIDENCE, WITHIN
from jfsf.storage._atomic import write_text

RESULTS = "match_*.json"
CONSTANTS = Path(jfsf.__file__).parent / "matching" / "vertex_constants.json"
# Not those of parts, whose vertices have none, nor of four landmarks a shape.
WHOLE = [
    name
    for name, row in protocol.SETS.items()
    if row.kind != "part" and name != "hdm_molars"
]
LARGE = 0.1  # an error of a vertex that a user would want to know of
RIDGE = 1e-3  # on standardised columns, beside the mean loss


class Vertices(NamedTuple):
    """Vertices of many pairs, (p,) each.

    columns: (p, f + 1), the evidence and the logit of the map's confidence.
    errors: geodesic.
    weights: they sum to 1 over a pair.
    of_right: whether the map is right on the whole.
    """

    columns: np.ndarray
    errors: np.ndarray
    weights: np.ndarray
    of_right: np.ndarray

    @property
    def right(self) -> np.ndarray:
        """Whether each is mapped right."""
        return self.errors < WITHIN

    def at(self, which: np.ndarray) -> "Vertices":
        """Some of them."""
        return Vertices(*(values[which] for values in self))


def main() -> None:
    parser = command_line.parser(__doc__, out=CONSTANTS)
    parser.add_argument("results", type=Path, nargs="*", help=f"default: {RESULTS}")
    args = command_line.parse(parser)
    write_text(
        args.out, text_of(args.results or sorted(command_line.RESULTS.glob(RESULTS)))
    )
    print(args.out.read_text())


def text_of(paths: Sequence[Path]) -> str:
    """What the file of constants holds, fitted to these results."""
    sets = {path.stem.removeprefix("match_"): read(path) for path in paths}
    sets = {name: rows for name, rows in sets.items() if rows and name in WHOLE}
    return json.dumps(calibrate(sets), indent=1) + "\n"


def read(path: Path) -> list[dict[str, Any]]:
    """The pairs of a results file whose vertices are known."""
    pairs = json.loads(path.read_text(encoding="utf-8"))["pairs"]
    return [row for row in pairs if row.get("vertices")]


def calibrate(sets: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Factors, what they were fitted to, and the scores of fits to all other sets."""
    tables = {name: table(rows) for name, rows in sets.items()}
    every = joined(list(tables.values()))
    factors = fit(every)
    held_out = {}
    for name, own in tables.items():
        others = joined([one for key, one in tables.items() if key != name])
        held_out[name] = predict(fit(others), own.columns)
    found = np.concatenate(list(held_out.values()))
    names = ("constant", *VERTEX_EVIDENCE, "likely")
    whole = every.of_right
    return {
        "factors": dict(zip(names, factors.round(3).tolist(), strict=True)),
        "right": f"error below {WITHIN} of sqrt(area)",
        "held_out": {
            "all": scores(every, found),
            "maps that are right on the whole": scores(every.at(whole), found[whole]),
        },
        "sets": {
            name: {"pairs": len(sets[name])} | scores(own, held_out[name])
            for name, own in tables.items()
        },
    }


def table(rows: list[dict[str, Any]]) -> Vertices:
    """The vertices of some pairs."""
    parts = []
    for row in rows:
        likely = logit(np.clip(row["confidence"], 1 - SURE, SURE))
        sides = [vertex_rows.from_row(side) for side in row["vertices"].values()]
        for evidence, errors in sides:
            n = len(errors)
            columns = np.column_stack([evidence, np.full(n, likely)])
            weights = np.full(n, 1 / n / len(sides))
            whole = np.full(n, protocol.is_right(row["error"]))
            parts.append(Vertices(columns, errors, weights, whole))
    return joined(parts)


def joined(parts: list[Vertices]) -> Vertices:
    """All of them."""
    return Vertices(*map(np.concatenate, zip(*parts, strict=True)))


def fit(data: Vertices) -> np.ndarray:
    """Constant and factors (1 + f + 1,)."""
    weights = data.weights / data.weights.sum()
    centre = weights @ data.columns
    spread = np.sqrt(weights @ (data.columns - centre) ** 2)
    columns = (data.columns - centre) / spread
    side = np.where(data.right, 1, -1)

    def loss(b):
        margin = side * (b[0] + columns @ b[1:])
        slope = -weights * side * expit(-margin)
        value = weights @ np.logaddexp(0, -margin) + RIDGE * (b[1:] ** 2).sum() / 2
        return value, np.array([slope.sum(), *(columns.T @ slope + RIDGE * b[1:])])

    # More evidence against a vertex never makes it likelier, a likelier map does.
    against = [(None, 0)] * len(VERTEX_EVIDENCE)
    options: Any = {"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000}
    b = minimize(
        loss,
        np.zeros(1 + len(centre)),
        jac=True,
        method="L-BFGS-B",
        bounds=[(None, None), *against, (0, None)],
        options=options,
    ).x
    factors = b[1:] / spread
    return np.array([b[0] - factors @ centre, *factors])


def predict(factors: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The probability of each vertex, as `jfsf.matching.vertex_confidence` gives it."""
    return expit(factors[0] + columns @ factors[1:])


def scores(data: Vertices, found: np.ndarray) -> dict[str, Any]:
    """How well the probabilities hold, and what share of large errors they find."""
    weights = data.weights / data.weights.sum()
    held = reliability(found, data.right, weights=weights)
    order = np.argsort(found, kind="stable")
    tenth = np.cumsum(weights[order]) <= 0.1
    large = weights * (data.errors > LARGE)
    values = {
        "probability": weights @ found,
        "right": weights @ data.right,
        "calibration_error": held.calibration_error,
        "large_errors": large.sum(),
        "of_these_in_the_least_sure_tenth": large[order][tenth].sum()
        / max(large.sum(), 1e-12),
    }
    rounded = {name: round(float(value), 3) for name, value in values.items()}
    return {"vertices": len(found), **rounded}


if __name__ == "__main__":
    main()
