"""Fit what ranks the maps of parts: `WEIGHTS` of jfsf/matching/parts/_starts.py; and
how likely a map of parts is right: jfsf/matching/regions.json.

Of each pair of the sets of parts, and of pairs that are made of whole shapes
(`made_parts.py`): all starts of `match(partial=True)`, with what is read of them
(residual, energy, share, and where a network sees people the agreement) and the error
of the map of coarse copies; then the maps of the first few between the regions,
refined, with log odds and errors. And, but for the made pairs, the starts where units
may differ.

Weights are those of a conditional logit (McFadden 1974): within a pair, the chance of a
map to be the right one is proportional to exp(-weights . figures). Right is below
`protocol.RIGHT`, or within 0.01 of the best of the pair; pairs whose best is worse than
0.2 teach nothing. They are fitted to the sets with the role "fit" (`protocol.py`):
those of the cost first, then that of the agreement beside the cost, then those of the
log odds and, to the starts where units may differ, of the size beside both. How often
the first map is right, by the weights of the package, is said of every set.

The confidence (`region_confidence`) is a logistic regression of a mean
error below `protocol.RIGHT` over the refined maps of the same sets, each pair counting
1. Its constant is such that the mean over the maps that are chosen is the share of the
right ones among these: they are right more often than others of the same evidence.
`confidence` has what it scores on each set that it was not fitted to, and by factors
that were fitted to all sets but one on that one, `held_out`: of all refined maps, and
of those that are chosen.

Starts are ranked, and so the refined ones chosen, by the weights that the package has
when the rows are made.

`stops` says the same if no other map is tried after one with so much log odds
(`PartSettings.sure`), and `tries` if so many are tried at most
(`PartSettings.refined`). A killed run goes on from what it has written.

    python -m experiments.fit.fit_parts --data ROOT [--sets becos_pf] \\
        [--out RESULT.json]
"""

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import expit

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, made_parts, protocol
from experiments.fit import calibration
from jfsf.geometry import GeodesicSolver
from jfsf.learned._inputs import EIGENPAIRS
from jfsf.learned._places import Places
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._people import places_of_parts
from jfsf.matching.parts import PartSettings
from jfsf.matching.parts import _match as parts
from jfsf.matching.parts._sides import both_sides
from jfsf.matching.parts._starts import WEIGHTS, Start, first_starts
from jfsf.mesh import surface_area
from jfsf.mesh._closest import nearest_vertices
from jfsf.runtime._runners import OneByOne
from jfsf.spectral import spectrum

SETS = "becos_pf", "becos_pp", "psmal"
MADE = "made_parts"  # of sets with the role "fit"
SETTINGS = PartSettings()
NEAR_BEST, HOPELESS = 0.01, 0.2
RIDGE = 0.02  # of the squared weights, against few pairs
POINTS = 250  # of ground truth, at most, in each pair
FIGURES = "residual", "energy", "share"  # of the cost
RANK = *FIGURES, "agreement"
REGIONS = Path(jfsf.__file__).parent / "matching" / "regions.json"
ANY = np.array([-50, 50])  # where a constant is looked for
# Of what tells right regions: whether more of it speaks for a map.
SIGNS = {"log_odds": 1, "region_cost": -1, "of_people": 0, "person_agreement": 1}
ENOUGH = 1.5, 2.0, 2.5, 3.0, 3.5, 4.0  # log odds
REFINED = 4  # maps a pair


def main() -> None:
    parser = command_line.parser(
        "Fit what ranks the maps of parts.", out="fit_parts.json", data=True
    )
    every = *SETS, MADE
    parser.add_argument("--sets", nargs="+", choices=every, default=every)
    args = command_line.parse(parser)
    rows = json.loads(args.out.read_text())["rows"] if args.out.exists() else []
    known = {(row["set"], row["x"], row["y"]) for row in rows}
    for name in args.sets:
        for about, load in pairs_of(name, Path(args.data)):
            key = name, about["x"], about["y"]
            if key in known:
                continue
            x, y = load()
            found = candidates(x, y)
            found["starts_any_unit"] = [] if name == MADE else of_any_unit(x, y)
            rows.append({"set": name, **about, **found})
            best = min(one["error"] for one in found["starts"])
            print(*key, f"best start {best:.3f}", flush=True)
            write(args.out, rows)
    print(json.dumps(write(args.out, rows), indent=1))
    factors = fit_confidence(rows)
    if factors:
        REGIONS.write_text(regions(factors), encoding="utf-8")


