"""Changes of X that a match should not notice: pose, size, fewer vertices, small holes.

Of X only, so that errors are those on the same Y. Ground truth follows the vertices:
where one is gone it is the nearest that is left.
"""

import argparse
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jfsf.geometry import geodesics
from jfsf.matching.parts import cut
from jfsf.mesh import decimate, surface_area
from jfsf.types import Mesh

HOLE = 0.03  # radius of a hole, in sqrt(area)


class Changes(NamedTuple):
    """What is done to X, in this order.

    holes: geodesic balls that are cut out, of radius `HOLE`.
    decimate: share of the vertices that is left.
    turn: whether it is rotated at random.
    scale: bounds of a factor of its size, of which the logarithm is uniform.
    """

    holes: int = 0
    decimate: float = 1.0
    turn: bool = False
    scale: tuple[float, float] = (1.0, 1.0)

    @property
    def same_unit(self) -> bool:
        """Whether X keeps its size."""
        return self.scale == (1.0, 1.0)


class Changed(NamedTuple):
    """near: (n,) the vertex for each one before; scale: the factor of the size."""

    mesh: Mesh
    near: np.ndarray  # type: ignore
    scale: float = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `Changes`."""
    parser.add_argument("--holes", type=int, default=0, help="small, cut out of X")
    parser.add_argument(
        "--decimate", type=float, default=1.0, help="share of X's vertices that is left"
    )
    parser.add_argument("--turn", action="store_true", help="rotate X at random")
    parser.add_argument(
        "--scale",
        type=float,
        nargs=2,
        default=(1.0, 1.0),
        metavar=("LOW", "HIGH"),
        help="X is so many times as large, at random between both",
    )


def asked(args: argparse.Namespace) -> Changes:
    """Those of the command line."""
    return Changes(args.holes, args.decimate, args.turn, tuple(args.scale))


def changed(mesh: Mesh, changes: Changes, seed: int) -> Changed:
    """A mesh, changed; the same for the same seed."""
    rng = np.random.default_rng(seed)
    before = np.asarray(mesh.vertices, float)
    if changes.holes:
        at = rng.choice(len(before), changes.holes, replace=False)
        far = geodesics(mesh, at) > HOLE * np.sqrt(surface_area(mesh))
        mesh = cut(mesh, far.all(0)).mesh
    if changes.decimate < 1:
        mesh = decimate(mesh, round(changes.decimate * len(mesh.vertices)))
    near = np.arange(len(before))
    if len(mesh.vertices) < len(before):
        near = np.asarray(KDTree(mesh.vertices).query(before)[1])
    vertices = np.asarray(mesh.vertices, float)
    if changes.turn:
        vertices = vertices @ Rotation.random(rng=rng).as_matrix().T
    scale = float(np.exp(rng.uniform(*np.log(changes.scale))))
    return Changed(Mesh(vertices * scale, mesh.faces), near, scale)
