"""Fit the confidence of a map, and test it on data sets that it was not fitted to.

Reads what match_pairs.py writes of whole shapes, one file a data set: match_SET.json,
with match_SET_exhaustive.json and twins_SET.json (wrong maps of the same shapes) where
there are such. Writes jfsf/evidence/confidence.json, which says of each set what was
found there. `protocol.py` says which sets the constants are fitted to, and which map is
right. Two logistic regressions, see `jfsf.evidence.confidence`:

1. of an attempt alone. Attempts beside the first of a pair, and twins, count less: they
   are wrong far more often than the maps that people get.
2. of the match of each pair that was compared with others on coarse copies.

For the scores each set is left out in turn, together with those that share its shapes.
The area under the ROC curve is that of the confidence of matches; the calibration error
is in ten bins.

    python experiments/calibration.py [--results FOLDER] [--out CONSTANTS.json]
"""

import argparse
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import protocol
from scipy.optimize import minimize
from scipy.special import expit, logit
from scipy.stats import mannwhitneyu

from jfsf.evaluate import reliability
from jfsf.evidence import column
from jfsf.report import LIKELY
from jfsf.storage import write_text

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results"
CONSTANTS = FOLDER.parent / "jfsf" / "evidence" / "confidence.json"
# What a figure of the certificate says: 1 if more of it speaks for a map, -1 against.
EVIDENCE = {"orientation": 1, "residual": -1, "shear": -1, "area_std": -1}
OTHERS, TWINS = 0.3, 0.1  # what attempts beside the first count, and twins
SCALE, MOST_MARGIN = 1.5, 3.0
RIDGE = 1.0  # on standardised columns, beside the summed loss
UNSURE = 0.7
# Sets that share shapes are left out together.
TOGETHER = {"shrec07_more": "shrec07"}


class Attempts(NamedTuple):
    """Attempts of many pairs, (a,) each.

    columns: (a, e) evidence, as `jfsf.evidence.column` reads it.
    right, weight: whether each is, and what it counts.
    """

    columns: np.ndarray
    right: np.ndarray
    weight: np.ndarray


class Matches(NamedTuple):
    """The match of each of many pairs, (p,) each.

    columns: (p, e) its evidence.
    margin: log(share / (1 - share)); nan if it was not compared.
    right: whether it is.
    """

    columns: np.ndarray
    margin: np.ndarray
    right: np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--out", type=Path, default=CONSTANTS)
    args = parser.parse_args()
    write_text(args.out, text_of(args.results))
    print(args.out.read_text())


def text_of(folder: Path) -> str:
    """What the file of constants holds, fitted to the results in this folder."""
    sets = {name: read(folder, name) for name in whole_sets()}
    return json.dumps(calibrate({n: s for n, s in sets.items() if s}), indent=1) + "\n"


def whole_sets() -> list[str]:
    """Names of the sets of whole shapes, in the order of the protocol."""
    return [name for name, row in protocol.SETS.items() if row.kind != "part"]


def read(folder: Path, name: str) -> tuple[Attempts, Matches] | None:
    """The results of a set; None if there are none."""
    path = folder / f"match_{name}.json"
    if not path.exists():
        return None
    pairs = json.loads(path.read_text())["pairs"]
    rows = [(own, 1.0 if i == 0 else OTHERS) for p in pairs for i, own in _tried(p)]
    for other, weight in (
        (f"match_{name}_exhaustive", OTHERS),
        (f"twins_{name}", TWINS),
    ):
        path = folder / f"{other}.json"
        more = json.loads(path.read_text())["pairs"] if path.exists() else []
        # The first attempt is in the other file already.
        first = 1 if weight == OTHERS else 0
        rows += [(own, weight) for p in more for i, own in _tried(p) if i >= first]
    attempts = Attempts(
        np.array([_columns(own) for own, _ in rows]),
        np.array([protocol.is_right(own["error"]) for own, _ in rows]),
        np.array([weight for _, weight in rows]),
    )
    share = np.array([_number(p["share"]) for p in pairs])
    matches = Matches(
        np.array([_columns(p) for p in pairs]),
        np.where(np.isnan(share), np.nan, logit(np.clip(share, 1e-9, 1 - 1e-9))),
        np.array([protocol.is_right(p["error"]) for p in pairs]),
    )
    return attempts, matches


