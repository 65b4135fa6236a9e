"""Fit the confidence of a map, and test it on data sets that it was not fitted to.

Reads what match_pairs.py writes of whole shapes, one file a data set: match_SET.json,
with match_SET_exhaustive.json and twins_SET.json (wrong maps of the same shapes) where
there are such. Writes jfsf/matching/confidence.json, which says of each set what was
found there. `protocol.py` says which sets the constants are fitted to, and which map is
right. Three regressions, see `jfsf.matching.confidence`:

1. logistic, of an attempt alone. Attempts beside the first of a pair, and twins, count
   less: they are wrong far more often than the maps that people get.
2. conditional logistic (McFadden 1974), of the maps of the coarse copies of each pair:
   which of them are right, if some are. With other factors other maps are chosen and
   other shares found, so those with which the results were made are kept (`RANK`), and
   what a fit to the results gives stands beside them. Put that into `RANK` and run
   match_pairs.py again where it ranks better. The factor of `person_agreement` was
   chosen by the mean error of the maps that rank first (`first_error_of_people`).
3. logistic, of the match of each pair that was compared with others on copies. A match
   that other maps beat has a small share: `match` keeps one only if it was given. None
   of the right ones has a share below `least_share`, so there the confidence falls in
   proportion to the share. With a share s it is at most (1 + s) / 2: with each set left
   out this makes fewer sure maps wrong, at an equal loss. At most s is too little.

For the scores each set is left out in turn, together with those that share its shapes.
The area under the ROC curve is that of the confidence of matches; the calibration error
is in ten bins. With a probability of 0.95 the share of wrong maps among the sure ones
is below `wrong_at_most` (Clopper and Pearson 1934). Rounded to hundredths it is LEAST
of collections: there no confidence counts for more than 1 - LEAST.

    python -m experiments.fit.calibration [--results FOLDER] [--out CONSTANTS.json]
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logsumexp
from scipy.stats import beta, mannwhitneyu

import jfsf
from experiments import command_line
from experiments.accuracy import protocol
from experiments.fit.reliability import reliability
from jfsf.apps.report._words import LIKELY
from jfsf.matching._confidence import regressor
from jfsf.storage._atomic import write_text

RESULTS = command_line.RESULTS
CONSTANTS = Path(jfsf.__file__).parent / "matching" / "confidence.json"
# What a figure of the certificate says: 1 if more of it speaks for a map, -1 against.
EVIDENCE = {"orientation": 1, "shear": -1, "normal_gap": -1}
RANKED_BY = {"residual": -1, "area_std": -1, "nn_agreement": 1, "person_agreement": 1}
RANK = {"residual": -6.6, "area_std": -4.9, "nn_agreement": 29.0}
RANK |= {"person_agreement": 9.0}
# What else its factor might be; from 9 on it is nearly the same which maps rank first.
OF_PEOPLE = 0, 3, 6, 9, 12, 15, 20, 25
OTHERS, TWINS = 0.1, 0.1  # what attempts beside the first count, and twins
# A margin between ranks counts by SCALE; beyond MOST_MARGIN it says no more.
SCALE, MOST_MARGIN = 0.5, 3.0
RIDGE = 1.0  # on standardised columns, beside the summed loss
UNSURE = 0.7
# Maps of a pair that are nearly right tell nothing of what ranks them.
SURELY_WRONG = 0.12
# Sets that share shapes are left out together.
TOGETHER = {"shrec07_more": "shrec07"}


class Attempts(NamedTuple):
    """Attempts of many pairs, (a,) each.

    columns: (a, e) evidence, as `jfsf.matching._confidence.regressor` reads it.
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


class Results(NamedTuple):
    """What is known of a set.

    attempts: of all its files.
    matches: of its pairs, for the scores.
    compared: those, and others that were compared with maps of copies.
    copies: of each pair the evidence (c, r) of the maps of its copies, and errors (c,).
    """

    attempts: Attempts
    matches: Matches
    compared: Matches
    copies: list[tuple[np.ndarray, np.ndarray]]


class Constants(NamedTuple):
    """Factors of a map alone (1 + e,), of the rank (r,), of a map compared (3,).

    least_share: of the right maps that were compared.
    """

    alone: np.ndarray
    rank: np.ndarray
    compared: np.ndarray
    least_share: float


def main() -> None:
    parser = command_line.parser(__doc__, out=CONSTANTS)
    parser.add_argument("--results", type=Path, default=RESULTS)
    args = command_line.parse(parser)
    write_text(args.out, text_of(args.results))
    print(args.out.read_text())


def text_of(folder: Path) -> str:
    """What the file of constants holds, fitted to the results in this folder."""
    return json.dumps(calibrate(read_all(folder)), indent=1) + "\n"


def read_all(folder: Path) -> dict[str, Results]:
    """All sets of whole shapes that have results."""
    sets = {name: read(folder, name) for name in whole_sets()}
    return {name: own for name, own in sets.items() if own is not None}


def whole_sets() -> list[str]:
    """Names of the sets of whole shapes, in the order of the protocol."""
    return [name for name, row in protocol.SETS.items() if row.kind != "part"]


