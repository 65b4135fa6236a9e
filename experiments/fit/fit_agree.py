"""How far from the others a way counts little: `jfsf.apps.collections` reads it as
WITHIN.

Of collections that `collection.py` has made and kept, the template is put on each shape
by all trusted ways (`jfsf.apps.collections.agreed_map`) at several distances, without
the registration after it. Errors are of the vertices of the template, in sqrt(area of
the shape); `alone` is by the way that the collection took before it had others.

What is shipped is to be within 1 % of the best on each set, of which FAUST's was made
for fitting and the embedded one for choosing.

    python -m experiments.fit.fit_agree SET=FOLDER [SET=FOLDER ...] --data ROOT
"""

import csv
import json
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from experiments import command_line, results_file
from experiments.accuracy.collection import Errors, shapes_of
from jfsf.apps.cli._collection_jobs import kept
from jfsf.apps.collections import agreed_map
from jfsf.apps.collections._member import WITHIN, OtherShape

DISTANCES = 0.005, 0.01, 0.02, 0.04, 0.08, 1.0


def main() -> None:
    parser = command_line.parser(__doc__, out="fit_agree.json", data=True)
    parser.add_argument("collections", nargs="+", metavar="SET=FOLDER")
    args = command_line.parse(parser)
    found = {}
    if args.out.exists():
        found = json.loads(args.out.read_text(encoding="utf-8"))["sets"]
    for word in args.collections:
        name, folder = word.split("=")
        found[name] = measure(name, Path(folder) / "model", args.data)
        print(name, *found[name].items(), sep="\n  ", flush=True)
    settings = {"distances": DISTANCES, "shipped": WITHIN}
    results_file.write(args.out, settings=settings, sets=found)


def measure(name: str, model: Path, root: Path | None) -> dict:
    """Mean errors over the shapes that have two ways or more, by distance."""
    shapes = shapes_of(name, root)
    with (model / "summary.csv").open(encoding="utf-8") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    template = next(n for n, row in rows.items() if float(row["trust"]) == 1)
    error, errors = Errors(shapes), {}
    for own, row in rows.items():
        if row["reason"] or own == template:
            continue
        ways = beside(model, own)
        if not ways:
            continue
        mesh, at = shapes[own].mesh, placed(model, own)
        T = KDTree(mesh.vertices).query(at)[1]
        errors.setdefault("alone", []).append(error(T, template, own))
        for within in DISTANCES:
            T = agreed_map(at, ways, mesh, within=within)
            errors.setdefault(str(within), []).append(error(T, template, own))
    means = {key: float(np.mean(values)) for key, values in errors.items()}
    return {"shapes": len(errors["alone"]), **means}


def beside(model: Path, name: str) -> list[OtherShape]:
    """The trusted ways to a shape by way of another; none for mirrored shapes."""
    with np.load(model / "others" / f"{name}.npz") as file:
        maps = [file[key] for key in file.files if key != "turned"]
        if file["turned"].any():
            return []
    # Which shapes these are is in no file: each map has as many vertices as its shape.
    known = dict(neighbours(model, name))
    found = []
    for T in maps:
        other = next(n for n, own in known.items() if np.array_equal(own, T))
        mesh = kept(model / "shapes" / f"{other}.npz").mesh
        found.append(OtherShape(mesh, placed(model, other), T))
    return found


def neighbours(model: Path, name: str):
    """Other shapes, and the maps from them, of all pairs that were matched."""
    for path in sorted((model / "pairs").glob("*.npz")):
        x, y = path.stem.split("__")
        if name in (x, y):
            with np.load(path) as file:
                yield (y, file["T_yx"]) if x == name else (x, file["T_xy"])


def placed(model: Path, name: str) -> np.ndarray:
    """Where the template's vertices lie on a shape, by its own way."""
    with np.load(model / "placed" / f"{name}.npz") as file:
        return file["vertices"]


if __name__ == "__main__":
    main()
