"""How good the starts of `match(partial=True)` are with other settings.

Of the sets to choose on, parts of animals and 20 pairs of embedded bodies that are both
cut (`partial.py --both`): the error of the map of coarse copies by the first start,
which is refined, the least of the first three, and the least of all. Each change is of
one choice in `jfsf.PartSettings`, or of a constant. `--sets` takes others too. A killed
run goes on from what it has written.

    python -m experiments.fit.choose_starts --data ROOT [--sets psmal] \\
        [--out RESULT.json]
"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import cuts, datasets, protocol
from experiments.accuracy.partial import Cut, pairs, parts_of
from experiments.fit import fit_parts
from jfsf import data
from jfsf.matching.parts import PartSettings, _beam, _register
from jfsf.matching.parts._sides import both_sides
from jfsf.matching.parts._starts import first_starts
from jfsf.mesh._closest import nearest_vertices

BOTH = "both cut"
SETS = "psmal", BOTH
EVERY = *fit_parts.SETS, fit_parts.MADE, BOTH
KEEP, PAIRS = 0.7, 20  # of the bodies that are both cut
# What is changed: fields of the settings, and constants of files.
CHANGES: dict[str, dict] = {
    "shipped": {},
    "min_groups=12": {"MIN_GROUPS": 12},
    "assignments=16": {"assignments": 16},
    "first_reach=0.1": {"FIRST_REACH": 0.1, "FIRST_UPDATES": 40},
}
FILES = {"MIN_GROUPS": _beam, "FIRST_REACH": _register, "FIRST_UPDATES": _register}
FEW = 3
KINDS = "first", f"best of {FEW}", "best"


def main() -> None:
    parser = command_line.parser(__doc__, out="choose_starts.json", data=True)
    parser.add_argument("--sets", nargs="+", choices=EVERY, default=SETS)
    args = command_line.parse(parser)
    rows = json.loads(args.out.read_text())["rows"] if args.out.exists() else []
    known = {(row["set"], row["pair"]) for row in rows}
    for name in args.sets:
        for pair, load in pairs_of(name, Path(args.data)):
            if (name, pair) not in known:
                rows.append({"set": name, "pair": pair, **measure(*load())})
                print(rows[-1], flush=True)
                write(args.out, rows)
    print(json.dumps(summary(rows), indent=1))


def write(path: Path, rows: list[dict]) -> None:
    """Means, and all rows."""
    settings = {"changes": CHANGES}
    results_file.write(path, settings=settings, summary=summary(rows), rows=rows)


def pairs_of(name: str, root: Path) -> Iterator[tuple[str, Callable]]:
    """The name of each pair of a set, and what loads both shapes."""
    if name == BOTH:
        for i, (x, y) in enumerate(pairs(PAIRS)):
            yield f"{x} {y}", partial(both_cut, Cut(x, y, KEEP, i, True))
        return
    for about, load in fit_parts.pairs_of(name, root):
        yield f"{about['x']} {about['y']}".strip(), load


def both_cut(pair: Cut) -> tuple[datasets.Shape, datasets.Shape]:
    """Two embedded bodies, of which each lacks something."""
    part_x, part_y = parts_of(pair)
    bodies = data.load(pair.x), part_x, data.load(pair.y), part_y
    truth = cuts.truth_of_parts(*bodies)
    return (
        datasets.Shape(part_x.mesh, truth.at_x, None),
        datasets.Shape(part_y.mesh, truth.at_y, None),
    )


def measure(x: datasets.Shape, y: datasets.Shape) -> dict[str, list[float]]:
    """Of each change: the errors of `KINDS`."""
    x, y, _ = fit_parts.in_order(x, y)
    error = fit_parts.errors_of(x, y)
    sides = both_sides(x.mesh, y.mesh, settings=fit_parts.SETTINGS)
    near = nearest_vertices(sides.coarse_x, sides.x.mesh)
    found = {}
    for name, change in CHANGES.items():
        with changed(change) as settings:
            begin = first_starts(sides._replace(settings=settings), 1)
        errors = [error(sides.on_y[one.registered.T[near]]) for _, one in begin]
        found[name] = [errors[0], min(errors[:FEW]), min(errors)]
    return found


@contextmanager
def changed(change: dict) -> Iterator[PartSettings]:
    """The settings of a change; its constants are set until the end."""
    shipped = {name: getattr(file, name) for name, file in FILES.items()}
    fields = {name: value for name, value in change.items() if name not in FILES}
    try:
        for name in change.keys() & FILES.keys():
            setattr(FILES[name], name, change[name])
        yield replace(fit_parts.SETTINGS, **fields)
    finally:
        for name, value in shipped.items():
            setattr(FILES[name], name, value)


def summary(rows: list[dict]) -> dict[str, dict]:
    """Of each change and set: right starts (`protocol.RIGHT`), and mean errors."""
    found: dict[str, dict] = {}
    sets = list(dict.fromkeys(row["set"] for row in rows))
    for change in CHANGES:
        found[change] = {}
        for name in [*sets, "every set"]:
            own = [r[change] for r in rows if name in (r["set"], "every set")]
            errors = np.array(own)
            right = (errors < protocol.RIGHT).sum(0)
            found[change][name] = {
                "pairs": len(own),
                "right": dict(zip(KINDS, right.tolist(), strict=True)),
                "mean": dict(zip(KINDS, errors.mean(0).tolist(), strict=True)),
            }
    return found


if __name__ == "__main__":
    main()
