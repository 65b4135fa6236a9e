"""What the command line reads and writes, and refuses."""

import tempfile
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from jfsf.types import Mesh

FEWEST = 160  # vertices; see `match`


class Orientation(StrEnum):
    preserve = "preserve"
    reverse = "reverse"
    any = "any"


OrientationOption = Annotated[
    Orientation,
    typer.Option(help="Keep left and right, swap them, or take the better map."),
]


def can_write(path: Path, suffix: str) -> None:
    # Before the work, not after it.
    if path.suffix.lower() != suffix:
        raise ValueError(f"{path}: is to be written as {suffix}, name it so")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.parent}; make it first")


def need_matplotlib() -> None:
    if find_spec("matplotlib") is None:
        raise ImportError("drawing needs matplotlib: pip install 'jfsf[viz]'")


def validate(mesh: Mesh, path: Path) -> None:
    from jfsf.mesh import MeshError
    from jfsf.mesh import validate as validate_mesh

    try:
        validate_mesh(mesh, name=str(path))
    except MeshError as error:
        hint = str(error).replace("largest_component", "match --largest-component")
        raise MeshError(hint) from None
    if (n := len(mesh.vertices)) < FEWEST:
        raise MeshError(
            f"{path}: has {n} vertices, matching needs {FEWEST}; subdivide the mesh"
        )


def one_sided(mesh: Mesh) -> bool:
    from jfsf.mesh import check, orient

    return len(mesh.faces) > 0 and not check(orient(mesh)).consistent


def matchable(path: Path, largest: bool):
    """The mesh, and with `largest` the old numbers of its vertices."""
    from jfsf.mesh import largest_component, read

    mesh, index = read(path), None
    if largest:
        mesh, index = largest_component(mesh)
    validate(mesh, path)
    return mesh, index


def read_landmarks(path: Path, kept) -> np.ndarray:
    """Rows (vertex of X, vertex of Y); in kept vertices where pieces were dropped."""
    try:
        lines = [line.split("#")[0].split() for line in path.read_text().splitlines()]
        pairs = np.array([[int(word) for word in line] for line in lines if line])
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"{path}: a line holds a vertex of X and one of Y, counted from 0"
        ) from None
    for column, index in enumerate(kept):
        if index is None:
            continue
        place = np.searchsorted(index, pairs[:, column]).clip(max=len(index) - 1)
        lost = index[place] != pairs[:, column]
        if lost.any():
            raise ValueError(
                f"{path}: vertex {pairs[lost, column][0]} of {'XY'[column]} is not in "
                "the largest piece; leave that line out"
            )
        pairs[:, column] = place
    return pairs


def write_found(path: Path, found, **indices) -> None:
    from jfsf.cache import store
    from jfsf.mapfiles import write_match

    if all(index is None for index in indices.values()):
        write_match(path, found)
        return
    with tempfile.TemporaryDirectory() as folder:
        write_match(part := Path(folder) / "match.npz", found)
        with np.load(part) as file:
            store(path, **file, **indices)


def read_pair(x, y, map_file, gt_x, gt_y, base):
    """Both meshes, the arrays of the map file, and the ground truth or None.

    After --largest-component the map counts kept vertices: so do these meshes then, and
    the points of the ground truth that were dropped are left out.
    """
    from jfsf.mapfiles import MapFileError, read_ground_truth, read_map
    from jfsf.mesh import read

    if (gt_x is None) != (gt_y is None):
        raise ValueError("ground truth takes both --gt-x and --gt-y")
    mesh_x, mesh_y = read(x), read(y)
    truth = None
    if gt_x is not None:
        sizes = {"n_x": len(mesh_x.vertices), "n_y": len(mesh_y.vertices)}
        truth = read_ground_truth(gt_x, gt_y, **sizes, base=base)
    arrays = {}
    if map_file.suffix.lower() == ".npz":
        read_map(map_file)  # says what is wrong with the file
        with np.load(map_file) as file:
            arrays = {name: file[name] for name in file.files}
    for side, name in enumerate(("index_x", "index_y")):
        if (index := arrays.get(name)) is None:
            continue
        mesh = (mesh_x, mesh_y)[side]
        place = np.full(len(mesh.vertices), -1, np.int32)
        if not 0 <= index.min() <= index.max() < len(place):
            raise MapFileError(f"{map_file}: {name} is another mesh's")
        place[index] = np.arange(len(index))
        faces = place[mesh.faces]
        part = Mesh(mesh.vertices[index], faces[(faces >= 0).all(1)])
        mesh_x, mesh_y = (part, mesh_y) if side == 0 else (mesh_x, part)
        if truth is not None:
            points = place[truth[side]]
            known = points >= 0
            truth = type(truth)(
                *(points[known] if i == side else t[known] for i, t in enumerate(truth))
            )
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    text = base if map_file.suffix.lower() in (".vts", ".map") else None
    maps = {"T_xy": read_map(map_file, n_from=n_x, n_to=n_y, base=text)}
    if "T_yx" in arrays:
        maps["T_yx"] = read_map(map_file, n_from=n_y, n_to=n_x, key="T_yx")
    if "C_yx" in arrays:
        maps["C_yx"] = arrays["C_yx"]
    return mesh_x, mesh_y, maps, truth