def pairs_of(name: str, root: Path) -> Iterator[tuple[dict, Callable]]:
    """Role and names of the shapes of each pair of a set, and what loads both."""
    if name == MADE:
        for pair in made_parts.pairs(root):
            about = {"role": "fit", "x": pair.name, "y": ""}
            yield about, partial(tuple, (pair.x, pair.y))
        return
    data_set = protocol.below(protocol.SETS[name], root)
    for i, pair in enumerate(datasets.pairs_of(data_set)):
        about = {"role": data_set.role(i), "x": pair.x, "y": pair.y}
        yield about, partial(datasets.load_pair_of, data_set, pair)


def regions(factors: dict[str, float]) -> str:
    """The text of the file that the package loads."""
    return json.dumps({"script": Path(__file__).name, "factors": factors}, indent=1)


def write(path: Path, rows: list[dict]) -> dict:
    """Write all that is known, and return what is not a row of a pair."""
    settings = {"fitted to": "sets with the role fit", "shipped": shipped()}
    found = {"fitted": fit(rows), "right": right(rows)}
    sure, most = SETTINGS.sure, SETTINGS.refined
    found["stops"] = {str(e): chosen(rows, e, most) for e in ENOUGH}
    found["confidence"] = {
        "factors": fit_confidence(rows),
        "scores": confidence_scores(rows),
    }
    found["tries"] = {str(n): chosen(rows, sure, n) for n in range(1, REFINED + 1)}
    results_file.write(path, settings=settings, **found, rows=rows)
    return found


def shipped() -> dict[str, float]:
    """The weights of the package."""
    return WEIGHTS._asdict()


def candidates(x: datasets.Shape, y: datasets.Shape) -> dict:
    """Figures and errors of the starts of a pair, and of the refined first few."""
    x, y, swapped = in_order(x, y)
    error = errors_of(x, y)
    sides = both_sides(x.mesh, y.mesh, places=places_of(x, y), settings=SETTINGS)
    begin = [start for _, start in first_starts(sides, 1)]
    refined = []
    for start in begin[:REFINED]:
        after = parts._refined(parts._drawn(sides, start), sides, refine)
        if after is not None:
            own = {"error": error(after.T_xy), "log_odds": after.log_odds}
            refined.append(own | figures(start))
    found = _coarse(sides, begin, error)
    return {"swapped": swapped, "starts": found, "refined": refined}


def _coarse(sides, begin: list[Start], error: Callable) -> list[dict]:
    """Figures of starts, and errors of their maps of coarse copies."""
    near = nearest_vertices(sides.coarse_x, sides.x.mesh)
    return [
        {"error": error(sides.on_y[start.registered.T[near]]), **figures(start)}
        for start in begin
    ]


def of_any_unit(x: datasets.Shape, y: datasets.Shape) -> list[dict]:
    """Figures and errors of the starts of a pair whose units may differ.

    `size` is the factor of the part's lengths.
    """
    x, y, _ = in_order(x, y, same_unit=False)
    error = errors_of(x, y)
    options = {"places": places_of(x, y), "same_unit": False, "settings": SETTINGS}
    sides = both_sides(x.mesh, y.mesh, **options)
    begin = [start for _, start in first_starts(sides, 1)]
    return [
        {**one, "size": float(start.scale / start.registered.scale)}
        for one, start in zip(_coarse(sides, begin, error), begin, strict=True)
    ]


def places_of(x: datasets.Shape, y: datasets.Shape) -> Places | None:
    """Where on a person the vertices of both lie, as `match` asks for it."""
    spectra = spectrum(x.mesh, EIGENPAIRS), spectrum(y.mesh, EIGENPAIRS)
    return places_of_parts(spectra, MatchInputs(sign=1), OneByOne(), jfsf.Settings())


def in_order(
    x: datasets.Shape, y: datasets.Shape, same_unit: bool = True
) -> tuple[datasets.Shape, datasets.Shape, bool]:
    """The part, the whole, and whether they were exchanged."""
    open_x, open_y = (parts.openness(one.mesh, same_unit) for one in (x, y))
    return (y, x, True) if open_x < open_y else (x, y, False)


