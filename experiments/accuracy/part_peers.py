"""What ZoomOut makes of the first start of `match(partial=True)`, beside `match`.

Of each pair of the sets of parts (`protocol.py`): the error of the first start, which
is a map of coarse copies, and of what is refined from it:

- ZoomOut (Melzi et al. 2019), 20 to 100 eigenfunctions of each shape, in steps of 5;
- `jfsf.match(partial=True, initial=)`, from that start alone.

The authors' code of partial functional maps is MATLAB and is not run here.

    python -m experiments.accuracy.part_peers --data ROOT [--sets psmal] \\
        [--out RESULT.json]
"""

from pathlib import Path

import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.fit import fit_parts
from jfsf.matching.parts._sides import both_sides
from jfsf.matching.parts._starts import first_starts
from jfsf.mesh._closest import nearest_vertices
from jfsf.spectral import spectrum

WIDTHS = range(20, 101, 5)
METHODS = "start", "zoomout", "jfsf"


def main() -> None:
    parser = command_line.parser(__doc__, out="part_peers.json", data=True)
    parser.add_argument("--sets", nargs="+", default=fit_parts.SETS)
    args = command_line.parse(parser)
    rows = []
    for name in args.sets:
        data_set = protocol.below(protocol.SETS[name], Path(args.data))
        for pair in datasets.pairs_of(data_set):
            errors = measure(*datasets.load_pair_of(data_set, pair))
            rows.append({"set": name, "x": pair.x, "y": pair.y, **errors})
            print(rows[-1], flush=True)
            settings = {"widths": list(WIDTHS)}
            results_file.write(
                args.out, settings=settings, summary=summary(rows), rows=rows
            )


def measure(x: datasets.Shape, y: datasets.Shape) -> dict[str, float]:
    """The error of each method; X is the part."""
    x, y, _ = fit_parts.in_order(x, y)
    error = fit_parts.errors_of(x, y)
    sides = both_sides(x.mesh, y.mesh, settings=fit_parts.SETTINGS)
    ((_, first), *_) = first_starts(sides, 1)
    near = nearest_vertices(sides.coarse_x, sides.x.mesh)
    start = sides.on_y[first.registered.T[near]]
    phi_x, phi_y = (
        np.asarray(spectrum(shape.mesh, WIDTHS[-1]).evecs, float) for shape in (x, y)
    )
    found = jfsf.match(x.mesh, y.mesh, partial=True, initial=start.astype(np.int32))
    maps = start, zoomout(phi_x, phi_y, start), found.T_xy
    return {
        method: error(np.asarray(T_xy))
        for method, T_xy in zip(METHODS, maps, strict=True)
    }


def zoomout(evecs_x, evecs_y, T_xy) -> np.ndarray:
    """A map refined."""
    for k in WIDTHS:
        phi_x, phi_y = evecs_x[:, :k], evecs_y[:, :k]
        C_yx = np.linalg.lstsq(phi_x, phi_y[T_xy], rcond=None)[0]
        points = phi_y @ C_yx.T
        # So many columns are faster compared with all than by a tree.
        T_xy = np.argmin(np.sum(points**2, 1) - 2 * phi_x @ points.T, 1)
    return T_xy


def summary(rows: list[dict]) -> dict[str, dict]:
    """Right maps and mean errors of each set and method."""
    found: dict[str, dict] = {}
    for name in dict.fromkeys(row["set"] for row in rows):
        own = [row for row in rows if row["set"] == name]
        found[name] = {"pairs": len(own)}
        for method in METHODS:
            errors = [row[method] for row in own]
            right = sum(map(protocol.is_right, errors))
            found[name][method] = {"right": right, "mean": float(np.mean(errors))}
    return found


if __name__ == "__main__":
    main()
