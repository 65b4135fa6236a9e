"""Shapes with ground truth, and pairs of them: of a data folder, or of the package.

A folder holds NAME.off with corres/NAME.vts (template point -> 1-based vertex) and,
where there is one, corres/NAME.sym.vts (the left-right mirror image); or NAME.ply in
one connectivity, whose ground truth is the identity. WKSini_direct/X_Y.map, where there
is one, is an initial map to refine. Lists have one pair of names a line. --identity
puts X's own mesh, in Y's pose, in the place of Y.
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
from jfsf import data, mapfiles
from jfsf.spectral import operators
from jfsf.types import Mesh

SMOOTHED = 0.1  # weight of the Dirichlet energy, relative to one template point
LISTS = ("dev_pairs.txt", "test_pairs.txt")


class Shape(NamedTuple):
    """truth, mirror: the vertex of each template point, and of its mirror image."""

    mesh: Mesh
    truth: np.ndarray
    mirror: np.ndarray | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that choose shapes and pairs."""
    parser.add_argument("--data", type=Path, default=os.environ.get("JFSF_DATA"))
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
    """An error in one line if no shapes are named."""
    if not args.embedded and args.data is None:
        parser.error("give --data FOLDER, set JFSF_DATA, or pass --embedded")


def pairs(args: argparse.Namespace) -> list[tuple[str, str]]:
    """The pairs asked for, in order, each once."""
    listed = args.pairs
    if listed is None and not args.embedded and not args.within:
        found = [args.data / name for name in LISTS if (args.data / name).exists()]
        listed = found[0] if found else None
    if listed is None:
        names = data.names() if args.embedded else _names(args.data)
        chosen = list(permutations(names, 2))
        if args.within:
            person = {name: i // args.within for i, name in enumerate(names)}
            chosen = [(x, y) for x, y in chosen if person[x] == person[y]]
    else:
        lines = listed.read_text().splitlines()
        chosen = [(w[0], w[1]) for w in map(str.split, lines) if w]
    chosen = list(dict.fromkeys(chosen))
    if args.spread and args.spread < len(chosen):
        at = np.linspace(0, len(chosen) - 1, args.spread).round().astype(int)
        chosen = [chosen[i] for i in at]
    return chosen


def load_pair(args: argparse.Namespace, x: str, y: str) -> tuple[Shape, Shape]:
    """Both shapes by their names."""
    one, two = load(args, x), load(args, y)
    return one, posed(one, two) if args.identity else two


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


def load(args: argparse.Namespace, name: str) -> Shape:
    """One shape by its name."""
    if args.embedded:
        sample = data.load(name)
        return Shape(sample.mesh, sample.template_to_vertex, None)
    path = args.data / f"{name}.off"
    if not path.exists():
        path = args.data / f"{name}.ply"
    mesh = jfsf.read(path)
    n, corres = len(mesh.vertices), args.data / "corres"
    truth, mirror = corres / f"{name}.vts", corres / f"{name}.sym.vts"
    return Shape(
        mesh,
        mapfiles.read_map(truth, n_to=n) if truth.exists() else np.arange(n),
        mapfiles.read_map(mirror, n_to=n) if mirror.exists() else None,
    )


def initial_map(args: argparse.Namespace, x: str, y: str) -> np.ndarray | None:
    """The folder's T_xy to refine, (n_x,), or None."""
    if args.embedded or args.identity:
        return None
    path = args.data / "WKSini_direct" / f"{x}_{y}.map"
    return mapfiles.read_map(path) if path.exists() else None


def _names(folder: Path) -> list[str]:
    return sorted(p.stem for ext in ("off", "ply") for p in folder.glob(f"*.{ext}"))
