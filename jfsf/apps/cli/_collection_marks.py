"""The landmarks of a run of `jfsf collection`: what is given, and what is written."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.table import Table

from jfsf.apps.cli._collection_carried import points_of
from jfsf.apps.cli._collection_check import CHECKED, write_check
from jfsf.apps.cli._collection_frozen import Frozen, marks_of
from jfsf.apps.cli._collection_landmarks import (
    TO_CHECK,
    landmarks_on,
    write_doubtful,
    write_landmarks_of,
)
from jfsf.apps.cli._collection_people import (
    ByPeople,
    file_of_template,
    mirrored_with,
    placed_by_people,
)
from jfsf.apps.cli._files import matchable

if TYPE_CHECKING:
    from jfsf.apps.landmarks import Landmarks


class Marks(NamedTuple):
    """The landmarks of the template, and others that people placed.

    path: of the template's.
    points: these, with semilandmarks after them.
    given: on shapes that are templates too, by name.
    people: on any shapes, to be compared with.
    lists: which of the points slide, and which are left and right of each other, if
        that is known: by `LISTS`.
    """

    path: Path
    points: "Landmarks"
    given: dict[str, ByPeople]
    people: dict[str, ByPeople]
    lists: dict[str, np.ndarray]

    @property
    def said(self) -> list[str]:
        """What was left out of the files, a sentence each."""
        lines = [f"{self.path}: {line}" for line in self.points.said]
        both = (self.given | self.people).values()
        return lines + [line for own in both for line in own.said]


def read_marks(
    landmarks: Path | None,
    template: Path | None,
    paths,
    frozen: Frozen | None,
    *,
    check: Path | None,
    semilandmarks: Sequence[Path],
    loading: tuple[bool, bool],
) -> Marks | None:
    """Read what a run is given of landmarks; None if it is nothing.

    Args:
        landmarks: those of the template, or a folder that has them; if None, those of
            `frozen`.
        template: its file.
        paths: the file of each shape, by name.
        frozen: the finished collection, for --onto.
        check: the folder of --check-landmarks.
        semilandmarks: files of curves and patches.
        loading: --largest-component and --repair.

    Raises:
        ValueError: files that do not fit, or landmarks that are missing.
    """
    path = file_of_template(landmarks, template)
    points, lists = points_of(path, template), {}
    given = placed_by_people(None if path == landmarks else landmarks, paths, points)
    if frozen is not None and points is None and (known := marks_of(frozen)):
        path, points, lists = known
    slid = [*lists["curves"][:, 1]] if "curves" in lists else []
    slid += [*lists["surfaces"][:, 0]] if "surfaces" in lists else []
    people = placed_by_people(check, paths, points, slid)
    if semilandmarks:
        if points is None or template is None:
            raise ValueError(
                f"{semilandmarks[0]}: semilandmarks follow on landmarks; give "
                "--landmarks too"
            )
        points, own = _with_semilandmarks(semilandmarks, points, template, loading)
        lists |= own
    if points is None or path is None:
        return None
    return Marks(path, points, given, people, lists)


def _with_semilandmarks(
    files: Sequence[Path], points: "Landmarks", template: Path, loading
) -> "tuple[Landmarks, dict[str, np.ndarray]]":
    """Landmarks of a template, with semilandmarks after them, and which slide."""
    from jfsf.apps.landmarks._outlines import appended, read_outlines
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.apps.landmarks._semilandmarks import semilandmarks

    outlines = read_outlines(files, points.names)
    mesh = matchable(template, *loading).mesh
    try:
        found = semilandmarks(mesh, on_surface(points, mesh).points, outlines)
    except ValueError as error:
        raise ValueError(f"{template}: {error}") from None
    lists = {"curves": found.slide, "surfaces": found.surface[:, None]}
    known = {kind: rows for kind, rows in lists.items() if len(rows)}
    return appended(points, found.names, found.points), known


def write_marks(
    out: Path, marks: Marks, rows, shapes, graph, others: Sequence[str]
) -> tuple[list[Path], list[Table], list[str]]:
    """Write all that is known of the landmarks; the files, tables, and what to say.

    Args:
        out: the folder of the results.
        marks: of `read_marks`.
        rows: of the summary.
        shapes: what was kept of each, by name; mirror images mirrored back.
        graph: of these.
        others: names of the other templates.
    """
    from jfsf.apps.morphometrics._tables import write_lists

    names = list(shapes)
    base, turned = names[graph.paths.template], {names[i] for i in graph.mirrored_back}
    joined = [row["name"] for row in rows if not row["reason"]]
    given, people = (mirrored_with(own, turned) for own in (marks.given, marks.people))
    found = landmarks_on(out, marks.points, shapes, graph, joined, others, given)
    written = write_landmarks_of(out, found, marks.points, marks.path)
    written += write_lists(out, marks.lists)
    tables, errors = write_check(out, found, people, shapes, base, given)
    lines = [*write_doubtful(out, found), *errors]
    written += [out / TO_CHECK, *([out / CHECKED] if people else [])]
    return written, tables, lines