def errors_of(x: datasets.Shape, y: datasets.Shape) -> Callable[[np.ndarray], float]:
    """A function from T_xy to its mean error, as a share of sqrt(area of Y)."""
    some = np.random.default_rng(0).permutation(len(x.truth))[:POINTS]
    rows = GeodesicSolver(y.mesh).rows(y.truth[some]) / np.sqrt(surface_area(y.mesh))
    return lambda T_xy: float(rows[np.arange(len(some)), T_xy[x.truth[some]]].mean())


def figures(start: Start) -> dict[str, float | None]:
    """What ranks a start; no agreement without places."""
    agreed = None if np.isnan(start.agreement) else start.agreement
    read = {name: float(getattr(start.registered, name)) for name in FIGURES}
    return {**read, "agreement": agreed}


def refine(part_x, part_y, T_xy):
    """As `match(partial=True)` refines the map between two regions."""
    settings = jfsf.Settings(retry_below=0)
    return jfsf.match(part_x, part_y, initial=T_xy, settings=settings)


def columns(maps: list[dict], names: Sequence[str]) -> np.ndarray:
    """(maps, names); logarithms, but log odds and agreements as they are, none as 0."""
    logs = *FIGURES, "size"
    log = lambda name, value: np.log(max(value, 1e-6)) if name in logs else value or 0
    return np.array([[log(name, one[name]) for name in names] for one in maps])


def fit(rows: list[dict]) -> dict[str, float]:
    """Weights, that of the energy being 1; empty before there is a pair to fit to."""
    own = [row for row in rows if row["role"] == "fit"]
    first = _logit([row["starts"] for row in own], FIGURES)
    if first is None or first[1] <= 0:
        return {}
    weights: dict[str, float] = dict(zip(FIGURES, first / first[1], strict=True))

    def with_rank(maps: list[dict], names: tuple[str, ...]) -> list[dict]:
        ranks = columns(maps, names) @ [weights[name] for name in names]
        return [one | {"rank": r} for one, r in zip(maps, ranks, strict=True)]

    others = {"agreement": "starts", "log_odds": "refined", "size": "starts_any_unit"}
    for name, kind in others.items():
        beside = RANK if "agreement" in weights else FIGURES
        some = [with_rank(row[kind], beside) for row in own if row[kind]]
        second = _logit(some, ("rank", name))
        if second is not None and second[0] > 0:
            weights[name] = second[1] / second[0]
    return {name: round(float(w), 2) for name, w in weights.items()}


def fit_confidence(rows: list[dict], role: str = "fit") -> dict[str, float]:
    """Factors of the confidence; empty before right and wrong maps were chosen."""
    own = [row for row in rows if role in (row["role"], "all") and row["refined"]]
    first = [chosen_of(row["refined"]) for row in own]
    share = np.mean([protocol.is_right(one["error"]) for one in first] or [0])
    if not 0 < share < 1:
        return {}
    maps = [one for row in own for one in row["refined"]]
    weight = [1 / len(row["refined"]) for row in own for _ in row["refined"]]
    right = np.array([protocol.is_right(one["error"]) for one in maps])
    fitted = calibration.fit(_evidence(maps), right, np.array(weight), SIGNS)
    z = _evidence(first) @ fitted[1:]
    fitted[0] = brentq(lambda b: expit(b + z).mean() - share, *(-z.mean() + ANY))
    names = "constant", *SIGNS
    return {n: round(float(b), 3) for n, b in zip(names, fitted, strict=True)}


def _evidence(maps: list[dict]) -> np.ndarray:
    """(maps, 4) in the order of `SIGNS`; the cost by the weights of the package."""
    weights = [shipped()[name] for name in FIGURES]
    cost = columns(maps, FIGURES) @ weights
    seen = [one["agreement"] is not None for one in maps]
    return np.column_stack(
        [columns(maps, ["log_odds"]), cost, seen, columns(maps, ["agreement"])]
    )


