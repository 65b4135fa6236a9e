"""Vertices of a pair that are known to correspond: landmarks and ground truth."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jfsf.apps.cli._files import Shape, kept_points, numbered


class KnownPairs(NamedTuple):
    """Vertices that correspond.

    rows: (l, 2) vertices of the meshes of the `Shape` of X and of Y.
    names: one for each row; () if the file has none.
    said: how they were found, a sentence each.
    """

    rows: np.ndarray
    names: tuple[str, ...] = ()
    said: tuple[str, ...] = ()


def known_pairs(given, shapes: tuple[Shape, Shape]) -> KnownPairs | None:
    """The pairs of vertices that the files name, or None without files.

    Args:
        given: options of the pair, as `check_pair` accepts them.
        shapes: of X and of Y.

    Raises:
        ValueError: a file cannot be read, a vertex was not kept, a point is far from
            its mesh, or landmarks cannot be paired.
    """
    if given.landmarks is not None:
        return KnownPairs(read_known_pairs(given.landmarks, shapes))
    if given.landmarks_x is None:
        return None
    return _paired((given.landmarks_x, given.landmarks_y), shapes)


def landmark_names(given) -> tuple[str, ...]:
    """The name of each row of `known_pairs`, from the files alone; () without names."""
    from jfsf.apps.landmarks import pair_landmarks, read_landmarks

    if given.landmarks_x is None:
        return ()
    files = given.landmarks_x, given.landmarks_y
    return pair_landmarks(*map(read_landmarks, files)).names


def kept_truth(given, shapes: tuple[Shape, Shape], base: int | None = None) -> Any:
    """Vertices that correspond by the files of ground truth, or None without files.

    Args:
        given: options of the pair, as `check_pair` accepts them.
        shapes: of X and of Y. Points whose vertex was not kept are left out.
        base: as `jfsf.apps.mapfiles.read_ground_truth` takes it.
    """
    from jfsf.apps.mapfiles import read_ground_truth

    if given.gt_x is None:
        return None
    n_x, n_y = (
        len(own.mesh.vertices if own.partner is None else own.partner) for own in shapes
    )
    truth = read_ground_truth(given.gt_x, given.gt_y, n_x=n_x, n_y=n_y, base=base)
    return kept_points(truth, [own.partner for own in shapes])


def read_known_pairs(path: Path, shapes: tuple[Shape, Shape]) -> np.ndarray:
    """Rows (vertex of X, vertex of Y) of a file of text.

    Args:
        path: as `read_vertex_pairs` takes it.
        shapes: of X and of Y, whose vertices the rows that are returned count.

    Raises:
        ValueError: another format, or a vertex that there is not or was not kept.
    """
    from jfsf.apps.landmarks._files import read_vertex_pairs

    pairs = read_vertex_pairs(path)
    columns = [
        _kept(path, pairs[:, column], shape, "XY"[column])
        for column, shape in enumerate(shapes)
    ]
    return np.stack(columns, axis=1)


def _kept(path: Path, vertices: np.ndarray, shape: Shape, side: str) -> np.ndarray:
    n = len(shape.file.vertices)
    if (wrong := vertices >= n).any():
        row = int(np.argmax(wrong))
        raise ValueError(
            f"{path}: landmark {row + 1} names vertex {vertices[row]} of {side}, which "
            f"has vertices 0 to {n - 1}; is the file of another mesh, or counted from "
            "1?"
        )
    at = numbered(vertices, shape.partner)
    if (lost := at < 0).any():
        raise ValueError(
            f"{path}: vertex {vertices[lost][0]} of {side} is not in the "
            "largest piece, belongs to no face, or was removed by the repair; leave "
            "that line out"
        )
    return at


def _paired(paths: tuple[Path, Path], shapes: tuple[Shape, Shape]) -> KnownPairs:
    from jfsf.apps.landmarks import pair_landmarks, read_landmarks, to_vertices

    both, said = [read_landmarks(path) for path in paths], []
    try:
        pairing = pair_landmarks(*both)
    except ValueError as error:
        raise ValueError(f"{paths[0]}, {paths[1]}: {error}") from None
    columns = []
    for side, path, shape, found in zip("XY", paths, shapes, both, strict=True):
        rows = pairing.rows[:, len(columns)]
        if found.vertices is None:
            found = found._replace(points=np.asarray(found.points)[rows])
        else:
            kept = _kept(path, np.asarray(found.vertices)[rows], shape, side)
            found = found._replace(vertices=kept)
        found = found._replace(names=tuple(found.names[row] for row in rows))
        try:
            at = to_vertices(found, shape.mesh)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        columns.append(at.vertices)
        said += [f"{path}: {line}" for line in (*found.said, *at.said)]
        if found.points is not None:
            worst = int(np.argmax(at.distances))
            said.append(
                f"{path}: its landmarks are within {at.distances[worst]:.4g} of their "
                f"vertices{_farthest(found.names[worst])}"
            )
    said = [f"landmarks: {line}" for line in pairing.said] + said
    return KnownPairs(np.stack(columns, axis=1), pairing.names, tuple(said))


def _farthest(name: str) -> str:
    return f", the farthest is {name!r}" if name else ""