def calibrate(sets: dict[str, tuple[Attempts, Matches]]) -> dict[str, Any]:
    """Constants, what they were fitted to, and scores of fits to other sets."""
    fitted = [name for name in sets if "fit" in protocol.SETS[name].roles]
    alone, compared = fit_both([sets[name] for name in fitted])
    held_out = {}
    for name, (_, matches) in sets.items():
        group = TOGETHER.get(name, name)
        others = [s for n, s in sets.items() if TOGETHER.get(n, n) != group]
        held_out[name] = predict(*fit_both(others), matches)
    right = {name: matches.right for name, (_, matches) in sets.items()}
    join = lambda values: np.concatenate(list(values.values()))
    names = ("constant", *EVIDENCE)
    return {
        "alone": dict(zip(names, alone.round(3).tolist(), strict=True)),
        "compared": {
            "scale": SCALE,
            "most_margin": MOST_MARGIN,
            **dict(
                zip(
                    ("constant", "log_odds", "margin"),
                    compared.round(3).tolist(),
                    strict=True,
                )
            ),
        },
        "right": f"mean geodesic error below {protocol.RIGHT} of sqrt(area)",
        "fitted_to": fitted,
        "held_out": {
            "all": scores(join(held_out), join(right)),
            **{name: scores(held_out[name], right[name]) for name in sets},
        },
        "as_shipped": {
            name: scores(predict(alone, compared, matches), matches.right)
            for name, (_, matches) in sets.items()
            if name not in fitted
        },
    }


def fit_both(sets: list[tuple[Attempts, Matches]]) -> tuple[np.ndarray, np.ndarray]:
    """Factors of a map alone, (1 + e,), and of one that was compared, (3,)."""
    attempts, matches = (
        type(parts[0])(*map(np.concatenate, zip(*parts, strict=True)))
        for parts in zip(*sets, strict=True)
    )
    signs = list(EVIDENCE.values())
    alone = fit(attempts.columns, attempts.right, attempts.weight, signs)
    known = ~np.isnan(matches.margin)
    columns = _compared(alone, matches)[known]
    ones = np.ones(known.sum())
    return alone, fit(columns, matches.right[known], ones, [1, 1])


def predict(alone: np.ndarray, compared: np.ndarray, matches: Matches) -> np.ndarray:
    """The confidence of each match."""
    z = alone[0] + matches.columns @ alone[1:]
    among = compared[0] + _compared(alone, matches) @ compared[1:]
    return expit(np.where(np.isnan(matches.margin), z, among))


def fit(
    columns: np.ndarray, right: np.ndarray, weight: np.ndarray, signs: list[int]
) -> np.ndarray:
    """Constant and factors of a logistic regression, with these signs or 0."""
    centre, spread = columns.mean(0), columns.std(0)
    scaled = (columns - centre) / spread
    side = np.where(right, 1, -1)

    def loss(b):
        margin = side * (b[0] + scaled @ b[1:])
        slope = -weight * side * expit(-margin)
        value = weight @ np.logaddexp(0, -margin) + RIDGE * (b[1:] ** 2).sum() / 2
        return value, np.array([slope.sum(), *(scaled.T @ slope + RIDGE * b[1:])])

    bounds = [(None, None), *((0, None) if s > 0 else (None, 0) for s in signs)]
    options: Any = {"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000}
    start = np.zeros(1 + len(centre))
    b = minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options
    ).x
    factors = b[1:] / spread
    return np.array([b[0] - factors @ centre, *factors])


def scores(found: np.ndarray, right: np.ndarray) -> dict[str, Any]:
    """How well the confidence holds, and tells right maps from wrong ones."""
    held = reliability(found, right)
    values = {"pairs": len(right), "wrong": int((~right).sum())}
    if right.any() and not right.all():
        area = mannwhitneyu(found[right], found[~right]).statistic
        values["auc"] = round(float(area / right.sum() / (~right).sum()), 3)
    values["calibration_error"] = round(float(held.calibration_error), 3)
    values["sure"] = int((found >= LIKELY).sum())
    values["wrong_of_sure"] = int((~right & (found >= LIKELY)).sum())
    values["right_below_0.7"] = int((right & (found < UNSURE)).sum())
    return values


def _tried(pair: dict[str, Any]) -> list[tuple[int, dict[str, Any]]]:
    return list(enumerate(pair["attempts"]))


def _columns(figures: dict[str, Any]) -> list[float]:
    return [float(column(name, _number(figures[name]))) for name in EVIDENCE]


def _compared(alone: np.ndarray, matches: Matches) -> np.ndarray:
    z = alone[0] + matches.columns @ alone[1:]
    return np.column_stack([z, np.minimum(matches.margin, MOST_MARGIN)])


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


if __name__ == "__main__":
    main()
