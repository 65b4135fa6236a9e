"""How well the answers of the network alone match shapes that it never saw.

    python -m experiments.learn.evaluate --data ROOT [--sets creatures ...] \\
        [--spread 10] [--out RESULT.json]

The weights are those of the package. A vertex of X goes to the vertex of Y whose
chances of the anchors agree best with its own. Of each set: mean error in sqrt(area of
Y), the median over points, the share of points that are further than 0.25 off, pairs
with a mean below 0.1, and the `likeness` to a person of each shape, on a coarse copy as
the matcher has it. `PERSON` is between that of people and that of all else.
"""

from pathlib import Path

import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.match_pairs import some_points
from jfsf.geometry import GeodesicSolver
from jfsf.learned import best_agreement, place_chances
from jfsf.learned._inputs import EIGENPAIRS
from jfsf.learned._places import PERSON, likeness
from jfsf.matching._settings import COARSE_VERTICES
from jfsf.mesh import decimate, surface_area
from jfsf.runtime._sizes import pad
from jfsf.spectral import spectrum
from jfsf.types import Mesh, Spectrum

SETS = "creatures embedded gorilla topkids_low faust_r tosca_iso_r becos_pf becos_pp"
OTHERS = "smal_whole shrec07 shrec20_full calcanei mouse_skulls hdm_molars"
FAR_OFF = 0.25
STEP = 1024  # shapes are padded to multiples of it: few sizes, few compilations


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    parser.add_argument("--sets", nargs="+", default=[*SETS.split(), *OTHERS.split()])
    parser.add_argument("--spread", type=int, default=10)
    args = command_line.parse(parser)
    rows = {}
    for data_set in protocol.named(args.sets):
        own, found = protocol.below(data_set, Path(args.data)), []
        seen: dict[str, float] = {}
        for pair in datasets.spread(datasets.pairs_of(own), args.spread):
            x, y = datasets.load_pair_of(own, pair)
            found.append(measured(x, y))
            for name, shape in ((pair.x, x), (pair.y, y)):
                if name not in seen:
                    seen[name] = round(likeness_of(shape.mesh), 3)
            print(pair.x, pair.y, {k: round(v, 3) for k, v in found[-1].items()})
        mean = {key: float(np.mean([row[key] for row in found])) for key in found[0]}
        rows[data_set.name] = mean | {
            "pairs": len(found),
            "below 0.1": sum(row["error"] < protocol.RIGHT for row in found),
            "taken for people": float(np.mean(np.array([*seen.values()]) >= PERSON)),
            "likeness": seen,
        }
        print(data_set.name, rows[data_set.name], flush=True)
        if args.out:
            results_file.write(args.out, settings={"person": PERSON}, sets=rows)


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


def likeness_of(mesh: Mesh) -> float:
    """Of a coarse copy."""
    spec = spectrum(decimate(mesh, COARSE_VERTICES), EIGENPAIRS)
    return likeness(chances(spec), spec)


def chances(spec: Spectrum) -> np.ndarray:
    """(n, a + 1) of each anchor at each vertex, and that it is of no person."""
    n = len(spec.mass)
    size = -(-n // STEP) * STEP
    faces = 3 * size  # more than 2 n where there are tunnels
    return np.asarray(place_chances(pad(spec, size, faces)))[:n]


if __name__ == "__main__":
    main()
