"""The files of the command line: read, checked and written."""

import re
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from jfsf.types import Mesh


class Orientation(StrEnum):
    """`jfsf.match`'s orientation, as choices of an option."""

    preserve = "preserve"
    reverse = "reverse"
    any = "any"


OrientationOption = Annotated[
    Orientation,
    typer.Option(help="Keep left and right, swap them, or take the better map."),
]


_DIGITS = re.compile("[0-9]{1,18}")
FORMATS = "OFF, OBJ, PLY, STL, GLB or glTF file."
MeshX = Annotated[Path, typer.Argument(metavar="X", help=FORMATS)]
MeshY = Annotated[Path, typer.Argument(metavar="Y", help=FORMATS)]


def can_write(path: Path, suffix: str) -> None:
    """ValueError if `path` has another suffix or cannot be written.

    For checks before the work, so that the work is not lost.
    """
    if path.suffix.lower() != suffix:
        raise ValueError(f"{path}: is written as {suffix}; give it that suffix")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.parent}; make it first")
    _probe(path, path)


def can_write_in(folder: Path) -> None:
    """ValueError if files cannot be written in a folder, which need not exist yet."""
    there = folder.absolute()
    while not there.exists():
        there = there.parent
    _probe(there / "file", folder)


def _probe(path, named):
    from jfsf.storage import check_writable

    try:
        check_writable(path)
    except OSError as error:
        raise ValueError(
            f"{named}: cannot be written ({error.strerror}); name another place"
        ) from None


def can_export(paths: list[Path], checker: bool, inputs: tuple[Path, ...]) -> None:
    """ValueError if a mesh cannot be exported to one of `paths`, as `can_write`."""
    from jfsf.export import check_path

    if checker and not paths:
        raise ValueError("--checker goes with --export; say which file to write")
    for path in paths:
        check_path(path, checker=checker)
        can_write(path, path.suffix.lower())
        if any(path.exists() and path.samefile(i) for i in inputs if i.exists()):
            raise ValueError(f"{path}: is an input; export to another file")


def need_matplotlib() -> None:
    """ImportError if matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise ImportError("drawing needs matplotlib: pip install 'jfsf[viz]'")


def check_mesh(mesh: Mesh, path: Path) -> None:
    """`jfsf.matching.check_matchable`, with advice for the command line."""
    from jfsf.matching import check_matchable
    from jfsf.mesh import MeshError

    try:
        check_matchable(mesh, name=str(path))
    except MeshError as error:
        hint = str(error).replace("largest_component", "match --largest-component")
        raise MeshError(hint) from None


def one_sided(mesh: Mesh) -> bool:
    """Whether a mesh with faces cannot be wound consistently."""
    from jfsf.mesh import check, orient

    return len(mesh.faces) > 0 and not check(orient(mesh)).consistent


def matchable(path: Path, largest: bool):
    """The mesh of a file that can be matched, and None.

    With `largest`, its largest component and the original numbers of the vertices.
    """
    from jfsf.mesh import largest_component, read

    mesh, index = read(path), None
    if largest:
        mesh, index = largest_component(mesh)
    check_mesh(mesh, path)
    return mesh, index


def read_landmarks(path: Path, kept) -> np.ndarray:
    """Rows (vertex of X, vertex of Y) of a text file.

    Args:
        path: a pair of vertices a line, counted from 0; # begins a comment.
        kept: for X and Y, None or the original numbers of the vertices that were kept.
            The rows that are returned count the kept vertices.

    Raises:
        ValueError: another format, or a vertex that was not kept.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [line.split("#")[0].split() for line in text.splitlines()]
    # int() takes 1_0 for 10.
    is_pair = lambda line: len(line) == 2 and all(map(_DIGITS.fullmatch, line))
    pairs = [line for line in lines if line]
    if not pairs or not all(map(is_pair, pairs)):
        raise ValueError(
            f"{path}: a line holds a vertex of X and one of Y, counted from 0"
        )
    pairs = np.array(pairs, np.int64)
    for column, index in enumerate(kept):
        if index is None:
            continue
        at = np.searchsorted(index, pairs[:, column]).clip(max=len(index) - 1)
        lost = index[at] != pairs[:, column]
        if lost.any():
            raise ValueError(
                f"{path}: vertex {pairs[lost, column][0]} of {'XY'[column]} is not in "
                "the largest piece; leave that line out"
            )
        pairs[:, column] = at
    return pairs


def read_pair(x, y, map_file, gt_x, gt_y, base):
    """Both meshes, the arrays of the map file, and the ground truth or None.

    A map of `match --largest-component` counts the vertices that were kept. Then the
    meshes are cut to these, and points of the ground truth that were not kept are left
    out.
    """
    from jfsf.mapfiles import read_ground_truth, read_stored
    from jfsf.mesh import read

    if (gt_x is None) != (gt_y is None):
        raise ValueError("ground truth takes both --gt-x and --gt-y")
    meshes = [read(x), read(y)]
    sizes = {
        f"n_{side}": len(mesh.vertices) for side, mesh in zip("xy", meshes, strict=True)
    }
    truth = None
    if gt_x is not None:
        truth = read_ground_truth(gt_x, gt_y, **sizes, base=base)
    maps = read_stored(map_file, **sizes, base=base)
    for side, index in enumerate((maps.index_x, maps.index_y)):
        if index is None:
            continue
        vertices, faces = meshes[side]
        new = np.full(len(vertices), -1, np.int32)
        new[index] = np.arange(len(index))
        faces = new[faces]
        meshes[side] = Mesh(vertices[index], faces[(faces >= 0).all(1)])
        if truth is not None:
            points = new[truth[side]]
            known = points >= 0
            truth = type(truth)(
                *(points[known] if i == side else t[known] for i, t in enumerate(truth))
            )
    return *meshes, maps, truth