def read(folder: Path, name: str) -> Results | None:
    """The results of a set; None if there are none."""
    pairs = _pairs(folder / f"match_{name}.json")
    more = _pairs(folder / f"match_{name}_exhaustive.json")
    twins = _pairs(folder / f"twins_{name}.json")
    if not pairs:
        return None
    limit = protocol.SETS[name].right
    rows = [(own, OTHERS if i else 1.0) for p in pairs for i, own in _tried(p)]
    # The first attempt is in the other file already.
    rows += [(own, OTHERS) for p in more for i, own in _tried(p) if i]
    rows += [(own, TWINS) for p in twins for _, own in _tried(p)]
    attempts = Attempts(
        np.array([_columns(own, EVIDENCE) for own, _ in rows]),
        np.array([protocol.is_right(own["error"], limit) for own, _ in rows]),
        np.array([weight for _, weight in rows]),
    )
    copies = [
        (
            np.array([_columns(own, RANKED_BY) for own in p["copies"]]),
            np.array([own["error"] for own in p["copies"]]),
        )
        for p in (*pairs, *more)
        if p["copies"]
    ]
    matches = _matches(pairs, limit)
    return Results(attempts, matches, _matches([*pairs, *more], limit), copies)


def calibrate(sets: dict[str, Results]) -> dict[str, Any]:
    """Constants, what they were fitted to, and scores of fits to other sets."""
    fitted = [name for name in sets if "fit" in protocol.SETS[name].roles]
    shipped = fit_all([sets[name] for name in fitted])
    found = held_out(sets)
    right = {name: own.matches.right for name, own in sets.items()}
    join = lambda values: np.concatenate(list(values.values()))
    every = scores(join(found), join(right))
    compared = _named(("constant", "log_odds", "margin"), shipped.compared)
    compared["least_share"] = round(shipped.least_share, 3)
    return {
        "alone": _named(("constant", *EVIDENCE), shipped.alone),
        "rank": RANK,
        "rank_fitted_to_these": _named(RANKED_BY, shipped.rank),
        "right_map_ranks_first": {
            "rank": first_right(sets, np.array(list(RANK.values()))),
            "rank_fitted_to_these": first_right(sets, shipped.rank),
        },
        "first_error_of_people": people_weights([sets[name] for name in fitted]),
        "compared": {"scale": SCALE, "most_margin": MOST_MARGIN, **compared},
        "right": f"mean geodesic error below {protocol.RIGHT} of sqrt(area)",
        "fitted_to": fitted,
        "held_out": {
            "all": every | {"wrong_at_most": most_wrong(every)},
            **{name: scores(found[name], right[name]) for name in sets},
        },
        "as_shipped": {
            name: scores(predict(shipped, own.matches), right[name])
            for name, own in sets.items()
            if name not in fitted
        },
    }


def held_out(sets: dict[str, Results]) -> dict[str, np.ndarray]:
    """The confidence of each set's matches, by constants fitted to the others."""
    found = {}
    for name, own in sets.items():
        group = TOGETHER.get(name, name)
        others = [s for n, s in sets.items() if TOGETHER.get(n, n) != group]
        found[name] = predict(fit_all(others), own.matches)
    return found


def fit_all(sets: list[Results]) -> Constants:
    """All factors."""
    attempts = Attempts(
        *map(np.concatenate, zip(*(s.attempts for s in sets), strict=True))
    )
    compared = Matches(
        *map(np.concatenate, zip(*(s.compared for s in sets), strict=True))
    )
    alone = fit(attempts.columns, attempts.right, attempts.weight, EVIDENCE)
    known = ~np.isnan(compared.margin)
    columns, ones = _compared(alone, compared)[known], np.ones(known.sum())
    signs = {"log_odds": 1, "margin": 1}
    among = fit(columns, compared.right[known], ones, signs)
    rank = fit_rank([pool for s in sets for pool in s.copies])
    least = float(expit(compared.margin[known & compared.right].min()))
    return Constants(alone, rank, among, least)


def predict(constants: Constants, matches: Matches) -> np.ndarray:
    """The confidence of each match."""
    alone, _, compared, least = constants
    z = alone[0] + matches.columns @ alone[1:]
    among = compared[0] + _compared(alone, matches) @ compared[1:]
    share = expit(matches.margin)
    likely = expit(among) * np.minimum(share / least, 1)
    likely = np.minimum(likely, (1 + share) / 2)
    return np.where(np.isnan(matches.margin), expit(z), likely)


