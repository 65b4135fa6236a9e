"""The files of the command line: read, checked and written, all alike."""

from collections.abc import Sequence
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from jfsf.mesh._read import COMPRESSED, SUFFIXES
from jfsf.types import Match, Mesh


class Orientation(StrEnum):
    """`jfsf.match`'s orientation, as choices of an option."""

    preserve = "preserve"
    reverse = "reverse"
    any = "any"


OrientationOption = Annotated[
    Orientation,
    typer.Option(help="Keep left and right, swap them, or take the better map."),
]


BaseOption = Annotated[
    int | None,
    typer.Option(
        min=0, max=1, help="First index in text files that break the convention."
    ),
]
AnyUnitOption = Annotated[
    bool,
    typer.Option(
        "--any-unit/--same-unit",
        help="With --partial: the files may have different units. The first is made as "
        "long as the second, and 0.4 to 2.5 times that is tried.",
    ),
]

FORMATS = f"{', '.join(SUFFIXES)}; also packed, {', '.join(COMPRESSED)}."
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
    from jfsf.storage._atomic import check_writable

    try:
        check_writable(path)
    except OSError as error:
        raise ValueError(
            f"{named}: cannot be written ({error.strerror}); name another place"
        ) from None


def can_export(paths: list[Path], checker: bool, inputs: tuple[Path, ...]) -> None:
    """ValueError if a mesh cannot be exported to one of `paths`, as `can_write`."""
    from jfsf.apps.export._export import check_path

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


def write_found(
    path: Path, match: Match, x: Shape, y: Shape, notes: Sequence[str] = ()
) -> None:
    """Write a match; after a repair its maps are those between the files' vertices."""
    from jfsf.apps.mapfiles import write_match
    from jfsf.mesh._partners import map_of_originals, nearest_kept

    if x.repaired is None and y.repaired is None:
        write_match(path, match, index_x=x.index, index_y=y.index, notes=notes)
        return
    both = _repaired(x), _repaired(y)
    match = match._replace(
        T_xy=map_of_originals(match.T_xy, x.file, *both),
        T_yx=map_of_originals(match.T_yx, y.file, *both[::-1]),
    )
    at = [nearest_kept(s.file, own) for s, own in zip((x, y), both, strict=True)]
    write_match(path, _values_at(match, *at), notes=notes)


def kept_match(match: Match, x: Shape, y: Shape) -> Match:
    """The match of the shapes from that of their files, as `write_found` wrote it."""
    if x.repaired is None and y.repaired is None:
        return match
    one, two = _repaired(x), _repaired(y)
    match = match._replace(
        T_xy=two.partner[np.asarray(match.T_xy)[one.index]],
        T_yx=one.partner[np.asarray(match.T_yx)[two.index]],
    )
    return _values_at(match, one.index, two.index)


def _repaired(shape: Shape):
    """The repair of a shape; of one that is whole, that nothing was removed."""
    from jfsf.mesh import Repaired

    same = np.arange(len(shape.file.vertices), dtype=np.int32)
    return shape.repaired or Repaired(shape.mesh, same, same, ())


def _values_at(match: Match, at_x, at_y) -> Match:
    """The values of vertices, where there are any, at these vertices of X and of Y."""
    kinds = "matched", "confidence", "membership"
    names = [f"{name}_{side}" for name in kinds for side in "xy"]
    known = [name for name in names if getattr(match, name) is not None]
    at = {"x": at_x, "y": at_y}
    return match._replace(
        **{n: np.asarray(getattr(match, n))[at[n[-1]]] for n in known}
    )


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
