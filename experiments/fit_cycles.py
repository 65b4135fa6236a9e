"""Fit how often the maps round a triangle agree: `jfsf.joint` reads it as AGREE.

FOLDER is what `collection.py SET FOLDER` has made. Of all triangles of matched pairs
there: how many of the three maps are wrong (`protocol.RIGHT`), and whether the maps
round the triangle agree (`PairSettings.agree`). The share of those that agree, by the
number of wrong maps, with half a triangle of either kind added (Jeffreys), is written,
and beside it what the package has.

The triangles are those that `jfsf collection` chose, which are more where maps are
in doubt. Two wrong maps often agree, because a shape that is turned end for end, or
has two like parts exchanged, is so in the maps to all of its neighbours.

    python experiments/fit_cycles.py shrec07 FOLDER --data ROOT [--out RESULT.json]
"""

import argparse
import json
import os
from pathlib import Path

import datasets
import numpy as np
import protocol
import results_file
from collection import CLASSES, Errors, shapes_of

from jfsf.cli._collection_jobs import kept, read_maps
from jfsf.joint import PairSettings, triangles
from jfsf.joint._cycles import AGREE

OUT = Path(__file__).parent / "results" / "fit_cycles.json"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set", choices=["together", *protocol.SETS])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--data", type=Path, default=os.environ.get("JFSF_DATA"))
    parser.add_argument("--out", type=Path, default=OUT)
    args = parser.parse_args()
    shapes = shapes_of(args.set, args.data)
    names = CLASSES if args.set == "shrec07" else [""]
    counted = {name: counts(shapes, args.folder / name / "model") for name in names}
    total = np.sum(list(counted.values()), 0)
    found = {
        "fitted": fitted(total),
        "shipped": AGREE.tolist(),
        "triangles": {"agree": total[0].tolist(), "disagree": total[1].tolist()},
        "by_class": {name: own.tolist() for name, own in counted.items()},
    }
    limit = PairSettings().agree
    settings = {"set": args.set, "agree": limit, "right": protocol.RIGHT}
    results_file.write(args.out, settings=settings, **found)
    print(json.dumps(found, indent=1))


def counts(shapes: dict[str, datasets.Shape], model: Path) -> np.ndarray:
    """(2, 4) triangles that agree, and that do not, by the number of wrong maps."""
    error, maps, wrong = Errors(shapes), {}, {}
    names = sorted(path.stem for path in (model / "shapes").glob("*.npz"))
    number = {name: i for i, name in enumerate(names)}
    for path in (model / "pairs").glob("*.npz"):
        x, y = path.stem.split("__")
        edge = number[x], number[y]
        maps[edge] = read_maps(path).maps
        wrong[edge] = not protocol.is_right(error(maps[edge].T_xy, x, y))
    sketches = [kept(model / "shapes" / f"{name}.npz").sketch for name in names]
    found, limit = np.zeros((2, 4), int), PairSettings().agree
    for triangle in triangles(maps, sketches):
        bad = sum(wrong[edge] for edge in triangle.edges)
        found[int(triangle.apart >= limit), bad] += 1
    return found


def fitted(total: np.ndarray) -> list[float]:
    """The share of triangles that agree, of none, one, two and three wrong maps."""
    agree, disagree = total
    return np.round((agree + 0.5) / (agree + disagree + 1), 2).tolist()


if __name__ == "__main__":
    main()
