"""`jfsf collection --symmetric`: pairs of landmarks by the template's own mirror."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jfsf.apps.cli._collection_jobs import file_of, kept
from jfsf.apps.cli._print import counted
from jfsf.batch._jobs import Job

if TYPE_CHECKING:
    from jfsf.apps.landmarks import Landmarks

PAIRS = "landmark_pairs.csv"
# A stage before the pairs, and the folder of the template's map to itself.
SYMMETRY = "symmetry"


def keep_symmetry(job: Job) -> None:
    """Write the map of a kept shape to itself that exchanges left and right."""
    from jfsf.matching import symmetry
    from jfsf.storage._atomic import write_atomically

    found = symmetry(kept(job.inputs[0]).mesh)
    arrays: dict[str, Any] = {
        "T_xy": np.asarray(found.T_xy),
        "confidence": np.asarray(found.certificate.confidence),
    }
    write_atomically(job.out, lambda file: np.savez(file, **arrays))


def pairs_of(
    out: Path,
    template: Path,
    points: "Landmarks",
    run: Callable[..., dict[Path, str | None]],
) -> tuple[list[list[str]], str]:
    """Rows of `landmark_pairs.csv`, and a sentence on them.

    Args:
        out: folder of the results.
        template: what is kept of it.
        points: its landmarks.
        run: `outcomes`, on some client.

    Raises:
        ValueError: it has no symmetry to be found.
    """
    from jfsf.apps.landmarks._place import _listed, on_surface
    from jfsf.apps.landmarks._symmetric import WITHIN, mirror_pairs

    (out / SYMMETRY).mkdir(exist_ok=True)
    job = Job((template,), file_of(out, SYMMETRY, template.stem))
    if why := run([job], label=SYMMETRY, work=keep_symmetry)[job.out]:
        raise ValueError(f"{template.stem}: --symmetric: {why}")
    with np.load(job.out) as file:
        T, sure = file["T_xy"], float(file["confidence"])
    mesh = kept(template).mesh
    placed = on_surface(points, mesh)
    found = mirror_pairs(mesh, placed, T, system=points.system)
    said = (
        f"symmetry of the template, confidence {sure:.2f}: "
        f"{counted(len(found.pairs), 'pair', 'pairs')} of landmarks, "
        f"{len(found.midline)} on the midline"
    )
    if len(found.alone):
        alone = [points.names[at] or str(at + 1) for at in found.alone.tolist()]
        said += (
            f", {len(alone)} without a partner within {WITHIN:.0%} of sqrt(area): "
            f"{_listed(alone)}; write their partners in {PAIRS}, or take out the lines "
            "of those on the midline"
        )
    rows = [[str(a + 1), str(b + 1)] for a, b in found.pairs.tolist()]
    rows += [[str(a + 1), ""] for a in found.alone.tolist()]
    return sorted(rows, key=lambda row: int(row[0])), said


def pairs_in(out: Path) -> list[list[str]] | None:
    """What `write_pairs` wrote; None if it is nothing."""
    if not (out / PAIRS).exists():
        return None
    lines = (out / PAIRS).read_text(encoding="utf-8").split()[1:]
    return [line.split(",") for line in lines]


def write_pairs(out: Path, rows: list[list[str]] | None) -> list[Path]:
    """Write which landmarks of landmarks.csv are left and right of each other.

    One without a partner has an empty right; those that are not there are on the
    midline. With None the table of an earlier run, which does not hold, is removed.
    """
    from jfsf.apps.cli._runs import write_table

    if rows is None:
        (out / PAIRS).unlink(missing_ok=True)
        return []
    titles = "left", "right"
    named = [dict(zip(titles, row, strict=True)) for row in rows]
    write_table(out / PAIRS, titles, named)
    return [out / PAIRS]
