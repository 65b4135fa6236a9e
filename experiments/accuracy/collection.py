"""A collection of shapes through one template: how right its maps and meshes are.

`jfsf collection` runs on the shapes of a set, in FOLDER/model, which is kept: run it
again to go on. Then, in units of sqrt(area):

- `direct`: errors of the pairs that were matched, which are those of shapes alike;
- `through`: errors of maps from shape to shape by way of the template, of pairs that
  are spread over all of them: by vertices, and by the surface of the registered
  template (a vertex of X goes to its nearest point there, and to that point on Y);
- `listed`: errors of `jfsf.match` itself on the pairs of the set, if it has results
  here, beside those of the same pairs through the template;
- `registered`: distances of the template from the shapes, flipped and collapsed faces.

Each class of SHREC'07 is a collection of its own, in FOLDER/CLASS; results are of each,
and of the listed pairs of all.

    python -m experiments.accuracy.collection embedded FOLDER
    python -m experiments.accuracy.collection faust_r FOLDER --data ROOT [--pairs 100]
    python -m experiments.accuracy.collection shrec07 FOLDER --data ROOT \\
        [--classes ant bird]
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf.apps.cli._collection_jobs import kept
from jfsf.apps.mapfiles import read_match
from jfsf.geometry import GeodesicSolver
from jfsf.mesh import closest, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.types import Mesh

POINTS = 250  # of ground truth, at most, in each pair
CLASSES = {  # of SHREC'07, and the number of the first of its twenty shapes
    "human": 1,
    "glasses": 41,
    "airplane": 61,
    "ant": 81,
    "teddy": 161,
    "hand": 181,
    "plier": 201,
    "fish": 221,
    "bird": 241,
    "armadillo": 281,
    "four-legged": 381,
}


def main() -> None:
    parser = command_line.parser(__doc__, data="optional")
    parser.add_argument("set", choices=["together", *protocol.SETS])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES))
    args = command_line.parse(parser)
    shapes = shapes_of(args.set, args.data)
    if args.set == "shrec07":
        measured = measure_classes(shapes, args.folder, args.classes, args.pairs)
    else:
        model = made(shapes, args.folder)
        measured = measure(shapes, model, args.pairs, args.set)
    out = args.out or command_line.RESULTS / f"collection_{args.set}.json"
    settings = {"set": args.set, "pairs": args.pairs}
    results_file.write(out, settings=settings, **measured)
    print(json.dumps(measured["summary"], indent=1))


def measure_classes(
    shapes: dict[str, datasets.Shape], folder: Path, classes: list[str], num: int
) -> dict:
    """Figures of a collection of each class of SHREC'07, and of all listed pairs."""
    by_class = {}
    for name in classes:
        first = CLASSES[name]
        own = {n: s for n, s in shapes.items() if first <= int(n) < first + 20}
        by_class[name] = measure(own, made(own, folder / name), num, "shrec07")
        print(name, json.dumps(by_class[name]["summary"]), flush=True)
    summaries = {name: found["summary"] for name, found in by_class.items()}
    listed = [row for found in by_class.values() for row in found["listed"]]
    return {
        "summary": {
            "shapes": sum(found["shapes"] for found in summaries.values()),
            "left out": sum((found["left out"] for found in summaries.values()), []),
            **of_listed(listed),
        },
        "classes": summaries,
        "listed": listed,
    }


def of_listed(rows: list[dict]) -> dict:
    """Figures of the pairs of a set, by `jfsf.match` and through the template."""
    return {
        "listed, direct": figures([row["direct"] for row in rows]),
        "listed, by vertices": figures([row["by_vertices"] for row in rows]),
        "listed, by surface": figures([row["by_surface"] for row in rows]),
    }


def shapes_of(set_name: str, root: Path | None) -> dict[str, datasets.Shape]:
    """The shapes of a set; "together" are the embedded ones and the creatures."""
    sets = ["embedded", "creatures"] if set_name == "together" else [set_name]
    found = {}
    for own in sets:
        data_set = protocol.SETS[own]
        if data_set.folders:
            if root is None:
                raise SystemExit("give --data ROOT or set JFSF_DATA")
            data_set = protocol.below(data_set, root)
        if own == "creatures":  # those without the people, which are in the package
            data_set = data_set._replace(folders=data_set.folders[:1])
        truths = dict.fromkeys(datasets._names(data_set), "")
        if data_set.truth == "listed":  # of each shape in the same order
            for pair in datasets.pairs_of(data_set):
                truths |= dict(zip((pair.x, pair.y), pair.truth, strict=True))
            truths = {n: truth for n, truth in truths.items() if truth}
        for name, truth in truths.items():
            if name not in found:
                found[name] = datasets.load_shape(data_set, name, truth)
    return found


