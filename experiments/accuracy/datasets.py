"""Shapes with ground truth, and pairs of them: of the protocol, or of any folder.

`protocol.DataSet` says what a folder holds. `--data FOLDER` takes one that has nothing
to do with the protocol: its ground truth is named in the list, or it is vts/NAME.vts,
or corres/NAME.vts, or else the identity. WKSini_direct/X_Y.map, where there is one, is
an initial map to refine. --identity puts X's own mesh, in Y's pose, in the place of Y.
"""

import argparse
import os
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import factorized

import jfsf
from experiments.accuracy.protocol import SETS, DataSet
from jfsf import data
from jfsf.apps import mapfiles
from jfsf.mesh import largest_component
from jfsf.spectral._laplacian import operators
from jfsf.types import Mesh

SMOOTHED = 0.1  # weight of the Dirichlet energy, relative to one template point
LISTS = ("dev_pairs.txt", "test_pairs.txt", "pairs.txt")
MESHES, TRUTHS = (".off", ".ply"), (".vts", ".map", ".txt")  # ends of files


class Shape(NamedTuple):
    """truth, mirror: the vertex of each template point, and of its mirror image.

    Of a pair line i of both corresponds.
    """

    mesh: Mesh
    truth: np.ndarray
    mirror: np.ndarray | None


class Pair(NamedTuple):
    """A line of a list.

    x, y: names of the shapes.
    files: below the folder, where they are named; else empty.
    truth: files of the ground truth of X and Y, where they are named; else empty.
    rival: another method's error, if it is known.
    """

    x: str
    y: str
    files: tuple[str, ...] = ()
    truth: tuple[str, ...] = ()
    rival: float | None = None


def pairs_of(data_set: DataSet) -> list[Pair]:
    """The pairs of a set, in order, each once."""
    if data_set.pairs:
        path = Path(*data_set.folders[:1], data_set.pairs)
        lines = path.read_text(encoding="utf-8").splitlines()
        found = [_pair(words) for words in map(str.split, lines) if words]
    else:
        found = [Pair(x, y) for x, y in permutations(_names(data_set), 2)]
    return spread(list(dict.fromkeys(found)), data_set.number)


def spread(pairs: list, number: int | None) -> list:
    """So many of them, evenly spread; all if `number` is 0 or None."""
    if not number or number >= len(pairs):
        return pairs
    at = np.linspace(0, len(pairs) - 1, number).round().astype(int)
    return [pairs[i] for i in at]


def load_pair_of(data_set: DataSet, pair: Pair) -> tuple[Shape, Shape]:
    """Both shapes, whose ground truth has as many points."""
    files = pair.files or (pair.x, pair.y)
    truth = pair.truth or ("", "")
    x, y = (load_shape(data_set, *names) for names in zip(files, truth, strict=True))
    if data_set.truth == "landmarks":
        number = min(len(x.truth), len(y.truth))
        x, y = (shape._replace(truth=shape.truth[:number]) for shape in (x, y))
    if data_set.largest:
        x, y = map(_largest, (x, y))
        known = (x.truth >= 0) & (y.truth >= 0)
        x, y = (shape._replace(truth=shape.truth[known]) for shape in (x, y))
    if len(x.truth) != len(y.truth):
        raise SystemExit(
            f"{pair.x} {pair.y}: ground truth of {len(x.truth)} and {len(y.truth)} "
            "points; lines of both files must correspond"
        )
    return x, y


