"""The landmarks of a run of `jfsf collection`: what is given, and what is written."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

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
    Placed,
    file_of_template,
    mirrored_with,
    placed_by_people,
)
from jfsf.apps.cli._collection_semilandmarks import semilandmarks_of, write_sliders
from jfsf.apps.cli._collection_symmetry import write_pairs

if TYPE_CHECKING:
    from jfsf.apps.landmarks import Landmarks


class Marks(NamedTuple):
    """The landmarks of the template, and others that people placed.

    path: of the template's.
    points: these, with semilandmarks after them.
    given: on shapes that are templates too, by name.
    people: on any shapes, to be compared with.
    sliding: which of the points slide; None for none.
    pairs: rows of landmark_pairs.csv; None if left and right are not told apart.
    """

    path: Path
    points: "Landmarks"
    given: dict[str, Placed]
    people: dict[str, Placed]
    sliding: Any = None
    pairs: list[list[str]] | None = None

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
    ways: tuple[bool, bool],
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
        ways: --largest-component and --repair.

    Raises:
        ValueError: files that do not fit, or landmarks that are missing.
    """
    path = file_of_template(landmarks, template)
    points, sliding, pairs = points_of(path, template), None, None
    given = placed_by_people(None if path == landmarks else landmarks, paths, points)
    if frozen is not None and points is None and (known := marks_of(frozen)):
        path, points, sliding, pairs = known
    slid = () if sliding is None else (*sliding.slide[:, 1], *sliding.surface)
    people = placed_by_people(check, paths, points, slid)
    if semilandmarks:
        if points is None or template is None:
            raise ValueError(
                f"{semilandmarks[0]}: semilandmarks follow on landmarks; give "
                "--landmarks too"
            )
        points, sliding = semilandmarks_of(semilandmarks, points, template, *ways)
    if points is None or path is None:
        return None
    return Marks(path, points, given, people, sliding, pairs)


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
    names = list(shapes)
    base, turned = names[graph.paths.template], {names[i] for i in graph.mirrored_back}
    joined = [row["name"] for row in rows if not row["reason"]]
    given, people = (mirrored_with(own, turned) for own in (marks.given, marks.people))
    found = landmarks_on(out, marks.points, shapes, graph, joined, others, given)
    written = write_landmarks_of(out, found, marks.points, marks.path)
    written += write_sliders(out, marks.sliding) + write_pairs(out, marks.pairs)
    tables, errors = write_check(out, found, people, shapes, base, given)
    lines = [*write_doubtful(out, found), *errors]
    written += [out / TO_CHECK, *([out / CHECKED] if people else [])]
    return written, tables, lines
