"""How likely the mirror image of a map is right: jfsf/matching/mirror.json.

Pairs of embedded bodies as they are, of bodies with one swollen arm, and of thigh
bones, the last two with and without one of them mirrored (`situations.py`), are
matched, and all compared with their mirror images; so are pairs of FAUST and TOSCA,
where nothing is mirrored. A logistic regression tells the mirrored ones
(`jfsf.matching.mirror_probability`); its factors are drawn to 0 as by a normal
distribution of standard deviation 10, since without a limit they could grow for ever
where the pairs can be told without an error.

`held_out` is of each kind of shapes by factors that were fitted to the other kinds: how
many pairs are told wrong, and the least and the largest probability. Pairs without two
maps that are likely by themselves are not compared.

    python -m experiments.fit.fit_mirror --data ROOT [--again]

Pairs are read from results/fit_mirror.json where they are there, unless --again.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.situations import bodies, bones, plain
from jfsf.matching import Settings, _others, _sources
from jfsf.matching._confidence import mirror_regressors
from jfsf.testing import mirror
from jfsf.types import Mesh

SHIPPED = Path(jfsf.__file__).parent / "matching" / "mirror.json"
NAMES = "constant", "margin", "energy"
SPREAD = 10.0
PAIRS, ALL = 20, 132  # of each kind, and all of the embedded bodies
SETTINGS = Settings()
Pair = tuple[str, Mesh, Mesh]


def main() -> None:
    # All pairs with candidates of both orientations are compared.
    _others.MIRROR_GAP = np.finfo(float).max
    parser = command_line.parser(__doc__, out="fit_mirror.json", data="optional")
    parser.add_argument("--again", action="store_true", help="match all pairs again")
    args = command_line.parse(parser)
    rows = {}
    if args.out.exists() and not args.again:
        rows = json.loads(args.out.read_text(encoding="utf-8"))["rows"]
    for kind, (_, pairs) in KINDS.items():
        if kind not in rows:
            rows[kind] = list(compared(pairs(args.data)))
    factors = fit(rows)
    own = {kind: told(rows[kind], KINDS[kind][0], factors) for kind in KINDS}
    found = {"factors": factors, "held_out": held_out(rows), "own": own, "rows": rows}
    print(json.dumps({k: v for k, v in found.items() if k != "rows"}, indent=1))
    settings = {"pairs": PAIRS, "spread": SPREAD, "match": SETTINGS.as_record()}
    results_file.write(args.out, settings=settings, **found)
    SHIPPED.write_text(shipped(factors), encoding="utf-8")


def shipped(factors: dict[str, float]) -> str:
    """The text of the file that the package loads."""
    return json.dumps({"script": Path(__file__).name, "factors": factors}, indent=1)


def generated(cases, *, turned: bool = False) -> Iterator[Pair]:
    """Of `situations.py`; turned: with Y mirrored, which undoes what was."""
    for case in cases:
        yield case.name, case.x, mirror(case.y) if turned else case.y


def pairs_of(name: str, root: Path) -> Iterator[Pair]:
    """Pairs of a data set."""
    data = protocol.below(protocol.SETS[name], root)
    for pair in datasets.spread(datasets.pairs_of(data), PAIRS):
        x, y = datasets.load_pair_of(data, pair)
        yield f"{pair.x} {pair.y}", x.mesh, y.mesh


# Whether one of each pair is mirrored, and the pairs, by the root of the data.
KINDS: dict[str, tuple[int, Callable[[Path], Iterator[Pair]]]] = {
    "bodies": (0, lambda root: generated(plain(ALL))),
    "swollen arms": (0, lambda root: generated(bodies(PAIRS, False))),
    "swollen arms, mirrored": (1, lambda root: generated(bodies(PAIRS, True))),
    "bones": (0, lambda root: generated(bones(PAIRS), turned=True)),
    "bones, mirrored": (1, lambda root: generated(bones(PAIRS))),
    "faust_r": (0, lambda root: pairs_of("faust_r", root)),
    "tosca_iso_r": (0, lambda root: pairs_of("tosca_iso_r", root)),
}
# Kinds that begin so are held out together.
TOGETHER = "bodies", "swollen", "bones", "faust_r", "tosca_iso_r"


def compared(pairs: Iterator[Pair]) -> Iterator[dict]:
    """What is read of each pair: None without maps of both orientations."""
    seen: list = []
    own = _sources.mirror_figures

    def recorded(*args):
        seen.append(own(*args))
        return seen[-1]

    _sources.mirror_figures = recorded
    try:
        for name, x, y in pairs:
            seen.clear()
            jfsf.match(x, y, settings=SETTINGS)
            row = {"name": name, "share": None, "energy_ratio": None}
            if seen and seen[0]:
                row["share"], row["energy_ratio"] = seen[0]
            print(row, flush=True)
            yield row
    finally:
        _sources.mirror_figures = own


def columns(rows: list[dict]) -> np.ndarray:
    """(n, 3) what the factors weigh, of the pairs that were compared."""
    known = [row for row in rows if row["share"] is not None]
    share, ratio = (np.array([r[k] for r in known]) for k in ("share", "energy_ratio"))
    return np.concatenate(
        [np.ones((len(known), 1)), mirror_regressors(share, ratio)], 1
    )


def fit(rows: dict[str, list[dict]], without: str = "-") -> dict[str, float]:
    """The factors, of all kinds but those whose names begin so."""
    kinds = [kind for kind in KINDS if not kind.startswith(without)]
    read = [columns(rows[kind]) for kind in kinds]
    sign = [
        np.full(len(c), 2 * KINDS[k][0] - 1) for k, c in zip(kinds, read, strict=True)
    ]
    x, y = np.concatenate(read), np.concatenate(sign)

    def loss(b):
        return np.logaddexp(0, -y * (x @ b)).sum() + (b[1:] ** 2).sum() / SPREAD**2 / 2

    found = minimize(loss, np.zeros(3), method="BFGS").x
    return dict(zip(NAMES, found.round(3).tolist(), strict=True))


def held_out(rows: dict[str, list[dict]]) -> dict[str, dict]:
    """Of each kind by the factors of the others."""
    found = {}
    for begin in TOGETHER:
        factors = fit(rows, begin)
        for kind in KINDS:
            if kind.startswith(begin):
                found[kind] = told(rows[kind], KINDS[kind][0], factors)
    return found


def told(rows: list[dict], mirrored: int, factors: dict[str, float]) -> dict:
    """How many are told wrong, and the least and largest probability."""
    odds = columns(rows) @ [factors[name] for name in NAMES]
    if not len(odds):
        return {"pairs": len(rows), "compared": 0, "wrong": 0}
    likely = 1 / (1 + np.exp(-odds))
    return {
        "pairs": len(rows),
        "compared": len(odds),
        "wrong": int(((likely > 0.5) != mirrored).sum()),
        "least": float(likely.min()),
        "largest": float(likely.max()),
    }


if __name__ == "__main__":
    main()
