"""Fit how often the maps round a triangle agree: `jfsf.apps.collections` reads it as
AGREE.

FOLDER is what `collection.py shrec07 FOLDER` has made. All pairs of the shapes of some
classes are matched, in FOLDER/CLASS/pairs where the collection did not; a killed run
goes on. Of all triangles: how many of the three maps are wrong (`protocol.RIGHT`), and
whether the maps round the triangle agree (`AGREE_BELOW`). Written is the share
of those that agree, by the number of wrong maps, with half a triangle of either kind
added (Jeffreys), and beside it what the package has. The classes are those with many
wrong maps: of others there are only triangles without any.

Two wrong maps often agree, because a shape that is turned end for end, or has two like
parts exchanged, is so in the maps to all of its neighbours.

    python -m experiments.fit.fit_cycles FOLDER --data ROOT [--out RESULT.json]
"""

import json
from itertools import combinations
from pathlib import Path

import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.collection import Errors, shapes_of
from jfsf.apps.cli._collection_jobs import kept, match_pair, read_maps
from jfsf.apps.collections._cycles import AGREE, AGREE_BELOW, triangles
from jfsf.batch._jobs import Job

CLASSES = "airplane", "ant", "plier"


def main() -> None:
    parser = command_line.parser(__doc__, out="fit_cycles.json", data=True)
    parser.add_argument("folder", type=Path)
    args = command_line.parse(parser)
    shapes = shapes_of("shrec07", args.data)
    counted = {name: counts(shapes, args.folder / name) for name in CLASSES}
    total = np.sum(list(counted.values()), 0)
    found = {
        "fitted": fitted(total),
        "shipped": AGREE.tolist(),
        "triangles": {"agree": total[0].tolist(), "disagree": total[1].tolist()},
        "by_class": {name: own.tolist() for name, own in counted.items()},
    }
    settings = {"classes": CLASSES, "agree": AGREE_BELOW, "right": protocol.RIGHT}
    results_file.write(args.out, settings=settings, **found)
    print(json.dumps(found, indent=1))


def counts(shapes: dict[str, datasets.Shape], folder: Path) -> np.ndarray:
    """(2, 4) triangles that agree, and that do not, by the number of wrong maps."""
    error, maps, wrong = Errors(shapes), {}, {}
    model, further = folder / "model", folder / "pairs"
    further.mkdir(exist_ok=True)
    names = sorted(path.stem for path in (model / "shapes").glob("*.npz"))
    for edge in combinations(range(len(names)), 2):
        x, y = (names[i] for i in edge)
        path = model / "pairs" / f"{x}__{y}.npz"
        if not path.exists():
            path = further / path.name
        if not path.exists():
            inputs = tuple(model / "shapes" / f"{name}.npz" for name in (x, y))
            match_pair(Job(inputs, path), "preserve", False)
            print(path, flush=True)
        maps[edge] = read_maps(path).maps
        wrong[edge] = not protocol.is_right(error(maps[edge].T_xy, x, y))
    sketches = [kept(model / "shapes" / f"{name}.npz").sketch for name in names]
    found = np.zeros((2, 4), int)
    for triangle in triangles(maps, sketches):
        bad = sum(wrong[edge] for edge in triangle.edges)
        found[int(triangle.apart >= AGREE_BELOW), bad] += 1
    return found


def fitted(total: np.ndarray) -> list[float]:
    """The share of triangles that agree, of none, one, two and three wrong maps."""
    agree, disagree = total
    return np.round((agree + 0.5) / (agree + disagree + 1), 2).tolist()


if __name__ == "__main__":
    main()