def load_shape(data_set: DataSet, name: str, truth: str = "") -> Shape:
    """A shape by its name, or by its file and that of its ground truth."""
    if data_set.truth == "package":
        sample = data.load(name)
        return Shape(sample.mesh, sample.template_to_vertex, None)
    path = _file(data_set, name)
    folder = path.parent.parent if path.parent.name == "off" else path.parent
    mesh = jfsf.read(path)
    n = len(mesh.vertices)
    if data_set.truth == "landmarks":
        rows = np.loadtxt(folder / "vts" / f"{name}.vts", usecols=0, ndmin=1)
        return Shape(mesh, rows.astype(int), None)
    if data_set.truth == "listed":
        path = Path(*data_set.folders[:1], truth)
        return Shape(mesh, mapfiles.read_map(path, n_to=n), None)
    points = folder / "corres" / f"{name}.vts"
    if data_set.truth == "identity" or not points.exists():
        return Shape(mesh, np.arange(n), None)
    mirror = points.with_suffix(".sym.vts")
    return Shape(
        mesh,
        mapfiles.read_map(points, n_to=n),
        mapfiles.read_map(mirror, n_to=n) if mirror.exists() else None,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that choose shapes and pairs."""
    folder = "repeat it for shapes in several; default: JFSF_DATA"
    parser.add_argument("--data", type=Path, action="append", help=folder)
    parser.add_argument("--embedded", action="store_true", help="shapes of the package")
    parser.add_argument("--pairs", type=Path, help="list; default: the folder's own")
    parser.add_argument("--spread", type=int, help="only N pairs, spread over the list")
    parser.add_argument(
        "--within", type=int, help="only pairs of one person: N shapes each"
    )
    parser.add_argument(
        "--identity", action="store_true", help="Y in X's connectivity: see posed"
    )


def check_arguments(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    """Where no folder is given, that of the environment; an error if there is none."""
    if not args.data and "JFSF_DATA" in os.environ:
        args.data = [Path(os.environ["JFSF_DATA"])]
    if not args.embedded and not args.data:
        parser.error("give --data FOLDER, set JFSF_DATA, or pass --embedded")


def asked(args: argparse.Namespace) -> DataSet:
    """The folders and the list of the command line, which are no set of the protocol.

    The embedded shapes are, but with all their pairs.
    """
    listed = args.pairs.absolute() if args.pairs else ""
    if args.embedded:
        return SETS["embedded"]._replace(pairs=listed, number=0)
    folders = tuple(folder.absolute() for folder in args.data)
    there = [name for name in LISTS if (folders[0] / name).exists()]
    if not listed and not args.within and there:
        listed = there[0]
    truth = "landmarks" if (folders[0] / "vts").is_dir() else "template"
    found = DataSet(folders[0].name, folders, truth, ("report",), "near", listed)
    if listed and any(pair.truth for pair in pairs_of(found)):
        return found._replace(truth="listed")
    return found


def chosen(args: argparse.Namespace) -> list[Pair]:
    """The pairs asked for, in order, each once; all of a list, whatever --spread."""
    data_set = asked(args)
    found = pairs_of(data_set)
    if args.within and not args.pairs:
        person = {name: i // args.within for i, name in enumerate(_names(data_set))}
        found = [pair for pair in found if person[pair.x] == person[pair.y]]
    return found


def pairs(args: argparse.Namespace) -> list[tuple[str, str]]:
    """The names of the pairs asked for, in order, each once."""
    names = list(dict.fromkeys((pair.x, pair.y) for pair in chosen(args)))
    return spread(names, args.spread)


def load_pair(args: argparse.Namespace, x: str, y: str) -> tuple[Shape, Shape]:
    """Both shapes by their names."""
    data_set = asked(args)
    known = [pair for pair in pairs_of(data_set) if (pair.x, pair.y) == (x, y)]
    one, two = load_pair_of(data_set, known[0] if known else Pair(x, y))
    return one, posed(one, two) if args.identity else two


def load(args: argparse.Namespace, name: str) -> Shape:
    """One shape by its name."""
    return load_shape(asked(args), name)


def posed(x: Shape, y: Shape) -> Shape:
    """X's mesh in the pose of Y, so that the ground truth is the identity.

    A vertex of X goes to the mean position on Y of its template points. A little
    smoothing also places the quarter of the vertices that have none.
    """
    n = len(x.mesh.vertices)
    total = np.zeros((n, 3))
    np.add.at(total, x.truth, y.mesh.vertices[y.truth])
    count = scipy.sparse.diags(np.bincount(x.truth, minlength=n).astype(float))
    stiffness, _ = operators(x.mesh)
    solve = factorized((count + SMOOTHED * stiffness).tocsc())
    points = np.stack([solve(column) for column in total.T], 1)
    return Shape(Mesh(points, x.mesh.faces), x.truth, None)


def initial_map(args: argparse.Namespace, x: str, y: str) -> np.ndarray | None:
    """The folder's T_xy to refine, (n_x,), or None."""
    if args.embedded or args.identity:
        return None
    path = args.data[0] / "WKSini_direct" / f"{x}_{y}.map"
    return mapfiles.read_map(path) if path.exists() else None


def _pair(words: list[str]) -> Pair:
    """Of the words of a line."""
    x, y, *rest = words
    name_x, name_y = (Path(w).stem if w.endswith(MESHES) else w for w in (x, y))
    files = () if (x, y) == (name_x, name_y) else (x, y)
    if len(rest) > 1 and rest[0].endswith(TRUTHS):
        return Pair(name_x, name_y, files, (rest[0], rest[1]))
    return Pair(name_x, name_y, files, rival=float(rest[0]) if rest else None)


def _largest(shape: Shape) -> Shape:
    """Its largest component; truth off it is -1."""
    part = largest_component(shape.mesh)
    local = np.full(len(shape.mesh.vertices), -1)
    local[part.index] = np.arange(len(part.index))
    return Shape(part.mesh, local[shape.truth], None)


def _file(data_set: DataSet, name: str) -> Path:
    names = name, f"{name}.off", f"off/{name}.off", f"{name}.ply"
    for path in (Path(folder, one) for folder in data_set.folders for one in names):
        if path.is_file():
            return path
    folders = ", ".join(map(str, data_set.folders))
    raise SystemExit(f"no {name}.off, off/{name}.off or {name}.ply in {folders}")


def _names(data_set: DataSet) -> list[str]:
    if data_set.truth == "package":
        return list(data.names())
    folders = [Path(folder) for folder in data_set.folders]
    folders += [folder / "off" for folder in folders]
    return sorted(
        p.stem for f in folders for ext in ("off", "ply") for p in f.glob(f"*.{ext}")
    )
