"""All that a map file holds about a pair of meshes, checked against them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jfsf.apps.mapfiles._formats import (
    Arrays,
    MapFileError,
    to_functional_map,
    to_indices,
)
from jfsf.apps.mapfiles._read import choose_key, read_arrays, read_map

LARGEST = 1e15  # its square is finite in float32


class StoredMap(NamedTuple):
    """The arrays of a map file; None where it has none.

    T_xy: (n_x,) int32, the vertex of Y for each vertex of X, from 0, among the vertices
        that were matched.
    T_yx: (n_y,) int32, the vertex of X for each vertex of Y, from 0, among the vertices
        that were matched.
    C_yx: (k_x, k_y), functions on Y pulled back to X; finite, below `LARGEST`.
    index_x: (n_x,) int32, the number in X's mesh of each vertex that was matched: all
        but those that are -1 in the file; None if all were matched.
    index_y: (n_y,) int32, the number in Y's mesh of each vertex that was matched: all
        but those that are -1 in the file; None if all were matched.
    """

    T_xy: np.ndarray
    T_yx: np.ndarray | None = None
    C_yx: np.ndarray | None = None
    index_x: np.ndarray | None = None
    index_y: np.ndarray | None = None


def read_stored(
    path: str | Path, *, n_x: int, n_y: int, base: int | None = None
) -> StoredMap:
    """Read a map, and what else the file holds if it is a `.npz`.

    Args:
        path: as for `read_map`.
        n_x, n_y: vertices of the meshes, all of them.
        base: 0 or 1, the first index in text files; None takes their convention.

    Raises:
        MapFileError: as `read_map`; or an array is damaged or does not fit the meshes
            or T_xy, or a number of C_yx is not finite or above `LARGEST`; or a vertex
            has a partner that has none.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        text = base if path.suffix.lower() in (".vts", ".map") else None
        return StoredMap(read_map(path, n_from=n_x, n_to=n_y, base=text))
    arrays = read_arrays(path)
    key = choose_key(path, arrays, None)
    index_x, index_y = (
        _index(path, arrays, name, of, n)
        for name, of, n in (("index_x", key, n_x), ("index_y", "T_yx", n_y))
    )
    n_x = n_x if index_x is None else len(index_x)
    n_y = n_y if index_y is None else len(index_y)
    T_xy, T_yx = arrays[key](), arrays["T_yx"]() if "T_yx" in arrays else None
    lacking = any(T is not None and _lacks(T) for T in (T_xy, T_yx))
    if index_x is None and index_y is None and lacking:
        T_xy, T_yx, index_x, index_y = _partners(path, key, T_xy, T_yx, n_x, n_y)
    else:
        T_xy = to_indices(f"{path}[{key}]", T_xy, n_x, n_y, 0)
        if T_yx is not None:
            T_yx = to_indices(f"{path}[T_yx]", T_yx, n_y, n_x, 0)
    C_yx = None
    if "C_yx" in arrays:
        C_yx = to_functional_map(f"{path}[C_yx]", arrays["C_yx"]())
        if not (worst := np.abs(C_yx).max()) < LARGEST:
            raise MapFileError(
                f"{path}[C_yx]: holds {worst:.3g}, no number of a functional map; "
                "match the pair again"
            )
    return StoredMap(T_xy, T_yx, C_yx, index_x, index_y)


def _lacks(T: np.ndarray) -> bool:
    """Whether a map has -1 for vertices without a partner."""
    return T.dtype.kind == "i" and T.ndim == 1 and bool((T == -1).any())


def _partners(path: Path, key: str, T_xy, T_yx, n_x: int, n_y: int):
    """Maps among the vertices that have a partner, and the numbers of these."""
    index_x, there_xy = _known(f"{path}[{key}]", T_xy, n_x, n_y)
    if T_yx is None:
        return there_xy, None, index_x, None
    index_y, there_yx = _known(f"{path}[T_yx]", T_yx, n_y, n_x)
    maps = []
    for name, there, index, n in (
        (key, there_xy, index_y, n_y),
        ("T_yx", there_yx, index_x, n_x),
    ):
        renumber = np.full(n, -1, np.int32)
        renumber[index] = np.arange(len(index))
        if (lost := renumber[there] < 0).any():
            raise MapFileError(
                f"{path}[{name}]: has a partner, {there[lost][0]}, that has none "
                "itself; match the pair again"
            )
        maps.append(renumber[there])
    return *maps, index_x, index_y


def _known(where: str, T: np.ndarray, n_from: int, n_to: int):
    """The vertices with a partner, and these partners."""
    there = to_indices(where, np.where(T == -1, 0, T), n_from, n_to, 0)
    index = np.flatnonzero(np.asarray(T).ravel() != -1).astype(np.int32)
    if len(index) == 0:
        raise MapFileError(f"{where}: no vertex has a partner; match the pair again")
    return index, there[index]


def _index(path: Path, arrays: Arrays, name: str, of: str, n: int):
    """Vertices of the mesh, each once, as many as the map `of` has entries."""
    if name not in arrays:
        return None
    index = to_indices(f"{path}[{name}]", arrays[name](), None, n, 0)
    vertex, times = np.unique(index, return_counts=True)
    if (times > 1).any():
        raise MapFileError(
            f"{path}[{name}]: names vertex {vertex[times > 1][0]} more than once; "
            "match the pair again"
        )
    if of in arrays and (size := arrays[of]().size) != len(index):
        raise MapFileError(
            f"{path}: {name} has {len(index)} entries and {of} {size}; match the pair "
            "again"
        )
    return index
