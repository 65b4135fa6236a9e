"""How likely the mirror image of a map is right: jfsf/matching/mirror.json.

Pairs of embedded bodies as they are, of bodies with one swollen arm, of thigh bones
(`situations.py`) and of teeth, the last three with and without one of them mirrored,
are matched, and all compared with their mirror images; so are pairs of FAUST and TOSCA,
where nothing is mirrored. A logistic regression on the difference of both energies
tells the mirrored ones (`jfsf.matching.mirror_probability`); its factor is drawn to 0
as by a normal distribution of standard deviation 100, since without a limit it could
grow for ever where the pairs can be told without an error.

`held_out` is of each kind of shapes by factors that were fitted to the other kinds: how
many pairs are told wrong, and the least and the largest probability. No factor is
fitted to heel bones, nor to `whole`. Pairs without two maps that are likely by
themselves are not compared.

`whole` is of matches of whole shapes, as collections compare them: sets that have a
left and a right, and sets where both orientations are right, one in a mirrored pose.
Of those whose map, with Y as it is and mirrored, is trusted: how many there are, how
many of them the other map says rightly to be mirrored, and how many wrongly.

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
from jfsf.apps.collections._grow import TRUSTED
from jfsf.matching import Settings, _others, _sources
from jfsf.testing import mirror
from jfsf.types import Mesh

SHIPPED = Path(jfsf.__file__).parent / "matching" / "mirror.json"
NAMES = "constant", "energy"
SPREAD = 100.0
PAIRS, ALL = 20, 132  # of each kind, and all of the embedded bodies
SETTINGS = Settings()
# Pairs of sets whose shapes have a left and a right, and of shapes that have none.
HANDED = {"hdm_molars": 14, "calcanei": 16, "cortex_species": 5}
SYMMETRIC = {"faust_r": 14, "tosca_iso_r": 14, "creatures": 8, "becos_ff": 5}
SYMMETRIC |= {"embedded": 14, "shrec20_full": 5, "gorilla": 6, "mouse_skulls": 3}
Pair = tuple[str, Mesh, Mesh]


def main() -> None:
    parser = command_line.parser(__doc__, out="fit_mirror.json", data="optional")
    parser.add_argument("--again", action="store_true", help="match all pairs again")
    args = command_line.parse(parser)
    rows, pairs = {}, {}
    if args.out.exists() and not args.again:
        before = json.loads(args.out.read_text(encoding="utf-8"))
        rows, pairs = before["rows"], before["pairs"]
    for kind, (_, cases) in KINDS.items():
        if kind not in rows:
            rows[kind] = list(compared(cases(args.data)))
    for name, number in (HANDED | SYMMETRIC).items():
        if name not in pairs:
            pairs[name] = list(both_ways(pairs_of(name, args.data, number)))
    factors = fit(rows)
    own = {kind: told(rows[kind], KINDS[kind][0], factors) for kind in KINDS}
    whole = {name: told_whole(pairs[name], name in HANDED, factors) for name in pairs}
    found = {"factors": factors, "held_out": held_out(rows), "own": own, "whole": whole}
    print(json.dumps(found, indent=1))
    settings = {"pairs": PAIRS, "spread": SPREAD, "match": SETTINGS.as_record()}
    results_file.write(args.out, settings=settings, **found, rows=rows, pairs=pairs)
    SHIPPED.write_text(shipped(factors), encoding="utf-8")


def shipped(factors: dict[str, float]) -> str:
    """The text of the file that the package loads."""
    return json.dumps({"script": Path(__file__).name, "factors": factors}, indent=1)


def generated(cases, *, turned: bool = False) -> Iterator[Pair]:
    """Of `situations.py`; turned: with Y mirrored, which undoes what was."""
    for case in cases:
        yield case.name, case.x, mirror(case.y) if turned else case.y


def pairs_of(
    name: str, root: Path, number: int = PAIRS, *, turned: bool = False
) -> Iterator[Pair]:
    """Pairs of a data set; turned: with Y mirrored."""
    data = protocol.below(protocol.SETS[name], root)
    for pair in datasets.spread(datasets.pairs_of(data), number):
        x, y = datasets.load_pair_of(data, pair)
        yield f"{pair.x} {pair.y}", x.mesh, mirror(y.mesh) if turned else y.mesh


# Whether one of each pair is mirrored, and the pairs, by the root of the data.
KINDS: dict[str, tuple[int, Callable[[Path], Iterator[Pair]]]] = {
    "bodies": (0, lambda root: generated(plain(ALL))),
    "swollen arms": (0, lambda root: generated(bodies(PAIRS, False))),
    "swollen arms, mirrored": (1, lambda root: generated(bodies(PAIRS, True))),
    "bones": (0, lambda root: generated(bones(PAIRS), turned=True)),
    "bones, mirrored": (1, lambda root: generated(bones(PAIRS))),
    "teeth": (0, lambda root: pairs_of("hdm_molars", root)),
    "teeth, mirrored": (1, lambda root: pairs_of("hdm_molars", root, turned=True)),
    "heel bones": (0, lambda root: pairs_of("calcanei", root)),
    "heel bones, mirrored": (1, lambda root: pairs_of("calcanei", root, turned=True)),
    "faust_r": (0, lambda root: pairs_of("faust_r", root)),
    "tosca_iso_r": (0, lambda root: pairs_of("tosca_iso_r", root)),
}
# Kinds that begin so are held out together.
TOGETHER = "bodies", "swollen", "bones", "teeth", "heel", "faust_r", "tosca_iso_r"
CHECKED = "heel"  # nothing is fitted to these


def compared(pairs: Iterator[Pair]) -> Iterator[dict]:
    """What is read of each pair: None without maps of both orientations."""
    seen: list = []
    own, gap = _sources.energy_beyond_mirror, _others.MIRROR_GAP
    # All pairs with candidates of both orientations are compared.
    _others.MIRROR_GAP = np.finfo(float).max

    def recorded(*args):
        seen.append(own(*args))
        return seen[-1]

    _sources.energy_beyond_mirror = recorded
    try:
        for name, x, y in pairs:
            seen.clear()
            jfsf.match(x, y, settings=SETTINGS)
            row = {"name": name, "energy_gap": seen[0] if seen else None}
            print(row, flush=True)
            yield row
    finally:
        _sources.energy_beyond_mirror, _others.MIRROR_GAP = own, gap


def both_ways(pairs: Iterator[Pair]) -> Iterator[dict]:
    """Confidence and energy of the match of each pair, and of that with Y mirrored."""
    for name, x, y in pairs:
        both = [
            jfsf.match(x, own, settings=SETTINGS).certificate for own in (y, mirror(y))
        ]
        row = {"name": name, "confidence": [float(one.confidence) for one in both]}
        row["energy"] = [float(one.energy) for one in both]
        print(row, flush=True)
        yield row


def columns(rows: list[dict]) -> np.ndarray:
    """(n, 2) what the factors weigh, of the pairs that were compared."""
    known = [row["energy_gap"] for row in rows if row["energy_gap"] is not None]
    return np.stack([np.ones(len(known)), np.array(known, float)], 1)


def fit(rows: dict[str, list[dict]], without: str = "-") -> dict[str, float]:
    """The factors, of all kinds but those whose names begin so."""
    kinds = [kind for kind in KINDS if not kind.startswith((without, CHECKED))]
    read = [columns(rows[kind]) for kind in kinds]
    sign = [
        np.full(len(c), 2 * KINDS[k][0] - 1) for k, c in zip(kinds, read, strict=True)
    ]
    x, y = np.concatenate(read), np.concatenate(sign)

    def loss(b):
        return np.logaddexp(0, -y * (x @ b)).sum() + (b[1:] ** 2).sum() / SPREAD**2 / 2

    found = minimize(loss, np.zeros(2), method="BFGS").x
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


def told_whole(rows: list[dict], handed: bool, factors: dict[str, float]) -> dict:
    """Of one set: which maps are said to be of mirror images by those that are trusted.

    The first map of each pair is right. So is the second, unless shapes are handed.
    """
    there = {"mirrored": 0, "others": 0}
    said = dict.fromkeys(there, 0)
    for row in rows:
        for own, other in ((0, 1), (1, 0)):
            if row["confidence"][other] < TRUSTED:
                continue
            gap = row["energy"][own] - row["energy"][other]
            kind = "mirrored" if handed and own == 1 else "others"
            there[kind] += 1
            said[kind] += factors["constant"] + factors["energy"] * gap > 0
    return {kind: {"pairs": there[kind], "told so": said[kind]} for kind in there}


if __name__ == "__main__":
    main()
