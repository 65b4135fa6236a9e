"""The files of the command line: read, checked and written, all alike."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jfsf.types import Mesh


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
    from jfsf.storage._atomic import check_writable

    try:
        check_writable(path)
    except OSError as error:
        raise ValueError(
            f"{named}: cannot be written ({error.strerror}); name another place"
        ) from None


def can_export(
    paths: Sequence[Path], inputs: Sequence[Path], checker: bool = False
) -> None:
    """ValueError if a mesh cannot be exported to one of `paths`, as `can_write`."""
    from jfsf.apps.export._export import check_path

    for path in paths:
        check_path(path, checker=checker)
    can_write_beside(paths, inputs)


def can_write_beside(paths: Sequence[Path], inputs: Sequence[Path]) -> None:
    """ValueError if one of `paths` cannot be written, or is an input."""
    for path in paths:
        can_write(path, path.suffix.lower())
        if any(path.exists() and path.samefile(i) for i in inputs if i.exists()):
            raise ValueError(f"{path}: is an input; write to another file")


def need_matplotlib() -> None:
    """ImportError if matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise ImportError("drawing needs matplotlib: pip install 'jfsf[viz]'")


def sides_in_doubt(mesh: Mesh) -> str:
    """Why left and right of a mesh may be swapped; "" if nothing speaks for it."""
    from jfsf.mesh import unclear_winding
    from jfsf.mesh._winding import MAX_UNCLEAR

    share = unclear_winding(mesh)
    if share <= MAX_UNCLEAR:
        return ""
    return f"the winding of {share:.0%} of its area is unclear"


# Of a mesh that was to be repaired.
UNTOUCHED = "nothing to repair"


class Shape(NamedTuple):
    """A mesh of a file that can be matched, and its vertices' numbers there.

    mesh: all of the file, or what is left of it.
    index: (n,) the vertex in the file of each vertex; None for all of the file.
    partner: (n_file,) the vertex that each one in the file became, -1 if it was
        removed; likewise.
    file: the mesh of the file.
    repaired: its repair, if one was asked for, or if vertices without a face were left
        out. Maps then are between all vertices of the files.
    said: what was passed over in the file, and what was left out of it or mended, a
        sentence each.
    """

    mesh: Mesh
    index: Any
    partner: Any
    file: Mesh
    repaired: Any = None
    said: tuple[str, ...] = ()


def matchable(path: Path, largest: bool, mend: bool = False) -> Shape:
    """Read a mesh that can be matched, without vertices that belong to no face.

    Args:
        path: its file.
        largest: keep its largest component only.
        mend: repair it.

    Raises:
        MeshError: it cannot be matched.
    """
    from jfsf.matching import check_matchable
    from jfsf.mesh import largest_component, read_noted, repair, without_strays

    file, notes = read_noted(path, finite=not mend)
    shape = Shape(file, None, None, file)
    if mend:
        options = {"small": np.inf} if largest else {}
        mended = repair(file, name=str(path), **options)
        words = ", ".join(mended.done) or UNTOUCHED
        shape = Shape(*mended[:3], file, mended, (words,))
    elif largest:
        mesh, index = largest_component(file)
        partner = np.full(len(file.vertices), -1, np.int32)
        partner[index] = np.arange(len(index))
        dropped = left_out(file, index)
        shape = Shape(mesh, index, partner, file, said=(dropped,) * bool(dropped))
    elif (left := without_strays(file)).done:
        shape = Shape(*left[:3], file, left, left.done)
    elif len(file.faces) == 0 and (would := repair(file, name=str(path)).done):
        # Nothing refuses a cloud whose points coincide.
        shape = shape._replace(said=(f"--repair would mend: {', '.join(would)}",))
    check_matchable(shape.mesh, name=str(path))
    return shape._replace(said=(*notes, *shape.said))


def left_out(mesh: Mesh, index) -> str:
    """What is not in the largest component of a mesh, in words; "" if nothing.

    Args:
        mesh: all of the file.
        index: the vertices of the component.
    """
    n = len(mesh.vertices)
    if len(index) == n:
        return ""
    counts, share = pieces_beside(mesh, index)
    pieces = len(counts)
    words = f"{n - len(index)} vertices"
    if pieces:
        counted = "1 other piece" if pieces == 1 else f"{pieces} other pieces"
        words = f"{counted} with {words} and {share:.2%} of the area"
    else:
        words += " without a face"
    return f"--largest-component leaves out {words}"


def pieces_beside(mesh: Mesh, index) -> tuple[np.ndarray, float]:
    """The faces of each piece beside the largest, and their share of the area.

    Args:
        mesh: with faces or without.
        index: the vertices of the component.
    """
    from jfsf.mesh._geometry import face_areas, vertex_components

    n, faces = len(mesh.vertices), np.asarray(mesh.faces)
    outside = ~np.isin(faces[:, 0], index)
    owner = vertex_components(faces, n)[faces[outside, 0]]
    area = face_areas(np.asarray(mesh.vertices), faces)
    share = area[outside].sum() / area.sum() if area.any() else 0.0
    return np.unique(owner, return_counts=True)[1], float(share)


def numbered(points: np.ndarray, partner: np.ndarray | None) -> np.ndarray:
    """The vertices of a shape at vertices of its file; -1 where none is left.

    Args:
        points: numbers from 0 in the file.
        partner: of the `Shape`.
    """
    if partner is None:
        return points
    known = points < len(partner)
    return np.where(known, partner[np.where(known, points, 0)], -1)


def kept_points(truth, partners) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of vertices of files as those of shapes, without lost ones.

    Args:
        truth: vertices of X's file and of Y's that correspond.
        partners: of the `Shape` of X and of Y.
    """
    one, two = (
        numbered(np.asarray(points), partner)
        for points, partner in zip(truth, partners, strict=True)
    )
    known = (one >= 0) & (two >= 0)
    return one[known], two[known]
