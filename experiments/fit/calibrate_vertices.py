"""Fit the radius of a vertex, and test it on kinds that it was not fitted to.

Every set counts alike, of it every pair, and of a pair both directions. For the radius
only maps that are right on the whole count: it is said of these.

1. Factors: least squares of the logarithm of the error, no piece of evidence counting
   for a vertex where it speaks against it.
2. The constant: such that 0.9 of the scores, error divided by radius, are at most 1
   (split conformal calibration). The scores of each set are those of factors fitted to
   all others.
3. The confidence, of all maps: logistic, of "the error is below 0.05 of sqrt(area)".

Each set is held out once, with those that share its shapes: all three are fitted to the
others, and the table says of it what share of the errors the radius holds, how the
radius ranks the errors within a pair (Spearman), and what it is beside the error. The
scatter of landmarks that people set is in their errors (`by_people`).

    python -m experiments.fit.calibrate_vertices [RESULT.json] [--out CONSTANTS.json]

RESULT.json is what `vertex_rows.py` writes.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear, minimize
from scipy.special import expit, logit
from scipy.stats import spearmanr

import jfsf
from experiments import command_line
from experiments.accuracy import protocol, vertex_rows
from experiments.fit.reliability import reliability
from jfsf.matching._vertices import COVERED, SURE, VERTEX_EVIDENCE, WITHIN
from jfsf.storage._atomic import write_text

RESULTS = command_line.RESULTS / "vertex_rows.json"
CONSTANTS = Path(jfsf.__file__).parent / "matching" / "vertex_constants.json"
LEAST_ERROR = 0.005  # of sqrt(area): smaller ones are the spacing of the vertices
RIDGE = 1e-3  # on standardised columns, beside the mean loss
# Landmarks by people, on shapes whose parts need not correspond exactly.
BY_PEOPLE = "shrec07", "shrec20_full", "calcanei", "mouse_skulls"


class Side(NamedTuple):
    """Points of one direction of a pair.

    evidence: (p, f).
    errors: (p,) geodesic, in sqrt(area).
    confidence: of the whole map.
    right: whether it is right on the whole.
    """

    evidence: np.ndarray
    errors: np.ndarray
    confidence: float
    right: bool


class Fitted(NamedTuple):
    """Constants and factors: (1 + f,) of the radius, (3,) of the confidence."""

    factors: np.ndarray
    confidence: np.ndarray


Sets = dict[str, list[Side]]


def main() -> None:
    parser = command_line.parser(__doc__, out=CONSTANTS)
    parser.add_argument("results", type=Path, nargs="?", default=RESULTS)
    args = command_line.parse(parser)
    write_text(args.out, text_of(args.results))
    print(args.out.read_text())


def text_of(path: Path) -> str:
    """What the file of constants holds, fitted to these results."""
    sets: Sets = {}
    for row in json.loads(path.read_text(encoding="utf-8"))["pairs"]:
        right = protocol.is_right(row["error"])
        for side in row["vertices"].values():
            columns = vertex_rows.from_row(side)
            sets.setdefault(row["set"], []).append(
                Side(*columns, row["confidence"], right)
            )
    return json.dumps(calibrate(sets), indent=1) + "\n"


def calibrate(sets: Sets) -> dict[str, Any]:
    """Constants, what they were fitted to, and the scores of fits to all other sets."""
    shipped = fit(sets)
    names = ("constant", *VERTEX_EVIDENCE)
    held_out = {name: fit(without(sets, name)) for name in sets}
    table = {
        name: {"by_people": name in BY_PEOPLE} | scores(own, held_out[name])
        for name, own in sets.items()
    }
    found = [
        expit(_columns(side, held_out[name].factors) @ held_out[name].confidence)
        for name, own in sets.items()
        for side in own
    ]
    return {
        "factors": _named(names, shipped.factors),
        "confidence": _named(("constant", "margin", "likely"), shipped.confidence),
        "radius": f"{COVERED} of the errors of right maps are below",
        "right": f"mean geodesic error below {protocol.RIGHT} of sqrt(area)",
        "held_out": {
            "median_of_sets": {
                key: round(float(np.median([row[key] for row in table.values()])), 3)
                for key in ("coverage", "spearman", "radius_by_error")
            },
            "confidence": _held(np.concatenate(found), sets),
        },
        "sets": table,
    }


def fit(sets: Sets) -> Fitted:
    """All constants."""
    every = sets
    sets = {name: [s for s in own if s.right] for name, own in sets.items()}
    sets = {name: own for name, own in sets.items() if own}
    factors, (errors, weights) = regressed(sets), _joined(sets)[1:]
    found = [
        log_radius(side, regressed(without(sets, name) if len(sets) > 1 else sets))
        for name, own in sets.items()
        for side in own
    ]
    margin = quantile(np.log(np.maximum(errors, 1e-9)) - np.concatenate(found), weights)
    factors[0] += margin
    return Fitted(factors, _logistic(every, factors))


def regressed(sets: Sets) -> np.ndarray:
    """Constant and factors of the logarithm of the error."""
    columns, errors, weights = _joined(sets)
    centre = weights @ columns
    spread = np.sqrt(weights @ (columns - centre) ** 2)
    scaled = np.column_stack([np.ones(len(errors)), (columns - centre) / spread])
    each = np.sqrt(weights)
    f = columns.shape[1]
    rows = np.vstack([scaled * each[:, None], np.sqrt(RIDGE) * np.eye(f + 1)[1:]])
    wanted = np.append(np.log(errors + LEAST_ERROR) * each, np.zeros(f))
    b = lsq_linear(rows, wanted, ([-np.inf] + [0] * f, np.inf)).x
    factors = b[1:] / spread
    return np.array([b[0] - factors @ centre, *factors])


def log_radius(side: Side, factors: np.ndarray) -> np.ndarray:
    """The logarithm of the radius, as `jfsf.matching.vertex_radius` gives it."""
    return factors[0] + side.evidence @ factors[1:]


def quantile(values: np.ndarray, weights: np.ndarray, share: float = COVERED) -> float:
    """The least of the values that so large a share of them does not exceed.

    Args:
        values, weights: (p,) each; infinity, with the mean weight, is one value more:
            that of a vertex to come (split conformal prediction).
    """
    values = np.append(values, np.inf)
    weights = np.append(weights, weights.mean())
    order = np.argsort(values)
    below = np.cumsum(weights[order]) / weights.sum()
    return float(values[order][np.searchsorted(below, share - 1e-12)])


def _columns(side: Side, factors: np.ndarray) -> np.ndarray:
    """What the confidence is read from (p, 3), as `jfsf.matching.vertex_confidence`."""
    margin = np.log(WITHIN) - log_radius(side, factors)
    one = np.ones(len(margin))
    likely = logit(np.clip(side.confidence, 1 - SURE, SURE))
    return np.column_stack([one, margin, likely * one])


def _logistic(sets: Sets, factors: np.ndarray) -> np.ndarray:
    """Constant and factors (3,) of the confidence; these are not negative."""
    columns = np.vstack([_columns(s, factors) for own in sets.values() for s in own])
    _, errors, weights = _joined(sets)
    sign = np.where(errors < WITHIN, 1, -1)

    def loss(b):
        margin = sign * (columns @ b)
        slope = columns.T @ (-weights * sign * expit(-margin))
        return weights @ np.logaddexp(0, -margin), slope

    bounds = [(None, None), (0, None), (0, None)]
    how: Any = {"jac": True, "method": "L-BFGS-B", "bounds": bounds}
    return minimize(loss, np.zeros(3), **how).x


def without(sets: Sets, name: str) -> Sets:
    """All but a set."""
    return {key: own for key, own in sets.items() if key != name}


def scores(own: list[Side], fitted: Fitted) -> dict[str, Any]:
    """How well the radius holds on a set that it was not fitted to."""
    right = [side for side in own if side.right]
    radius = [np.exp(log_radius(side, fitted.factors)) for side in right]
    held = [(s.errors <= r).mean() for s, r in zip(right, radius, strict=True)]
    ranks = [spearmanr(s.errors, r)[0] for s, r in zip(right, radius, strict=True)]
    error = np.median(np.concatenate([side.errors for side in right]))
    found = np.median(np.concatenate(radius))
    values = {
        "coverage": np.mean(held),
        "spearman": np.nanmedian(ranks),
        "error": error,
        "radius": found,
        "radius_by_error": found / error,
    }
    sizes = {"pairs": len(own) // 2, "right": len(right) // 2}
    return sizes | {name: round(float(value), 4) for name, value in values.items()}


def _held(found: np.ndarray, sets: Sets) -> dict[str, float]:
    """How well the confidence of all points holds, of right maps and wrong ones."""
    _, errors, weights = _joined(sets)
    right = errors < WITHIN
    held = reliability(found, right, weights=weights)
    values = weights @ found, weights @ right, held.calibration_error
    names = "probability", "right", "calibration_error"
    return dict(zip(names, (round(float(v), 3) for v in values), strict=True))


def _joined(sets: Sets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evidence (p, f), errors and weights (p,) of all points; the weights sum to 1."""
    sides = [(side, len(own)) for own in sets.values() for side in own]
    weights = [np.full(len(s.errors), 1 / len(s.errors) / n) for s, n in sides]
    return (
        np.concatenate([side.evidence for side, _ in sides]),
        np.concatenate([side.errors for side, _ in sides]),
        np.concatenate(weights) / len(sets),
    )


def _named(names, values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.round(4).tolist(), strict=True))


if __name__ == "__main__":
    main()