def confidence_scores(rows: list[dict]) -> dict[str, dict]:
    """Of each set: how well the confidence holds and tells right maps from wrong."""
    found: dict[str, dict] = {}
    for name in dict.fromkeys(row["set"] for row in rows):
        own = [row for row in rows if row["set"] == name and row["refined"]]
        others = [row for row in rows if row["set"] != name]
        by = {"held_out": fit_confidence(others, "all")}
        if own[0]["role"] != "fit":
            by["shipped"] = fit_confidence(rows)
        every = [one for row in own for one in row["refined"]]
        kinds = {"maps": every, "chosen": [chosen_of(row["refined"]) for row in own]}
        for key, factors in by.items():
            if factors:
                b = np.array(list(factors.values()))
                found[f"{name}, {key}"] = {
                    kind: calibration.scores(
                        expit(b[0] + _evidence(maps) @ b[1:]),
                        np.array([protocol.is_right(one["error"]) for one in maps]),
                    )
                    for kind, maps in kinds.items()
                }
    return found


def _logit(choices: list[list[dict]], names: Sequence[str]) -> np.ndarray | None:
    """Weights of the conditional logit, or None without a pair that teaches."""
    data = []
    for maps in choices:
        error = np.array([one["error"] for one in maps])
        if not len(error) or error.min() >= HOPELESS:
            continue
        good = error < max(protocol.RIGHT, error.min() + NEAR_BEST)
        if not good.all():
            data.append((columns(maps, names), good))

    def loss(w):
        chances = [(np.exp(-(x - x.min(0)) @ w), good) for x, good in data]
        return RIDGE * w @ w - sum(
            np.log(p[good].sum() / p.sum()) for p, good in chances
        )

    return minimize(loss, np.zeros(len(names))).x if data else None


def right(rows: list[dict]) -> dict[str, dict]:
    """Of each set: pairs whose first, or any, start and refined map is right."""
    weights = shipped()
    by_rank = lambda one, names: columns([one], names)[0] @ [weights[n] for n in names]
    found: dict[str, dict] = {}
    for name in dict.fromkeys(row["set"] for row in rows):
        own = [row for row in rows if row["set"] == name]
        row = {"role": own[0]["role"], "pairs": len(own)}
        kinds: dict[str, tuple[str, ...]] = {
            "starts": RANK,
            "starts_any_unit": (*RANK, "size"),
            "refined": (*RANK, "log_odds"),
        }
        for kind, names in kinds.items():
            maps = [one[kind] for one in own if one[kind]]
            first = [min(m, key=lambda one: by_rank(one, names))["error"] for m in maps]
            best = [min(one["error"] for one in m) for m in maps]
            row[f"{kind}: first right"] = sum(map(protocol.is_right, first))
            row[f"{kind}: any right"] = sum(map(protocol.is_right, best))
        found[name] = row
    return found


def chosen_of(
    refined: list[dict], enough: float = SETTINGS.sure, most: int = SETTINGS.refined
) -> dict:
    """The map that is chosen; `tried` is how many were refined for it.

    Args:
        refined: maps of a pair.
        enough, most: as `chosen`.
    """
    names = *RANK, "log_odds"
    weights = np.array([shipped()[name] for name in names])
    rank = lambda one: columns([one], RANK)[0] @ weights[:-1]
    maps = sorted(refined, key=rank)[:most]
    first = [i for i, m in enumerate(maps) if m["log_odds"] >= enough]
    some = maps[: first[0] + 1] if first else maps
    best = (columns(some, names) @ weights).argmin()
    return some[best] | {"tried": len(some)}


def chosen(rows: list[dict], enough: float, most: int) -> dict[str, dict]:
    """Right maps of each set, their mean error, and maps refined a pair.

    Args:
        rows: of the pairs.
        enough: log odds after which no other map is tried.
        most: maps that are tried at most.
    """
    found: dict[str, dict] = {}
    for name in dict.fromkeys(row["set"] for row in rows):
        own = [row["refined"] for row in rows if row["set"] == name and row["refined"]]
        maps = [chosen_of(refined, enough, most) for refined in own]
        errors = [one["error"] for one in maps]
        found[name] = {
            "right": sum(map(protocol.is_right, errors)),
            "error": float(np.mean(errors)),
            "refined": float(np.mean([one["tried"] for one in maps])),
        }
    return found


if __name__ == "__main__":
    main()