def made(shapes: dict[str, datasets.Shape], folder: Path) -> Path:
    """The folder of the collection, by the command line."""
    scans, model = folder / "scans", folder / "model"
    scans.mkdir(parents=True, exist_ok=True)
    for name, shape in shapes.items():
        if not (path := scans / f"{name}.off").exists():
            write_off(path, shape.mesh)
    command = [sys.executable, "-m", "jfsf", "collection", scans, "--out", model]
    subprocess.run(list(map(str, command)), check=False)
    if not (model / "summary.csv").exists():
        raise SystemExit(f"{model}: the command failed; see above")
    return model


def write_off(path: Path, mesh: Mesh) -> None:
    """With all digits."""
    lines = ["OFF", f"{len(mesh.vertices)} {len(mesh.faces)} 0"]
    lines += [" ".join(map(repr, row)) for row in mesh.vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def measure(shapes: dict, model: Path, num: int, set_name: str) -> dict:
    """All figures of a collection."""
    with (model / "summary.csv").open() as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    joined = [name for name in shapes if not rows[name]["reason"]]
    template = next(name for name in joined if float(rows[name]["trust"]) == 1)
    error = Errors(shapes)
    direct = []
    for path in sorted((model / "pairs").glob("*.npz")):
        x, y = path.stem.split("__")
        found = read_match(path)
        likely = float(found.certificate.confidence)
        row = {"x": x, "y": y, "error": error(found.T_xy, x, y), "confidence": likely}
        direct.append(row)
    other = [name for name in joined if name != template]
    to, back, on = {}, {}, {}
    for name in other:
        match = read_match(model / "maps" / f"{name}.npz")
        to[name], back[name] = np.asarray(match.T_xy), np.asarray(match.T_yx)
    itself = np.arange(len(shapes[template].mesh.vertices))
    to[template] = back[template] = itself
    for name in joined:
        with np.load(model / "registered" / f"{name}.npz") as file:
            on[name] = file["vertices"]
    faces = kept(model / "shapes" / f"{template}.npz").mesh.faces

    def by_surface(x: str, y: str) -> np.ndarray:
        found = closest(surface_tree(Mesh(on[x], faces)), shapes[x].mesh.vertices)
        corners = on[y][faces[found.face]]
        points = np.einsum("nc,nci->ni", found.barycentric, corners)
        return np.asarray(KDTree(shapes[y].mesh.vertices).query(points)[1])

    def through(pairs: list[tuple[str, str]]) -> list[dict]:
        return [
            {
                "x": x,
                "y": y,
                "by_vertices": error(to[y][back[x]], x, y),
                "by_surface": error(by_surface(x, y), x, y),
            }
            for x, y in pairs
        ]

    every = [(x, y) for x in other for y in other if x != y]
    spread = through(datasets.spread(every, num))
    listed = []
    same = "creatures" if set_name == "together" else set_name
    if (known := command_line.RESULTS / f"match_{same}.json").exists():
        for own in json.loads(known.read_text())["pairs"]:
            if own["x"] in joined and own["y"] in joined:
                row = through([(own["x"], own["y"])])[0]
                listed.append(row | {"direct": own["error"]})
    return {
        "summary": {
            "shapes": len(shapes),
            "left out": sorted(set(shapes) - set(joined)),
            "template": template,
            "pairs matched": len(direct),
            "direct": figures([row["error"] for row in direct]),
            "through, by vertices": figures([row["by_vertices"] for row in spread]),
            "through, by surface": figures([row["by_surface"] for row in spread]),
            **of_listed(listed),
            "to the template": figures(
                [error(back[name], name, template) for name in other]
            ),
            "mean distance, most": max(float(rows[n]["mean_distance"]) for n in joined),
            "95 % distance, most": max(float(rows[n]["most_distance"]) for n in joined),
            "flipped": sum(int(rows[name]["flipped"]) for name in joined),
            "collapsed": sum(int(rows[name]["collapsed"]) for name in joined),
        },
        "shapes": [rows[name] for name in shapes],
        "direct": direct,
        "through": spread,
        "listed": listed,
    }


def figures(errors: list[float]) -> dict | None:
    """What is said of errors; None of none."""
    if not errors:
        return None
    return {
        "number": len(errors),
        "mean": float(np.mean(errors)),
        "median": float(np.median(errors)),
        "below 0.06": int(np.sum(np.array(errors) < 0.06)),
        "wrong": sum(not protocol.is_right(e) for e in errors),
    }


class Errors:
    """Mean geodesic error of T_xy in sqrt(area of Y); distances on Y are kept."""

    def __init__(self, shapes: dict[str, datasets.Shape]):
        self.shapes, self.rows = shapes, {}

    def __call__(self, T_xy, x: str, y: str) -> float:
        one, two = self.shapes[x], self.shapes[y]
        num = min(len(one.truth), len(two.truth))
        some = np.random.default_rng(0).permutation(num)[:POINTS]
        if (y, num) not in self.rows:
            rows = GeodesicSolver(two.mesh).rows(two.truth[some])
            self.rows[y, num] = rows / np.sqrt(surface_area(two.mesh))
        images = np.asarray(T_xy)[one.truth[some]]
        return float(self.rows[y, num][np.arange(len(some)), images].mean())


if __name__ == "__main__":
    main()