def fit_rank(pools: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Factors by which the right maps of a pair rank above the wrong ones."""
    told = []
    for columns, errors in pools:
        clear = (errors < protocol.RIGHT) | (errors >= SURELY_WRONG)
        right = errors[clear] < protocol.RIGHT
        if right.any() and not right.all():
            told.append((columns[clear] - columns[clear].mean(0), right))
    spread = np.concatenate([columns for columns, _ in told]).std(0)

    def loss(b):
        value, slope = RIDGE * (b**2).sum() / 2, RIDGE * b
        for columns, right in told:
            scaled = columns / spread
            rank = scaled @ b
            every, best = logsumexp(rank), logsumexp(rank[right])
            of_right = np.where(right, np.exp(rank - best), 0)
            value = value + every - best
            slope = slope + scaled.T @ (np.exp(rank - every) - of_right)
        return value, slope

    return _minimum(loss, np.zeros(len(spread)), RANKED_BY) / spread


def first_right(sets: dict[str, Results], rank: np.ndarray) -> float:
    """Share of the pairs with a right map on the copies whose first is right."""
    pools = [pool for own in sets.values() for pool in own.copies]
    best = [errors[np.argmax(columns @ rank)] for columns, errors in pools]
    has = np.array([errors.min() < protocol.RIGHT for _, errors in pools])
    right = np.array(best) < protocol.RIGHT
    return round(float(right[has].mean()), 3)


def people_weights(sets: list[Results]) -> dict[str, float]:
    """Mean error of the first of each two people, by the factor of their agreement."""
    at = [*RANKED_BY].index("person_agreement")
    pools = [pool for own in sets for pool in own.copies if pool[0][:, at].any()]
    rank, found = np.array(list(RANK.values())), {}
    for weight in OF_PEOPLE:
        rank[at] = weight
        best = [errors[np.argmax(columns @ rank)] for columns, errors in pools]
        found[str(weight)] = round(float(np.mean(best)), 4) if best else np.nan
    return found


def fit(
    columns: np.ndarray, right: np.ndarray, weight: np.ndarray, signs: dict[str, int]
) -> np.ndarray:
    """Constant and factors of a logistic regression, with these signs or 0.

    The factor of a column that never changes is 0.
    """
    centre, spread = columns.mean(0), columns.std(0)
    spread[spread == 0] = 1
    scaled = (columns - centre) / spread
    side = np.where(right, 1, -1)

    def loss(b):
        margin = side * (b[0] + scaled @ b[1:])
        slope = -weight * side * expit(-margin)
        value = weight @ np.logaddexp(0, -margin) + RIDGE * (b[1:] ** 2).sum() / 2
        return value, np.array([slope.sum(), *(scaled.T @ slope + RIDGE * b[1:])])

    b = _minimum(loss, np.zeros(1 + len(centre)), {"constant": 0, **signs})
    factors = b[1:] / spread
    return np.array([b[0] - factors @ centre, *factors])


def _minimum(loss, start: np.ndarray, signs: dict[str, int]) -> np.ndarray:
    bound = {1: (0, None), -1: (None, 0), 0: (None, None)}
    bounds = [bound[sign] for sign in signs.values()]
    options: Any = {"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000}
    how = {"jac": True, "method": "L-BFGS-B", "bounds": bounds}
    return minimize(loss, start, options=options, **how).x


def scores(found: np.ndarray, right: np.ndarray) -> dict[str, Any]:
    """How well the confidence holds, and tells right maps from wrong ones."""
    held = reliability(found, right)
    values: dict[str, Any] = {"pairs": len(right), "wrong": int((~right).sum())}
    if right.any() and not right.all():
        area = mannwhitneyu(found[right], found[~right]).statistic
        values["auc"] = round(float(area / right.sum() / (~right).sum()), 3)
    values["calibration_error"] = round(float(held.calibration_error), 3)
    values["sure"] = int((found >= LIKELY).sum())
    values["wrong_of_sure"] = int((~right & (found >= LIKELY)).sum())
    values["right_below_0.7"] = int((right & (found < UNSURE)).sum())
    return values


def most_wrong(every: dict[str, Any]) -> float:
    """What the share of wrong maps among the sure ones is below, with 0.95."""
    wrong, right = every["wrong_of_sure"], every["sure"] - every["wrong_of_sure"]
    return round(float(beta.ppf(0.95, wrong + 1, right)), 4)


def _pairs(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return json.loads(path.read_text(encoding="utf-8"))["pairs"]


def _tried(pair: dict[str, Any]) -> list[tuple[int, dict[str, Any]]]:
    return list(enumerate(pair["attempts"]))


def _matches(pairs: list[dict[str, Any]], limit: float) -> Matches:
    share = np.array([float(p["share"]) for p in pairs])
    within = np.clip(share, 1e-9, 1 - 1e-9)
    return Matches(
        np.array([_columns(p, EVIDENCE) for p in pairs]),
        np.log(within / (1 - within)),
        np.array([protocol.is_right(p["error"], limit) for p in pairs]),
    )


def _columns(figures: dict[str, Any], names: Iterable[str]) -> list[float]:
    # Pairs that were matched before there was a figure lack it.
    return [float(regressor(name, figures.get(name, np.nan), np)) for name in names]


def _compared(alone: np.ndarray, matches: Matches) -> np.ndarray:
    z = alone[0] + matches.columns @ alone[1:]
    return np.column_stack([z, np.minimum(matches.margin, MOST_MARGIN)])


def _named(names: Iterable[str], values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.round(3).tolist(), strict=True))


if __name__ == "__main__":
    main()
