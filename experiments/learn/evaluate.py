"""How well the answers of the network alone match shapes that it never saw.

    python -m experiments.learn.evaluate --data ROOT [--sets creatures ...] \\
        [--spread 40] [--out RESULT.json]

The weights are those of the package. A vertex of X goes to the vertex of Y whose
chances of the anchors agree best with its own. Of each set: mean error in sqrt(area of
Y), the median over points, the share of points that are further than 0.25 off, and
pairs with a mean below 0.1. Of each pair: the likeness of both to people, read as the
matcher has them, of coarse copies of whole shapes.

`limit` of likeness tells people from all else with the fewest errors on the pairs of
the sets to fit to and to choose on: the middle of the widest gap that does. `PEOPLE` is
that. Centaurs count as neither.
"""

import re
from pathlib import Path

import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.match_pairs import some_points
from experiments.fit.fit_parts import MADE, pairs_of
from jfsf.geometry import GeodesicSolver
from jfsf.learned import best_agreement, place_chances
from jfsf.learned._inputs import EIGENPAIRS
from jfsf.learned._places import PEOPLE, likeness_of_both
from jfsf.matching._settings import COARSE_VERTICES
from jfsf.mesh import decimate, surface_area
from jfsf.runtime._sizes import pad
from jfsf.spectral import spectrum
from jfsf.types import Mesh, Spectrum

SETS = "creatures embedded gorilla topkids_low faust_r tosca_iso_r becos_pf becos_pp"
OTHERS = "smal_whole shrec07 shrec20_full calcanei mouse_skulls hdm_molars"
PARTS = "psmal shrec20_partial made_parts"
# Sets of people alone; and what is in the names of people of the others.
PEOPLE_ALONE = "creatures", "embedded", "gorilla", "topkids_low", "faust_r"
OF_PEOPLE = re.compile("victoria|david|michael|faust|scape|kids")
NEITHER = "centaur"
SHREC07_PEOPLE = 20  # numbers up to this one
FAR_OFF = 0.25
STEP = 1024  # shapes are padded to multiples of it: few sizes, few compilations


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    every = f"{SETS} {OTHERS} {PARTS}".split()
    parser.add_argument("--sets", nargs="+", default=every, choices=every)
    parser.add_argument("--spread", type=int, default=40)
    args = command_line.parse(parser)
    rows: dict[str, dict] = {}
    for name in args.sets:
        part = name == MADE or protocol.SETS[name].kind == "part"
        found, pairs = [], []
        for about, load in datasets.spread(
            [*pairs_of(name, Path(args.data))], args.spread
        ):
            x, y = load()
            found.append(measured(x, y))
            like = likeness(*(s.mesh if part else coarse(s.mesh) for s in (x, y)))
            pairs.append({**about, "likeness": round(like, 3)})
            print(pairs[-1], {k: round(v, 3) for k, v in found[-1].items()}, flush=True)
        mean = {key: float(np.mean([row[key] for row in found])) for key in found[0]}
        taken = sum(pair["likeness"] >= PEOPLE for pair in pairs)
        good = sum(protocol.is_right(row["error"]) for row in found)
        figures = {"pairs": len(found), "below 0.1": good, "taken for people": taken}
        rows[name] = mean | figures | {"each": pairs}
        known = {"settings": {"people": PEOPLE}, "limit": limit(rows), "sets": rows}
        if args.out:
            results_file.write(args.out, **known)
        print(name, {**mean, **figures}, "limit", known["limit"], flush=True)


def limit(rows: dict[str, dict]) -> float:
    """Of likeness, from which on a pair is one of people; nan without pairs of both."""
    told = [
        (pair["likeness"], are_people(name, pair["x"]))
        for name, row in rows.items()
        for pair in row["each"]
        if pair["role"] != "report" and NEITHER not in pair["x"]
    ]
    values, people = (np.array(column) for column in zip(*told, strict=True))
    if people.all() or not people.any():
        return float("nan")
    values, people = values[np.argsort(values)], people[np.argsort(values)]
    middle = (values[1:] + values[:-1]) / 2
    wrong = [(people != (values >= m)).sum() for m in middle]
    widest = max(np.flatnonzero(wrong == min(wrong)), key=lambda i: np.diff(values)[i])
    return round(float(middle[widest]), 3)


def are_people(name: str, x: str) -> bool:
    """Whether a pair of that set, with X of that name, is of people."""
    if name in ("shrec07", "shrec07_more"):
        return int(x) <= SHREC07_PEOPLE
    return name in PEOPLE_ALONE or OF_PEOPLE.search(x) is not None


def measured(x: datasets.Shape, y: datasets.Shape) -> dict[str, float]:
    """Errors of the map from X to Y at the points of the ground truth."""
    first, second = (chances(spectrum(s.mesh, EIGENPAIRS)) for s in (x, y))
    at = some_points(len(x.truth))
    images = best_agreement(first[x.truth[at], :-1], second[:, :-1])
    far = GeodesicSolver(y.mesh).rows(y.truth[at]) / np.sqrt(surface_area(y.mesh))
    errors = far[np.arange(len(at)), images]
    return {
        "error": float(errors.mean()),
        "median": float(np.median(errors)),
        "far off": float((errors > FAR_OFF).mean()),
    }


def coarse(mesh: Mesh) -> Mesh:
    """The copy that the network is asked about."""
    return decimate(mesh, COARSE_VERTICES)


def likeness(x: Mesh, y: Mesh) -> float:
    """Of both to people."""
    spec_x, spec_y = spectrum(x, EIGENPAIRS), spectrum(y, EIGENPAIRS)
    return likeness_of_both((chances(spec_x), chances(spec_y)), (spec_x, spec_y))


def chances(spec: Spectrum) -> np.ndarray:
    """(n, a + 1) of each anchor at each vertex, and that it is of no person."""
    n = len(spec.mass)
    size = -(-n // STEP) * STEP
    faces = 3 * size  # more than 2 n where there are tunnels
    return np.asarray(place_chances(pad(spec, size, faces)))[:n]


if __name__ == "__main__":
    main()
